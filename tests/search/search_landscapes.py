"""Scorers for the tests of the searches: pure Python functions in the place of networks and images."""

from __future__ import annotations

import itertools
import math
import random
from collections.abc import Callable, Iterable, Sequence

import numpy as np

from sfkit.evaluation.outcome import Outcome
from sfkit.merging.recipe import Recipe

BLOCKS = ("backbone", "volume", "head")
Score = Callable[[Recipe], float]


def names(count: int) -> tuple[str, ...]:
    return tuple(f"source{i}" for i in range(count))


def subset_landscape(count: int, seed: int) -> Callable[[Iterable[str]], float]:
    """Distance of the mean of the members' random points to a random target: merging, in small."""
    rng = np.random.default_rng(seed)
    points = dict(zip(names(count), rng.normal(size=(count, 4)), strict=True))
    target = rng.normal(size=4) * 0.3

    def score(subset: Iterable[str]) -> float:
        mean = np.mean([points[name] for name in sorted(subset)], axis=0)
        return float(np.linalg.norm(mean - target))

    return score


def every_subset(count: int) -> list[frozenset[str]]:
    sizes = range(2, count + 1)
    return [frozenset(c) for size in sizes for c in itertools.combinations(names(count), size)]


class Scorer:
    """Scores by a function of the recipe, and keeps what it was asked."""

    def __init__(self, score: Score, *, seconds: float = 0.5) -> None:
        self.score, self.seconds = score, seconds
        self.calls: list[tuple[Recipe, ...]] = []

    @property
    def asked(self) -> list[Recipe]:
        return [recipe for call in self.calls for recipe in call]

    def __call__(self, recipes: Sequence[Recipe]) -> list[Outcome]:
        self.calls.append(tuple(recipes))
        return [self.outcome(recipe) for recipe in recipes]

    def outcome(self, recipe: Recipe) -> Outcome:
        value = self.score(recipe)
        return Outcome(value, seconds=self.seconds, error="out of memory" if math.isinf(value) else None)


class ShufflingScorer(Scorer):
    """Works in a random order, as parallel engines do, and answers in the order asked."""

    def __call__(self, recipes: Sequence[Recipe]) -> list[Outcome]:
        self.calls.append(tuple(recipes))
        order = list(range(len(recipes)))
        random.Random(len(self.calls)).shuffle(order)
        done = {i: self.outcome(recipes[i]) for i in order}
        return [done[i] for i in range(len(recipes))]


class Killed(BaseException):
    """Ends a process in the middle of a generation."""


class StoredScorer(Scorer):
    """A dictionary as the evaluation store; is killed once it has computed ``lives`` evaluations."""

    def __init__(self, score: Score, store: dict[Recipe, Outcome], lives: float = math.inf) -> None:
        super().__init__(score)
        self.store, self.lives = store, lives
        self.computed: list[Recipe] = []

    def __call__(self, recipes: Sequence[Recipe]) -> list[Outcome]:
        self.calls.append(tuple(recipes))
        return [self._stored(recipe) for recipe in recipes]

    def _stored(self, recipe: Recipe) -> Outcome:
        if recipe in self.store:
            found = self.store[recipe]
            return Outcome(found.score, found.seconds, cached=True, error=found.error, key=found.key)
        if len(self.computed) >= self.lives:
            raise Killed
        self.computed.append(recipe)
        self.store[recipe] = self.outcome(recipe)
        return self.store[recipe]
