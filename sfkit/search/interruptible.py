"""A scorer that tells how far it is between two evaluations, and can be held or broken off there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Protocol

from sfkit.evaluation.combining import CombinedScorer
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.outcome import Outcome, Scorer
from sfkit.evaluation.store import evaluation_key
from sfkit.merging.recipe import Recipe


class HoldError(Exception):
    """Raised by a monitor to hold: nothing is computed until its ``hold`` returns."""


class Monitor(Protocol):
    """Follows how far a generation is. Both methods may raise to break it off."""

    def report(self, done: int, total: int) -> None:
        """So many of a generation's recipes are done, in the store or computed; may raise HoldError."""

    def hold(self) -> None:
        """Block until it goes on."""


class InterruptibleEvaluator:
    """An evaluator that reports every evaluation; all that was reported is in the store.

    While held the evaluator is free: others may use it.

    Args:
        evaluator: does the work.
        monitor: is told of it.
    """

    def __init__(self, evaluator: Evaluator, monitor: Monitor) -> None:
        self.evaluator = evaluator
        self.monitor = monitor

    def __call__(self, recipes: Sequence[Recipe]) -> list[Outcome]:
        """One outcome a recipe, in order; what was computed before a hold does not count as cached."""
        before: frozenset[str] = frozenset()
        reported = held = False

        def report(done: int, total: int) -> None:
            nonlocal before, reported
            # Whatever is in the store later than now was computed here; seldom is only a part in it.
            if not reported and 0 < done < total:
                before = self._stored(recipes)
            reported = True
            self.monitor.report(done, total)

        # Asked again after a hold: what was computed before it comes out of the store.
        while True:
            try:
                found = self.evaluator.evaluate(recipes, progress=report)
            except HoldError:
                held = True
                self.monitor.hold()
                continue
            outcomes = [self.evaluator.outcome(evaluation) for evaluation in found]
            if not held:
                return outcomes
            return [replace(outcome, cached=outcome.key in before) for outcome in outcomes]

    def _stored(self, recipes: Sequence[Recipe]) -> frozenset[str]:
        keys = (evaluation_key(self.evaluator.describe(recipe)) for recipe in recipes)
        return frozenset(key for key in keys if self.evaluator.store.get(key) is not None)


class _OneOf:
    """Follows the ``number``-th of ``count`` benchmarks: a recipe is done when it is done on all."""

    def __init__(self, monitor: Monitor, number: int, count: int) -> None:
        self._monitor, self._number, self._count = monitor, number, count

    def report(self, done: int, total: int) -> None:
        # Benchmarks come one after the other: of two, half is done when the first one is.
        self._monitor.report((self._number * total + done) // self._count, total)

    def hold(self) -> None:
        self._monitor.hold()


def interruptible(scorer: Scorer, monitor: Monitor) -> Scorer:
    """The same scorer, which reports between two evaluations and can be held there.

    Of several combined benchmarks each reports for itself, one after the other. A scorer of another
    kind is called as a whole, since only it knows how to divide its work.
    """
    if isinstance(scorer, Evaluator):
        return InterruptibleEvaluator(scorer, monitor)
    if isinstance(scorer, CombinedScorer):
        count = len(scorer.evaluators)
        parts = [interruptible(part, _OneOf(monitor, n, count)) for n, part in enumerate(scorer.evaluators)]
        return scorer.over(parts)
    return scorer


def metric_of(scorer: Scorer) -> str | None:
    """The name of the metric of the scores, such as ``bad-1.0``; None where the scorer does not say."""
    if isinstance(scorer, CombinedScorer):
        names = {metric_of(evaluator) for evaluator in scorer.evaluators}
        return names.pop() if len(names) == 1 else None
    return scorer.metric.name if isinstance(scorer, Evaluator) else None
