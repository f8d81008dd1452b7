"""Which pairs lie under a root: found by a data set's manifest, and nothing outside the root."""

from __future__ import annotations

import re
import warnings
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PurePosixPath
from typing import Any

from sfkit.datasets.manifests import ID, RESOLUTION, Manifest, PairLayout
from sfkit.datasets.pairs import StereoPair
from sfkit.datasets.root_folder import inside
from sfkit.errors import SfkitWarning

NEEDED = ("left", "right", "disparity")


@dataclass(frozen=True)
class PairListing:
    """What lies under a root.

    Attributes:
        pairs: the complete pairs, sorted by id.
        missing: the files that incomplete pairs lack, by id, relative to the root where they have a place.
        notes: what a reader of results should know.
        strange: a sentence each on what looks like a pair and could not be read as one.
    """

    pairs: tuple[StereoPair, ...]
    missing: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    strange: tuple[str, ...] = ()


def warn_of_incomplete(name: str, found: PairListing) -> None:
    """Say which pairs cannot take part, so that a score of the others is not taken for one of all.

    Warns (:class:`~sfkit.errors.SfkitWarning`) with their names and what they lack.
    """
    if found.missing:
        first = [f"{pair} (no {', '.join(files)})" for pair, files in list(found.missing.items())[:3]]
        more = f" and {len(found.missing) - 3} more" if len(found.missing) > 3 else ""
        warnings.warn(
            f"benchmark {name!r}: {len(found.missing)} pairs are incomplete and left out: {'; '.join(first)}"
            f"{more}; {len(found.pairs)} are scored",
            SfkitWarning,
            stacklevel=4,
        )
    for note in found.strange:
        warnings.warn(f"benchmark {name!r}: {note}", SfkitWarning, stacklevel=4)


def find_pairs(manifest: Manifest, root: Path, resolution: str | None) -> PairListing:
    """The pairs of a data set under ``root``: of the first layout that has a complete one.

    Where none is complete, the pairs of the first layout that has any left image are listed as missing.

    Raises:
        InputError: a file leads outside the root.
    """
    fallback = PairListing(())
    for place in manifest.places:
        for layout in manifest.layouts:
            found = _find(layout, root, place, resolution)
            if found.pairs:
                return found
            # Remembered for the refusal, should no layout have a complete pair.
            if found.missing and not fallback.missing:
                fallback = found
    return fallback


def nothing_found(manifest: Manifest, root: Path, resolution: str | None, found: PairListing) -> str:
    """The sentence for a root without one complete pair: what was looked for, what lacks, what to do."""
    if found.missing:
        name, files = next(iter(found.missing.items()))
        what = f"no complete pair, left images only: {name!r} lacks {', '.join(files)}"
    else:
        first = _fill(manifest.layouts[0].left, manifest.ids[0], resolution)
        what = f"no pair, expected files such as {first}"
    return f"{manifest.name}: under {root} found {what}; {manifest.get} ({manifest.home})"


def _find(layout: PairLayout, root: Path, place: str, resolution: str | None) -> PairListing:
    pairs, missing = [], {}
    for name in _ids(layout, root, place, resolution):
        files = {
            role: inside(root, PurePosixPath(place, _fill(pattern, name, resolution)))
            for role, pattern in layout.patterns().items()
        }
        lacking = tuple(
            files[role].relative_to(root).as_posix() for role in NEEDED if not files[role].is_file()
        )
        if lacking:
            missing[name] = lacking
        else:
            # What a pair may lack, mask and calibration, is left out where it is absent.
            there: dict[str, Any] = {role: path for role, path in files.items() if path.is_file()}
            pairs.append(StereoPair(name, coding=layout.coding, mask_coding=layout.mask_coding, **there))
    return PairListing(tuple(pairs), missing, (layout.note,) if layout.note else ())


def _ids(layout: PairLayout, root: Path, place: str, resolution: str | None) -> list[str]:
    """The names that take the place of ``{id}`` in the left image's pattern, sorted."""
    parts = PurePosixPath(place, _fill(layout.left, ID, resolution)).parts
    at = next(i for i, part in enumerate(parts) if ID in part)
    folder = inside(root, PurePosixPath(*parts[:at]))
    if not folder.is_dir():
        return []
    before, _, after = parts[at].partition(ID)
    # Names are matched on disk, not taken from the manifest: what is there beyond the list is told.
    wanted = re.compile(f"{re.escape(before)}({layout.id}){re.escape(after)}")
    names = (wanted.fullmatch(entry.name) for entry in folder.iterdir())
    rest = parts[at + 1 :]
    return sorted(m[1] for m in names if m and (folder / m[0]).joinpath(*rest).is_file())


def _fill(pattern: str, name: str, resolution: str | None) -> str:
    return pattern.replace(ID, name).replace(RESOLUTION, resolution or "")
