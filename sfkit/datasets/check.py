"""Check a data set before it is used: what is there, what is missing, and whether it makes sense."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from sfkit.datasets import check_sample
from sfkit.datasets.benchmark import find_own_pairs
from sfkit.datasets.folders import nothing_recognised
from sfkit.datasets.listing import PairListing, find_pairs, nothing_found
from sfkit.datasets.manifests import load_manifest
from sfkit.datasets.pairs import MemoryPair, Pair, StereoPair, is_labelled
from sfkit.datasets.protocols import protocols_without_mask, rules_for
from sfkit.datasets.root_folder import open_root
from sfkit.datasets.shipped import PAIRS, UNLABELLED
from sfkit.datasets.unlabelled import find_unlabelled
from sfkit.errors import InputError

Counted = Callable[[int, int], None]
SHOWN = 8  # names in a line of text before it says how many more there are


@dataclass(frozen=True)
class DataReport:
    """What a check found.

    Attributes:
        name: the data set.
        root: the folder, empty for pairs in memory.
        found: how many pairs are complete.
        expected: how many the data set has, None where that is not known.
        missing: the ids that are not there at all, where the data set's ids are known.
        incomplete: the files that lack, by id.
        problems: what makes pairs useless, as ``id: sentence``.
        warnings: what looks wrong but need not be, as ``id: sentence``.
        notes: what a reader of results should know.
    """

    name: str
    root: str
    found: int
    expected: int | None = None
    missing: tuple[str, ...] = ()
    incomplete: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    problems: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    notes: tuple[str, ...] = ()

    @property
    def ok(self) -> bool:
        """True where at least one pair is complete and no pair has a problem; parts may be missing."""
        return self.found > 0 and not self.problems

    def to_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return {**asdict(self), "ok": self.ok}

    def to_text(self) -> str:
        """The report in lines, for a terminal."""
        total = "" if self.expected is None else f" of {self.expected}"
        lines = [f"{self.name}: found {self.found}{total} pairs" + (f" in {self.root}" if self.root else "")]
        if self.missing:
            lines.append(f"  missing: {_some(self.missing)}")
        lines += [f"  incomplete: {name} lacks {', '.join(files)}" for name, files in self.incomplete.items()]
        lines += [f"  problem: {text}" for text in self.problems]
        lines += [f"  warning: {text}" for text in self.warnings]
        lines += [f"  note: {text}" for text in self.notes]
        verdict = "usable" if self.ok else "not usable as it is"
        return "\n".join(
            [*lines, f"  {verdict}: {len(self.problems)} problems, {len(self.warnings)} warnings"]
        )


def check_data(
    name: str,
    root: Path | str,
    *,
    resolution: str | None = None,
    coding: str | None = None,
    table: Path | str | None = None,
    every: int | None = None,
    progress: Counted | None = None,
) -> DataReport:
    """Look for a data set under a folder, load every pair and report; arguments as in ``open_benchmark``.

    A data set that is not there gives a report with a problem, not an error. ``progress`` is told, when a
    pair was loaded, how many were, and of how many.

    Raises:
        InputError: an unknown name or resolution, no such folder, or hints and tables that cannot be read.
    """
    if name == UNLABELLED:
        folder, found = find_unlabelled(root, table, 1 if every is None else every)
        return _report(folder.name, PAIRS, folder, found, None, "", progress)
    if name == PAIRS:
        folder, found, absent = find_own_pairs(root, coding, table)
        nothing = absent if found.pairs or absent else nothing_recognised(folder, found)
        return _report(folder.name, PAIRS, folder, found, None, nothing, progress)
    manifest, folder = load_manifest(name), open_root(root)
    resolution = manifest.resolution(resolution)
    found = find_pairs(manifest, folder, resolution)
    nothing = "" if found.pairs else nothing_found(manifest, folder, resolution, found)
    return _report(name, manifest.family, folder, found, manifest.ids, nothing, progress)


def _report(
    name: str,
    family: str,
    root: Path,
    found: PairListing,
    ids: tuple[str, ...] | None,
    nothing: str,
    progress: Counted | None,
) -> DataReport:
    problems, warnings = _check_pairs(found.pairs, progress)
    here = {pair.id for pair in found.pairs} | set(found.missing)
    strange = sorted(here - set(ids)) if ids else []
    notes = [*found.notes, *_mask_note(family, found.pairs)]
    if strange:
        notes.append(f"not among the data set's own names: {_some(strange)}")
    return DataReport(
        name=name,
        root=str(root),
        found=len(found.pairs),
        expected=None if ids is None else len(ids),
        missing=tuple(i for i in ids or () if i not in here),
        incomplete=found.missing,
        problems=(nothing, *problems) if nothing else problems,
        warnings=warnings,
        notes=tuple(notes),
    )


def _check_pairs(
    pairs: Sequence[Pair], progress: Counted | None = None
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    problems: list[str] = []
    warnings: list[str] = []
    first_with: dict[bytes, str] = {}
    for number, pair in enumerate(pairs, 1):
        if progress is not None:
            progress(number, len(pairs))
        try:
            sample = pair.load()
        except InputError as error:
            problems.append(f"{pair.id}: {error}")
            continue
        problems += [
            f"{pair.id}: {text}" for text in check_sample.problems(sample, labelled=is_labelled(pair))
        ]
        doubts = (*check_sample.warnings(sample), *check_sample.unexplained(sample))
        warnings += [f"{pair.id}: {text}" for text in doubts]
        # Digests, not images: a data set does not fit into memory.
        digest = hashlib.sha256(sample.left.tobytes()).digest()
        other = first_with.setdefault(digest, pair.id)
        if other != pair.id:
            warnings.append(f"{pair.id}: has the same left image as {other}; the pair counts twice")
    return tuple(problems), tuple(warnings)


def _mask_note(family: str, pairs: Iterable[Pair]) -> list[str]:
    """Says which protocols are out of reach for want of occlusion masks."""
    bare = [
        pair.id for pair in pairs if isinstance(pair, StereoPair) and pair.disparity and pair.mask is None
    ]
    bare += [p.id for p in pairs if isinstance(p, MemoryPair) and p.sample.nonoccluded is None]
    closed = sorted(set(rules_for(family)) - set(protocols_without_mask(family)))
    if not bare or not closed:
        return []
    return [f"no occlusion mask, so not for the protocols {', '.join(closed)}: {_some(bare)}"]


def _some(names: Iterable[str]) -> str:
    listed = list(names)
    more = f" and {len(listed) - SHOWN} more" if len(listed) > SHOWN else ""
    return ", ".join(listed[:SHOWN]) + more
