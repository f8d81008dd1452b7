"""Open training sets: a public one by its manifest, one's own pairs, or a benchmark's."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from sfkit.datasets.benchmark import find_own_pairs, open_benchmark
from sfkit.datasets.digests import file_digest
from sfkit.datasets.folders import nothing_recognised
from sfkit.datasets.images import read_grey, read_image
from sfkit.datasets.pairs import Pair, Sample
from sfkit.datasets.root_folder import inside, open_root
from sfkit.datasets.shipped import PAIRS, ensure_training_set, source_manifest_names
from sfkit.datasets.source_cameras import constant_of
from sfkit.datasets.source_codings import read_source_disparity
from sfkit.datasets.source_manifests import (
    SourceLayout,
    SourceManifest,
    load_source_manifest,
)
from sfkit.datasets.training_set import TrainingSet
from sfkit.errors import InputError


@dataclass(frozen=True)
class SourcePair:
    """A pair of a public training set on disk.

    Attributes:
        id: the left image's path under the root, without its ending.
        left: the left image.
        right: the right image.
        disparity: the ground truth of the left image.
        coding: see :mod:`sfkit.datasets.source_codings`.
        invalid: masks whose non-zero pixels are unknown.
        width: the image width that the coding is for; 0 for any.
    """

    id: str
    left: Path
    right: Path
    disparity: Path
    coding: str
    invalid: tuple[Path, ...] = ()
    width: int = 0

    def files(self) -> dict[str, Path]:
        """All files of the pair, by role."""
        masks = {f"invalid{number}": path for number, path in enumerate(self.invalid)}
        return {"left": self.left, "right": self.right, "disparity": self.disparity, **masks}

    def load(self) -> Sample:
        """Read the files.

        Raises:
            InputError: a file is missing, damaged, of another size than the left image, or of another width
                than the camera's constants are for.
        """
        left, right = read_image(self.left), read_image(self.right)
        if self.width and left.shape[1] != self.width:
            raise InputError(
                f"{self.left}: is {left.shape[1]} pixels wide, expected {self.width}, which focal length and "
                "baseline of the data set are for; give the original images"
            )
        disparity = read_source_disparity(self.disparity, self.coding)
        for path, array in ((self.right, right), (self.disparity, disparity)):
            if array.shape[:2] != left.shape[:2]:
                raise InputError(
                    f"{path}: found {array.shape[1]}x{array.shape[0]} pixels, expected "
                    f"{left.shape[1]}x{left.shape[0]} as in {self.left}"
                )
        for path in self.invalid:
            mask = read_grey(path)
            if mask.shape != disparity.shape:
                raise InputError(f"{path}: found another size than that of {self.left}")
            disparity[mask != 0] = np.nan
        return Sample(self.id, left, right, disparity)

    def fingerprint(self) -> str:
        """SHA-256 (hex) of the files' content, the id and the coding."""
        digest = hashlib.sha256(f"{self.id}\0{self.coding}".encode())
        for path in self.files().values():
            digest.update(file_digest(path).encode())
        return digest.hexdigest()


@dataclass(frozen=True)
class FoundSource:
    """What of a public training set lies under a root.

    Attributes:
        train: complete pairs to train on.
        held_out: complete pairs of held-out sequences.
        incomplete: what a left image lacks, by id.
        withdrawn: how many pairs the authors' own list leaves out.
    """

    train: tuple[SourcePair, ...]
    held_out: tuple[SourcePair, ...]
    incomplete: dict[str, tuple[str, ...]]
    withdrawn: int = 0


def open_training_set(
    name: str,
    root: Path | str,
    *,
    hold_out: bool = True,
    coding: str | None = None,
    table: Path | str | None = None,
) -> TrainingSet:
    """Find the pairs of a training set under a folder; no image is read, and any part of it will do.

    Args:
        name: a training set's (``sceneflow``, ``sintel``, ...), ``pairs`` for a folder or CSV
            of one's own, or a benchmark's (``kitti2015``, ...).
        root: the folder.
        hold_out: keep the held-out sequences from training; False trains on them too.
        coding: of ``pairs``, where a suffix does not settle it.
        table: a CSV file that lies elsewhere than ``root``.

    Raises:
        InputError: an unknown name, or nothing to train on; the message says what to do.
    """
    if name == PAIRS:
        folder, found, absent = find_own_pairs(root, coding, table)
        if absent or not found.pairs:
            raise InputError(absent or nothing_recognised(folder, found))
        return TrainingSet(folder.name, found.pairs, root=folder, notes=found.notes)
    if name in source_manifest_names():
        manifest, folder = load_source_manifest(name), open_root(root)
        return _training_set(manifest, folder, find_source_pairs(manifest, folder), hold_out=hold_out)
    ensure_training_set(name)
    benchmark = open_benchmark(name, root, protocol="all-valid")
    return TrainingSet(
        name,
        benchmark.pairs,
        expected=benchmark.expected,
        root=benchmark.root,
        licence=benchmark.licence,
        citation=benchmark.citation,
        notes=(*benchmark.notes, "a benchmark's own pairs: a search that validates on them is not blind"),
        benchmark=True,
    )


