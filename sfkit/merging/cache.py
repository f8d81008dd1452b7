"""Cached task vectors: a big pool is read once, and opened again without reading its files.

Task vectors above ``MAPPED_ABOVE`` bytes are kept as raw float32 files, named by the content they were
made from. A file counts as unchanged while size, times and inode are what they were when it was read; a
vector whose own file looks otherwise than when it was written must have the checksum of then. The folder
is ``SFKIT_CACHE``, or the user's cache folder; ``sfkit cache`` shows and clears it.
"""

from __future__ import annotations

import hashlib
import json
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import torch

from sfkit.checkpoints.fingerprints import text_digest
from sfkit.checkpoints.reading import CheckpointFile
from sfkit.errors import InputError
from sfkit.files import default_folder, signature, write_text, writing
from sfkit.merging.kept_relations import FOLDER as RELATIONS

LIMIT = 40 << 30  # bytes; the task vectors used longest ago go first
RECORDS = 1000  # checkpoints to remember, some 40 kB each; those read longest ago go first
VERSION = 1  # of what is cached: a change makes old entries unknown


@dataclass(frozen=True)
class FileRecord:
    """What reading a checkpoint once has told: its identity, and each tensor's."""

    fingerprint: str
    digests: Mapping[str, str]


@dataclass(frozen=True)
class VectorRecord:
    """A cached task vector's description, beside its values and their checksum.

    Attributes:
        cosine: of source to base; see :class:`~sfkit.checkpoints.kinship.Kinship`.
        distance: likewise.
        source: the file it was made from, for the listing.
    """

    cosine: float
    distance: float
    source: str


@dataclass(frozen=True)
class CacheEntry:
    """One cached task vector as the listing shows it: when it was last used, in seconds since 1970."""

    name: str
    source: str
    size_bytes: int
    used: float


