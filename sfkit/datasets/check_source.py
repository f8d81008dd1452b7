"""Check a training set before anything is trained on it: what is there, and whether a sample of it agrees."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from sfkit.datasets import check_sample
from sfkit.datasets.check import DataReport
from sfkit.datasets.photometric import check_ground_truth
from sfkit.datasets.root_folder import open_root
from sfkit.datasets.source_manifests import load_source_manifest
from sfkit.datasets.training_sets import SourcePair, find_source_pairs, nothing_to_train_on
from sfkit.errors import InputError

SAMPLE = 8


def check_training_set(name: str, root: Path | str, *, sample: int = SAMPLE) -> DataReport:
    """Count a training set's pairs under a folder, decode ``sample`` of them, and report.

    Each decoded pair is held against its images: a wrong scale, sign, order or number base shows there.
    A data set that is not there gives a report with a problem, not an error.

    Raises:
        InputError: an unknown name, no such folder, or a camera file that cannot be read.
    """
    manifest, folder = load_source_manifest(name), open_root(root)
    found = find_source_pairs(manifest, folder)
    pairs = (*found.train, *found.held_out)
    problems = [] if found.train else [nothing_to_train_on(manifest, folder, found)]
    warnings: list[str] = []
    notes = [manifest.unknown, f"camera: {manifest.camera}", f"licence: {manifest.licence}"]
    if found.held_out:
        notes.append(f"{len(found.held_out)} pairs of held-out sequences are kept from training")
    if found.withdrawn:
        notes.append(f"{found.withdrawn} pairs stand on the authors' list of unused files and are left out")
    # A sample: training sets have tens of thousands of pairs.
    for pair in _spread(pairs, sample):
        try:
            loaded = pair.load()
        except InputError as error:
            problems.append(f"{pair.id}: {error}")
            continue
        problems += [f"{pair.id}: {text}" for text in check_sample.problems(loaded)]
        doubts = (*check_sample.warnings(loaded), *check_sample.unexplained(loaded))
        warnings += [f"{pair.id}: {text}" for text in doubts]
        known = np.isfinite(loaded.disparity)
        if known.any():
            seen = check_ground_truth(loaded.left, loaded.right, loaded.disparity)
            low, high = float(loaded.disparity[known].min()), float(loaded.disparity[known].max())
            notes.append(
                f"{pair.id}: {100 * known.mean():.1f} % known, {low:.2f} to {high:.2f} px, "
                f"{seen.residual:.1f} % of census bits differ"
            )
    return DataReport(
        name=name,
        root=str(folder),
        found=len(found.train),
        expected=manifest.pairs,
        incomplete=dict(list(found.incomplete.items())[:SAMPLE]),
        problems=tuple(problems),
        warnings=tuple(warnings),
        notes=tuple(notes),
    )


def _spread(pairs: Sequence[SourcePair], count: int) -> Sequence[SourcePair]:
    """At most ``count`` of the pairs, evenly spread."""
    if len(pairs) <= count:
        return pairs
    # The first and the last are among them.
    return [pairs[round(i * (len(pairs) - 1) / max(count - 1, 1))] for i in range(count)]
