"""What was scored is what was written: a merged file is read back and scored once more after a search."""

from __future__ import annotations

import math
from pathlib import Path

import torch

from sfkit.datasets.digests import file_digest
from sfkit.errors import InputError, SfkitError
from sfkit.evaluation.combining import evaluators_of
from sfkit.evaluation.compute import check_device
from sfkit.evaluation.engines import Worker
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.outcome import Scorer
from sfkit.evaluation.store import evaluation_key
from sfkit.merging.members import PoolOpener
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe

SHARE, LEAST = 1e-3, 0.01
"""How far two scores of the same weights may lie apart: other numbers of threads, a GPU's order of adding."""


def ensure_as_scored(pool: Pool, recipe: Recipe, scorer: Scorer, path: Path) -> None:
    """Compare a merged file with what was scored: its values to the last bit, then its score.

    The score is measured by forward passes over every benchmark of ``scorer`` that this process can run, and
    once for each content of the file: the store remembers that it was.

    Args:
        pool: what was merged.
        recipe: which was scored and written.
        scorer: an evaluator, or several combined; of another kind, the values alone are compared.
        path: the file.

    Raises:
        SfkitError: the file holds other values, or has another score.
    """
    tensors = PoolOpener(pool.architecture, pool.options, pool.specs).read(path, is_base=True).tensors
    merged = pool.layout.views(pool.merge_into(recipe, torch.empty(pool.layout.size)))
    for key, expected in merged.items():
        if key in tensors and not torch.equal(tensors[key].float(), expected):
            raise SfkitError(
                f"{path}: {key!r} is not what was scored, expected the merged values in a data type that "
                "holds them: is the disk failing?"
            )
    for evaluator in evaluators_of(scorer):
        _ensure_scored(evaluator, recipe, path, dict(tensors))


def _ensure_scored(
    evaluator: Evaluator, recipe: Recipe, path: Path, tensors: dict[str, torch.Tensor]
) -> None:
    key, mark = evaluation_key(evaluator.describe(recipe)), f"written as {file_digest(path)}"
    held = evaluator.store.get(key)
    if held is None or key in dict(evaluator.store.marks(mark)) or not _is_here(evaluator):
        return
    if evaluator.compute.kind != "cpu":
        evaluator.release()  # a device may have room for one network; on the CPU workers are worth keeping
    model = evaluator.compute.model(evaluator.pool)
    for name, target in model.network.state_dict(keep_vars=True).items():
        if name in tensors:
            target.data.copy_(tensors[name])
    found = evaluator.score(Worker(model, evaluator.prepared).as_it_is())
    recorded = evaluator.score(held.images)
    if not math.isclose(found, recorded, rel_tol=SHARE, abs_tol=LEAST):  # as two infinities are
        raise SfkitError(
            f"{path}: scores {found:.4f} {evaluator.metric.unit} on {evaluator.benchmark.name} where the "
            f"search found {recorded:.4f}, expected the same: its values are those that were scored, so the "
            "network does not give the same output twice"
        )
    evaluator.store.mark(key, mark)


def _is_here(evaluator: Evaluator) -> bool:
    """Whether this process has the device that the scores come from."""
    try:
        check_device(evaluator.device)
    except InputError:
        return False
    return True
