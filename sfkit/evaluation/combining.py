"""Several validation benchmarks as one guide; unlike metrics by their change, in units of its spread."""

from __future__ import annotations

import math
import statistics
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from sfkit.datasets.benchmark import Benchmark
from sfkit.datasets.metric import Metric
from sfkit.errors import InputError
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.outcome import Outcome, Part, Scorer, total_known
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe

LABEL = "change against uniform, in standard deviations over its images"


@dataclass(frozen=True)
class Yardstick:
    """What a benchmark's scores are measured against.

    Attributes:
        uniform: the score of the uniform merge, in the metric's unit.
        spread: standard deviation of its per-image values over the benchmark's images, in the same unit.
    """

    uniform: float
    spread: float

    def change(self, score: float) -> float:
        """A score as a number of spreads above the uniform merge's; below 0 is better."""
        return (score - self.uniform) / self.spread


class Changes:
    """The yardsticks of several benchmarks, made when the first score is asked for.

    Benchmarks of one image, or whose images all score alike, have no spread.

    Args:
        evaluators: one for each benchmark; the uniform merge is that of their pool.

    Raises:
        InputError: a benchmark has fewer than two images.
    """

    def __init__(self, evaluators: Sequence[Evaluator]) -> None:
        for evaluator in evaluators:
            if len(evaluator.benchmark) < 2:
                raise InputError(
                    f"benchmark {evaluator.benchmark.name!r}: has one pair, expected two or more to combine "
                    f"{evaluator.metric} with another metric in units of the spread over pairs: add some, or "
                    "guide by one metric"
                )
        self._evaluators = tuple(evaluators)
        self._made: tuple[Yardstick, ...] = ()
        self._lock = threading.Lock()

    def yardsticks(self) -> tuple[Yardstick, ...]:
        """One a benchmark.

        Raises:
            InputError: the uniform merge failed, or scores alike on all images of a benchmark.
        """
        with self._lock:
            # Two threads may ask for the first score at once; the uniform merge runs once.
            if not self._made:
                self._made = tuple(_yardstick(evaluator) for evaluator in self._evaluators)
        return self._made


def _yardstick(evaluator: Evaluator) -> Yardstick:
    (evaluation,) = evaluator.evaluate([evaluator.pool.uniform()])
    if evaluation.failure:
        raise InputError(
            f"benchmark {evaluator.benchmark.name!r}: the uniform merge failed "
            f"({evaluation.failure}), expected a score that others are compared with: guide by one metric"
        )
    # Over single images, whatever the protocol pools: how far this benchmark's pairs scatter.
    spread = statistics.stdev(image.value(evaluator.metric) for image in evaluation.images)
    if spread == 0:
        raise InputError(
            f"benchmark {evaluator.benchmark.name!r}: the uniform merge has the same {evaluator.metric} on "
            "all pairs, expected a spread to measure changes in: guide by one metric"
        )
    return Yardstick(evaluator.score(evaluation.images), spread)


