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
    """Raised by a listener to hold: nothing is computed until its ``hold`` returns."""


class Listener(Protocol):
    """Who hears how far a generation is. Both methods may raise to break it off."""

    def hear(self, done: int, every: int) -> None:
        """So many of a generation's recipes are done, in the store or computed; may raise HoldError."""

    def hold(self) -> None:
        """Block until it goes on."""


class Listening:
    """An evaluator whose every evaluation is heard of; all that was heard of is in the store.

    While held the evaluator is free: others may use it.

    Args:
        evaluator: does the work.
        listener: hears of it.
    """

    def __init__(self, evaluator: Evaluator, listener: Listener) -> None:
        self.evaluator = evaluator
        self.listener = listener

    def __call__(self, recipes: Sequence[Recipe]) -> list[Outcome]:
        """One outcome a recipe, in order; what was computed before a hold does not count as cached."""
        before: frozenset[str] = frozenset()
        heard = held = False

        def hear(done: int, every: int) -> None:
            nonlocal before, heard
            # Whatever is in the store later than now was computed here; seldom is only a part in it.
            if not heard and 0 < done < every:
                before = self._stored(recipes)
            heard = True
            self.listener.hear(done, every)

        while True:
            try:
                found = self.evaluator.evaluate(recipes, progress=hear)
            except HoldError:
                held = True
                self.listener.hold()
                continue
            outcomes = [self.evaluator.outcome(evaluation) for evaluation in found]
            if not held:
                return outcomes
            return [replace(outcome, cached=outcome.key in before) for outcome in outcomes]

    def _stored(self, recipes: Sequence[Recipe]) -> frozenset[str]:
        keys = (evaluation_key(self.evaluator.describe(recipe)) for recipe in recipes)
        return frozenset(key for key in keys if self.evaluator.store.get(key) is not None)


class _Part:
    """Hears of the ``number``-th of ``every`` benchmarks: a recipe is done when it is done on all."""

    def __init__(self, listener: Listener, number: int, every: int) -> None:
        self._listener, self._number, self._every = listener, number, every

    def hear(self, done: int, every: int) -> None:
        self._listener.hear((self._number * every + done) // self._every, every)

    def hold(self) -> None:
        self._listener.hold()


def listening(scorer: Scorer, listener: Listener) -> Scorer:
    """The same scorer, heard of between two evaluations.

    Of several combined benchmarks each is heard of for itself, one after the other. A scorer of another
    kind is called as a whole, since only it knows how to divide its work.
    """
    if isinstance(scorer, Evaluator):
        return Listening(scorer, listener)
    if isinstance(scorer, CombinedScorer):
        every = len(scorer.evaluators)
        parts = [listening(part, _Part(listener, n, every)) for n, part in enumerate(scorer.evaluators)]
        return scorer.over(parts)
    return scorer


def metric_of(scorer: Scorer) -> str | None:
    """The name of the metric of the scores, such as ``bad-1.0``; None where the scorer does not say."""
    if isinstance(scorer, CombinedScorer):
        names = {metric_of(evaluator) for evaluator in scorer.evaluators}
        return names.pop() if len(names) == 1 else None
    return scorer.metric.name if isinstance(scorer, Evaluator) else None
