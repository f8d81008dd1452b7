"""What a baseline works with: it scores recipes on the validation benchmark, and all it tried is kept."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pandas as pd

from sfkit.evaluation.combining import CombinedScorer, evaluators_of
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.outcome import Outcome, total_known
from sfkit.evaluation.store import BASELINE, evaluation_key
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe

Validation = Evaluator | CombinedScorer
"""Scores recipes on the validation benchmark, or on several."""


class Trials:
    """One run of one method: its pool, its scorer, and a record of everything it tried.

    Attributes:
        pool: base and sources as they were read.
        validation: all a method may tune on.
        seconds: time spent so far: evaluations (those from the store count what they took when they were
            computed) and preparing task vectors.
        cpu_seconds: the same of processors; None once an evaluation's is not known.
    """

    def __init__(self, pool: Pool, validation: Validation) -> None:
        self.pool = pool
        self.validation = validation
        self.seconds = 0.0
        self.cpu_seconds: float | None = 0.0
        self._rows: list[dict[str, Any]] = []
        self._scored: dict[str, Outcome] = {}
        self._passes = 0

    @property
    def evaluations(self) -> int:
        """Distinct recipes that were scored so far, from the store or not."""
        return len(self._scored)

    @property
    def image_passes(self) -> int:
        """Image pairs that went through a network for those evaluations and for gradients."""
        return self.evaluations * sum(len(e.benchmark) for e in evaluators_of(self.validation)) + self._passes

    def score(
        self, recipes: Sequence[Recipe], tried: Sequence[dict[str, Any]] = (), *, pool: Pool | None = None
    ) -> list[float]:
        """Scores on validation, lower is better; ``inf`` where a candidate failed.

        What the store did not hold is marked there as a baseline's, for searches that learn from it.

        Args:
            recipes: what to score.
            tried: what of each recipe goes into the history, such as ``{"lambda": 0.3}``.
            pool: the recipes' pool, where their task vectors were prepared.
        """
        scorer = self.validation if pool is None else self.validation.with_pool(pool)
        # Asked before scoring: only what is computed for it is marked as a baseline's.
        fresh = [
            (evaluator.store, key)
            for evaluator in evaluators_of(scorer)
            for key in (evaluation_key(evaluator.describe(recipe)) for recipe in recipes)
            if evaluator.store.get(key) is None
        ]
        try:
            outcomes = scorer(recipes)
        finally:  # an interrupted batch leaves what it has computed
            for store, key in fresh:
                if store.get(key) is not None:
                    store.mark(key, BASELINE)
        if pool is not None:
            scorer.release()  # each prepared pool has a network of its own: one in memory at a time
        scores = []
        for number, (recipe, outcome) in enumerate(zip(recipes, outcomes, strict=True)):
            score = math.inf if outcome.failed else outcome.score
            scores.append(score)
            self._count(outcome)
            about = tried[number] if tried else {"subset": recipe.sources}
            self._rows.append({**about, "score": score, "error": outcome.error, "cached": outcome.cached})
        return scores

    def adopt(self, history: pd.DataFrame, outcomes: Sequence[Outcome]) -> None:
        """Take over what a search tried and measured."""
        for outcome in outcomes:
            self._count(outcome)
        self._rows += [{str(k): v for k, v in row.items()} for row in history.to_dict(orient="records")]

    def passed(self, image_passes: int) -> None:
        """Count image pairs that went through a network, forwards and backwards, outside evaluations."""
        self._passes += image_passes

    def noted(self, row: dict[str, Any]) -> None:
        """Add a row to the history that is no evaluation."""
        self._rows.append(row)

    @contextmanager
    def timed(self) -> Iterator[None]:
        """Count work that is no evaluation, such as trimming task vectors."""
        started, worked = time.perf_counter(), time.process_time()
        yield
        self.seconds += time.perf_counter() - started
        self.cpu_seconds = total_known([self.cpu_seconds, time.process_time() - worked])

    def history(self) -> pd.DataFrame:
        """What was tried: one row a candidate, in order."""
        return pd.DataFrame(self._rows)

    def _count(self, outcome: Outcome) -> None:
        # By key: a recipe that a method asks for twice cost it one evaluation.
        if outcome.key not in self._scored:
            self._scored[outcome.key] = outcome
            self.seconds += outcome.seconds
            self.cpu_seconds = total_known([self.cpu_seconds, outcome.cpu_seconds])


def lowest(scores: Sequence[float]) -> int:
    """The position of the lowest score, the earlier one of a tie."""
    return min(range(len(scores)), key=lambda n: (scores[n], n))