class VectorCache:
    """The cache in one folder.

    Args:
        folder: where; ``SFKIT_CACHE`` or the user's cache folder by default.
        limit: bytes of task vectors to keep.
    """

    def __init__(self, folder: Path | None = None, *, limit: int = LIMIT) -> None:
        self.folder = folder or default_folder()
        self.limit = limit

    def file(self, file: CheckpointFile, architecture: str) -> FileRecord | None:
        """What is known of a checkpoint, read as one architecture names its keys, if it has not changed."""
        values = _read(self._file(file, architecture))
        if values is None or values.get("signature") != _looks(file):
            return None
        return FileRecord(values["fingerprint"], values["digests"])

    def remember(self, file: CheckpointFile, architecture: str, record: FileRecord) -> None:
        """Keep what reading a checkpoint has told."""
        values = {"path": str(file.path), "signature": _looks(file), **asdict(record)}
        _write(self._file(file, architecture), values)

    def vector(self, key: str) -> tuple[VectorRecord, torch.Tensor] | None:
        """A cached task vector, mapped; None where there is none, or another than was written."""
        place, target = self._vector(key, ".json"), self._vector(key, ".f32")
        values = _read(place)
        if values is None or not target.is_file():
            return None
        looks = list(signature(target))
        if values.get("looks") != looks:
            if "digest" not in values or values["digest"] != _checksum(target):
                return None
            # Copied or touched, but the same bytes: the new look is kept, so that they are read once.
            _write(place, {**values, "looks": looks})
        record = VectorRecord(values["cosine"], values["distance"], values["source"])
        os.utime(place)  # used now: trimming spares it
        return record, map_file(target, target.stat().st_size // 4, writable=False)

    @contextmanager
    def writing(self, key: str, elements: int) -> Iterator[torch.Tensor]:
        """A mapped (elements,) float32 buffer to fill; the file bears its name only once that is done.

        Raises:
            InputError: the disk has no room for it.
        """
        target = self._vector(key, ".f32")
        # A cache that a power cut takes is made anew: nothing waits for the disk.
        with writing(target, durable=False) as fresh:
            ensure_pages(target.parent, elements * 4)
            # Sparse: pages take up disk once they are written.
            os.truncate(fresh, elements * 4)
            yield map_file(fresh, elements)

    def describe(self, key: str, record: VectorRecord) -> None:
        """Write a filled buffer's description, which makes it known; then keep to the limit."""
        target = self._vector(key, ".f32")
        told = {"looks": list(signature(target)), "digest": _checksum(target)}
        _write(self._vector(key, ".json"), {**asdict(record), **told})
        self.trim(spare=key)

    def entries(self) -> list[CacheEntry]:
        """All cached task vectors, the one used last first."""
        found = []
        for path, stat in _files(self._folder("vectors"), "*.f32"):
            told = path.with_suffix(".json")
            values = _read(told) or {}
            # Each use touches the description; the values keep their time, by which changes are seen.
            used = told.stat().st_mtime if told.is_file() else stat.st_mtime
            found.append(CacheEntry(path.stem, str(values.get("source", "")), stat.st_size, used))
        return sorted(found, key=lambda entry: -entry.used)

    def trim(self, *, spare: str = "") -> None:
        """Drop the task vectors used longest ago until the rest fits the limit, and old files' records."""
        records = sorted(_files(self._folder("files"), "*.json"), key=lambda found: -found[1].st_mtime)
        for path, _ in records[RECORDS:]:
            path.unlink(missing_ok=True)
        kept = 0
        for entry in self.entries():
            kept += entry.size_bytes
            # The spared one is about to be mapped, even where it is larger than the limit by itself.
            if kept > self.limit and entry.name != spare:
                self._drop(entry.name)

    def clear(self) -> int:
        """Drop everything, rendered pairs and kept relations too; returns the bytes that were freed."""
        freed = 0
        for path in (self.folder / "rendered").glob("*.npz"):
            freed += path.stat().st_size
            path.unlink(missing_ok=True)
        for entry in self.entries():
            freed += entry.size_bytes
            self._drop(entry.name)
        for path in (*self._folder("files").glob("*.json"), *(self.folder / RELATIONS).glob("*.json")):
            path.unlink(missing_ok=True)
        return freed

    def _drop(self, name: str) -> None:
        # A process that has it mapped keeps its pages: the name goes, not the data.
        for suffix in (".json", ".f32"):
            self._vector(name, suffix).unlink(missing_ok=True)

    def _file(self, file: CheckpointFile, architecture: str) -> Path:
        # One file may hold several networks: weights, and their moving average.
        where = (architecture, file.layout.container, file.layout.prefix, str(file.path.absolute()))
        return self._folder("files") / f"{text_digest(json.dumps(where))}.json"

    def _vector(self, key: str, suffix: str) -> Path:
        return self._folder("vectors") / f"{key}{suffix}"

    def _folder(self, name: str) -> Path:
        return self.folder / f"v{VERSION}" / name


def ensure_pages(folder: Path, size: int) -> None:
    """Refuse before a mapped file outgrows its disk: a write to a page without room ends the process.

    Raises:
        InputError: fewer than ``size`` bytes are free.
    """
    free = shutil.disk_usage(folder).free
    if free < size:
        raise InputError(
            f"{folder}: {free / 2**20:.0f} MiB are free, expected {size / 2**20:.0f} MiB for a task vector: "
            "make room (sfkit cache clear), or let SFKIT_CACHE name a folder on another disk"
        )


def vector_key(base: str, source: str, order: str) -> str:
    """The name of a task vector: what it was made from, and the order its tensors lie in."""
    return text_digest(f"{base}\n{source}\n{order}")


def map_file(path: Path, elements: int, *, writable: bool = True) -> torch.Tensor:
    """A file of float32 values as a tensor of shape (elements,) made of its pages.

    Without ``writable`` a write would go to a copy of the page, never to the file.
    """
    # Private where it is not to be written: a slip then changes this process's pages alone.
    return torch.from_file(str(path), shared=writable, size=elements, dtype=torch.float32)


def _looks(file: CheckpointFile) -> list[list[int]]:
    return [list(look) for _, look in sorted(file.signatures.items())]


def _checksum(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _files(folder: Path, pattern: str) -> Iterator[tuple[Path, os.stat_result]]:
    """Files and their sizes and times; one that another process drops meanwhile is left out."""
    for path in folder.glob(pattern):
        try:
            yield path, path.stat()
        except FileNotFoundError:
            continue


def _read(path: Path) -> dict[str, Any] | None:
    """A JSON file of ours; one that is missing or torn counts as unknown and is made anew."""
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
    except (FileNotFoundError, json.JSONDecodeError, UnicodeDecodeError):
        return None
    return values if isinstance(values, dict) else None


def _write(path: Path, values: Mapping[str, Any]) -> None:
    write_text(path, json.dumps(values), durable=False)
