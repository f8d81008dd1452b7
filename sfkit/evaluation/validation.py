"""What guides a search: one benchmark, or several under one rule."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from sfkit.datasets.benchmark import Benchmark
from sfkit.datasets.metric import Metric
from sfkit.evaluation.combining import CombinedScorer
from sfkit.evaluation.evaluator import Evaluator
from sfkit.merging.pool import Pool


def validation_scorer(
    pool: Pool, benchmarks: Benchmark | Sequence[Benchmark], *, how: str = "mean", **options: Any
) -> Evaluator | CombinedScorer:
    """The scorer of a search over a pool.

    Args:
        pool: whose networks are merged.
        benchmarks: one, or several, each measured by the first one's metric; those measured
            with ground truth beside one measured without keep their own (see :class:`CombinedScorer`).
        how: of several, their ``"mean"`` or the ``"worst"`` of them.
        options: of each :class:`~sfkit.evaluation.evaluator.Evaluator`, such as ``store``.

    Raises:
        InputError: no benchmark, or another word than these; and as ``Evaluator`` says.
    """
    guides = (benchmarks,) if isinstance(benchmarks, Benchmark) else tuple(benchmarks)
    if len(guides) == 1:
        return Evaluator(pool, guides[0], **options)
    if len({Metric.parse(guide.metric).needs_truth for guide in guides}) == 1:
        options = {"metric": guides[0].metric, **options}
    return CombinedScorer([Evaluator(pool, guide, **options) for guide in guides], how)
