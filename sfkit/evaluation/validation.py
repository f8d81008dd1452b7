"""What guides a search: one benchmark, or several under one rule."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sfkit.datasets.benchmark import Benchmark
from sfkit.evaluation.evaluator import CombinedScorer, Evaluator
from sfkit.merging.pool import Pool


def validation_scorer(
    pool: Pool, benchmarks: Benchmark | Sequence[Benchmark], *, how: str = "mean", **options: Any
) -> Evaluator | CombinedScorer:
    """The scorer of a search over a pool.

    Args:
        pool: whose networks are merged.
        benchmarks: one, or several, each measured by the first one's metric.
        how: of several, their ``"mean"`` or the ``"worst"`` of them.
        options: of each :class:`~sfkit.evaluation.evaluator.Evaluator`, such as ``store``.

    Raises:
        InputError: no benchmark, or another word than these; and as ``Evaluator`` says.
    """
    guides = (benchmarks,) if isinstance(benchmarks, Benchmark) else tuple(benchmarks)
    if len(guides) == 1:
        return Evaluator(pool, guides[0], **options)
    shared = {"metric": guides[0].metric, **options} if guides else options
    return CombinedScorer([Evaluator(pool, guide, **shared) for guide in guides], how)
