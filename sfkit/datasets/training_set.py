"""The training-set record: stereo pairs a source is fine-tuned on."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

from sfkit.datasets.pairs import Pair
from sfkit.errors import InputError


@runtime_checkable
class FilePair(Protocol):
    """A pair on disk."""

    coding: str

    def files(self) -> Mapping[str, Path]:
        """Its files by role."""
        ...


@dataclass(frozen=True)
class TrainingSet:
    """Pairs to learn from, and those of its sequences that are held out.

    Attributes:
        name: the data set's name, or the caller's.
        pairs: at least one.
        held_out: pairs of whole sequences that no training sees.
        expected: how many training pairs the whole data set has, None where that is not known.
        root: the folder the files lie in, None for pairs in memory.
        licence: the terms of the data.
        citation: what to cite.
        notes: what a reader of results should know, such as the policy for the sky.
        benchmark: whether it is a benchmark's training part, so that a search that validates there is warned.
    """

    name: str
    pairs: tuple[Pair, ...]
    held_out: tuple[Pair, ...] = ()
    expected: int | None = None
    root: Path | None = None
    licence: str = ""
    citation: str = ""
    notes: tuple[str, ...] = ()
    benchmark: bool = False

    def __post_init__(self) -> None:
        if not self.pairs:
            raise InputError(f"training set {self.name!r}: found no pair, expected at least one")
        if len({pair.id for pair in self.pairs}) != len(self.pairs):
            raise InputError(f"training set {self.name!r}: found an id twice, expected each once")

    def __len__(self) -> int:
        return len(self.pairs)

    @property
    def coverage(self) -> str:
        """How much of the data set is here, such as ``3 of 2010 pairs``."""
        return f"{len(self)}{'' if self.expected is None else f' of {self.expected}'} pairs"

    def first(self, n: int) -> TrainingSet:
        """A training set of the first ``n`` pairs (all of them where there are fewer)."""
        if n < 1:
            raise InputError(f"training set {self.name!r}: found n = {n}, expected at least 1 pair")
        return replace(self, pairs=self.pairs[:n])

    def fingerprint(self) -> str:
        """SHA-256 (hex) over ids, codings and file sizes; a million files are not read for it.

        Pairs that are no files, such as rendered ones, enter by their own fingerprint.
        """
        digest = hashlib.sha256()
        for line in _lines(self.pairs):
            digest.update(line.encode())
        return digest.hexdigest()

    def describe(self) -> dict[str, Any]:
        """Plain values: which data, how much of it, whose."""
        return {
            "name": self.name,
            "pairs": len(self),
            "expected": self.expected,
            "held_out": len(self.held_out),
            "fingerprint": self.fingerprint(),
            "licence": self.licence,
            "citation": self.citation,
        }


def _lines(pairs: Iterable[Pair]) -> Iterable[str]:
    for pair in pairs:
        if isinstance(pair, FilePair):
            sizes = [f"{role}={path.stat().st_size}" for role, path in pair.files().items()]
            yield "\0".join([pair.id, pair.coding, *sizes, "\n"])
        else:
            yield f"{pair.id}\0{pair.fingerprint()}\n"