class CombinedScorer:
    """One score from several benchmarks: their mean, or the worst of them.

    Where some are measured against ground truth and some by ``census``, what is combined are changes against
    the uniform merge, each in units of its spread over images (:class:`Changes`).

    Args:
        evaluators: one for each validation benchmark.
        how: ``"mean"`` or ``"worst"``. Metrics that are not combined by changes must have one unit.
        changes: the yardsticks of unlike metrics; made of the evaluators unless given.

    Raises:
        InputError: no evaluator, another word than these, or metrics of different units.
    """

    def __init__(
        self, evaluators: Sequence[Scorer], how: str = "mean", changes: Changes | None = None
    ) -> None:
        if how not in ("mean", "worst"):
            raise InputError(f"validation: found {how!r}, expected 'mean' or 'worst' of the benchmarks")
        if not evaluators:
            raise InputError("validation: found no benchmark, expected at least one")
        known = [e for e in evaluators if isinstance(e, Evaluator)]
        # A census residual and an error by ground truth do not add, though both may be in percent.
        if changes is None and len({e.metric.needs_truth for e in known}) > 1:
            changes = Changes(known)
        units = {e.metric.unit for e in known}
        if changes is None and len(units) > 1:
            raise InputError(
                f"validation: metrics in {' and '.join(sorted(units))}, expected one unit to combine"
            )
        self.evaluators = tuple(evaluators)
        self.how = how
        self.changes = changes

    def __call__(self, recipes: Sequence[Recipe]) -> list[Outcome]:
        """One outcome a recipe: failed where any benchmark failed or said NaN, cached where all were."""
        # Benchmark by benchmark, not recipe by recipe: an engine shares all of them out among its workers.
        table = [evaluator(recipes) for evaluator in self.evaluators]
        return [self._combine([row[n] for row in table]) for n in range(len(recipes))]

    def with_pool(self, pool: Pool) -> CombinedScorer:
        """The same on another pool; see :meth:`Evaluator.with_pool`."""
        return self.over([e.with_pool(pool) if isinstance(e, Evaluator) else e for e in self.evaluators])

    def over(self, evaluators: Sequence[Scorer]) -> CombinedScorer:
        """The same rule and yardsticks over other views of the same benchmarks."""
        return CombinedScorer(evaluators, self.how, self.changes)

    def release(self) -> None:
        """Let go of all networks and workers."""
        for evaluator in self.evaluators:
            if isinstance(evaluator, Evaluator):
                evaluator.release()

    def _combine(self, outcomes: Sequence[Outcome]) -> Outcome:
        scores = [outcome.score for outcome in outcomes]
        return Outcome(
            # NaN is a failure here; combined() would take it for a benchmark without images in a split.
            math.nan if any(map(math.isnan, scores)) else self.combined(scores),
            math.fsum(outcome.seconds for outcome in outcomes),
            all(outcome.cached for outcome in outcomes),
            next((outcome.error for outcome in outcomes if outcome.error), None),
            "+".join(outcome.key for outcome in outcomes),
            self._parts(outcomes),
            total_known(outcome.cpu_seconds for outcome in outcomes),
        )

    def _parts(self, outcomes: Sequence[Outcome]) -> tuple[Part, ...]:
        if any(outcome.failed for outcome in outcomes):
            return ()
        return tuple(
            Part(
                self.combined([part.guiding for part in split]), self.combined([part.held for part in split])
            )
            for split in zip(*(outcome.parts for outcome in outcomes), strict=True)
        )

    def combined(self, scores: Sequence[float]) -> float:
        """Mean or worst of the benchmarks that have a score; NaN stands for one without an image there."""
        if self.changes is not None:
            yardsticks = self.changes.yardsticks()
            scores = [stick.change(score) for stick, score in zip(yardsticks, scores, strict=True)]
        known = [score for score in scores if not math.isnan(score)]
        if not known:
            return math.nan
        return max(known) if self.how == "worst" else math.fsum(known) / len(known)


def evaluators_of(scorer: Scorer) -> tuple[Evaluator, ...]:
    """The evaluator, or those that are combined; a scorer of another kind is none."""
    parts = scorer.evaluators if isinstance(scorer, CombinedScorer) else (scorer,)
    return tuple(part for part in parts if isinstance(part, Evaluator))


def only_evaluators(scorer: Scorer) -> tuple[Evaluator, ...]:
    """The evaluators of a scorer that is made of nothing else; none of any other."""
    found = evaluators_of(scorer)
    parts = len(scorer.evaluators) if isinstance(scorer, CombinedScorer) else 1
    return found if len(found) == parts else ()


def evaluators_for(setting: str, scorer: Scorer) -> tuple[Evaluator, ...]:
    """The evaluators of a scorer that knows its images, as ``setting`` wants it.

    Raises:
        InputError: a scorer of another kind.
    """
    if known := only_evaluators(scorer):
        return known
    raise InputError(
        f"{setting}: found a scorer of the kind {type(scorer).__name__}, expected an Evaluator or a "
        f"CombinedScorer of them, which know their images: leave {setting} at 0"
    )


def combined(evaluators: Sequence[Evaluator], how: str = "mean") -> Evaluator | CombinedScorer:
    """What validation benchmarks say together: of one it is the evaluator itself."""
    return evaluators[0] if len(evaluators) == 1 else CombinedScorer(evaluators, how)


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
    if guides and len({Metric.parse(guide.metric).needs_truth for guide in guides}) == 1:
        options = {"metric": guides[0].metric, **options}
    return combined([Evaluator(pool, guide, **options) for guide in guides], how)