def _training_set(manifest: SourceManifest, root: Path, found: FoundSource, *, hold_out: bool) -> TrainingSet:
    pairs: tuple[Pair, ...] = found.train if hold_out else (*found.train, *found.held_out)
    if not pairs:
        raise InputError(nothing_to_train_on(manifest, root, found))
    return TrainingSet(
        manifest.name,
        pairs,
        held_out=found.held_out if hold_out else (),
        expected=manifest.pairs,
        root=root,
        licence=manifest.licence,
        citation=manifest.citation,
        notes=(manifest.unknown,),
    )


def nothing_to_train_on(manifest: SourceManifest, root: Path, found: FoundSource) -> str:
    """The sentence for a root without a pair to train on: what was found, and what to do."""
    if found.held_out:
        what = f"only the {len(found.held_out)} pairs of held-out sequences; add others, or train on them too"
    elif found.incomplete:
        name, lacking = next(iter(found.incomplete.items()))
        what = f"left images only: {name} lacks {', '.join(lacking)}"
    else:
        what = f"no path like {manifest.layouts[0].left.pattern}"
    return f"{manifest.name}: under {root} found {what}; {manifest.get} ({manifest.home})"


def find_source_pairs(manifest: SourceManifest, root: Path) -> FoundSource:
    """All pairs of a training set under ``root``, which may lie some folders deeper.

    Raises:
        InputError: a camera file that cannot be read.
    """
    train: list[SourcePair] = []
    held: list[SourcePair] = []
    incomplete: dict[str, tuple[str, ...]] = {}
    unused = _unused(manifest, root)
    withdrawn = 0
    for relative in _files(root):
        found = _match(manifest, relative)
        if found is None:
            continue
        place, layout, groups = found
        name = relative.rpartition(".")[0]
        texts = (layout.image, layout.right, layout.disparity, *layout.invalid)
        files = [inside(root, place + text.format(**groups) if text else relative) for text in texts]
        lacking = [p.relative_to(root).as_posix() for p in files if not p.is_file()]
        # Public sets are often downloaded in part: what lacks a file is left out, and told.
        if lacking:
            incomplete[name] = tuple(lacking)
            continue
        if any(name.endswith(entry) for entry in unused):
            withdrawn += 1
            continue
        left, right, disparity, *invalid = files
        if manifest.constant:
            groups["constant"] = constant_of(manifest.constant, root, left, groups)
        coding = layout.coding.format(**groups)
        pair = SourcePair(name, left, right, disparity, coding, tuple(invalid), manifest.width)
        (held if manifest.holds_out(layout.sequence.format(**groups)) else train).append(pair)
    return FoundSource(tuple(train), tuple(held), incomplete, withdrawn)


def _match(manifest: SourceManifest, relative: str) -> tuple[str, SourceLayout, dict[str, str]] | None:
    """The folder in which the data set begins, the layout, and its groups, for a left image's path."""
    for layout in manifest.layouts:
        start = 0
        while start >= 0:
            match = layout.left.fullmatch(relative, start)
            if match:
                return relative[:start], layout, match.groupdict(default="")
            # After the last folder find's -1 makes 0, which ends the walk as -1.
            start = relative.find("/", start) + 1 or -1
    return None


def _files(root: Path) -> Iterator[str]:
    """All files under ``root``, relative to it, in one order everywhere."""
    for folder, folders, names in os.walk(root):
        # In place: os.walk goes down in this order.
        folders.sort()
        base = Path(folder).relative_to(root)
        yield from ((base / name).as_posix() for name in sorted(names))


def _unused(manifest: SourceManifest, root: Path) -> tuple[str, ...]:
    """Ends of ids that the authors withdrew, one a line of their list: ``TRAIN/A/0008/left/0006``."""
    path = root / manifest.unused
    if not manifest.unused or not path.is_file():
        return ()
    lines = path.read_text(encoding="utf-8", errors="replace").split()
    return tuple({line.rpartition(".")[0].replace("/right/", "/left/") or line for line in lines})
