"""Searches for the tests of the widgets: scores from a formula, and a gate before every generation."""

from __future__ import annotations

import threading
from collections.abc import Sequence
from pathlib import Path

from sfkit import Journal, Outcome, Recipe, RoutingSearch, RoutingSettings, SubsetSearch, SubsetSettings
from sfkit.search.bayesian_routing import BayesianRoutingSearch
from sfkit.search.bayesian_settings import BayesianRoutingSettings, BayesianSubsetSettings
from sfkit.search.bayesian_subset import BayesianSubsetSearch

SOURCES = ("haze", "indoor", "night", "rain", "street")
BLOCKS = ("backbone", "volume", "head")
WORTH = dict(zip(SOURCES, (3.0, 0.5, 7.0, 2.0, 1.0), strict=True))


class GatedScorer:
    """Scores recipes by a formula, each call with a permit; ``broken`` makes it raise.

    ``inside`` is set while a call waits. Subsets of four sources fail, so that a failure is always on show.
    """

    def __init__(self, permits: int = 0) -> None:
        self.gate = threading.Semaphore(permits)
        self.inside = threading.Event()
        self.broken = False

    def __call__(self, recipes: Sequence[Recipe]) -> list[Outcome]:
        """One outcome a recipe, in order."""
        self.inside.set()
        if not self.gate.acquire(timeout=600):
            raise TimeoutError("nobody opened the gate")
        self.inside.clear()
        if self.broken:
            raise OSError("the disk is full")
        return [self.outcome(recipe) for recipe in recipes]

    def outcome(self, recipe: Recipe) -> Outcome:
        """The mean of what the sources are worth, and how far the scales are from 1.1."""
        if len(recipe.sources) == 4:
            return Outcome(float("inf"), 0.5, error="out of memory")
        worth = 0.0
        for weights, scale in zip(recipe.weights, recipe.scales, strict=True):
            mixed = sum(w * WORTH[name] for w, name in zip(weights, recipe.sources, strict=True))
            worth += mixed + (scale - 1.1) ** 2
        return Outcome(worth / len(recipe.blocks), 0.5)

    def open(self, generations: int = 1000) -> None:
        """Let so many more generations pass."""
        self.gate.release(generations)


def subset_search(permits: int = 0, journal: Path | str | None = None) -> tuple[SubsetSearch, GatedScorer]:
    """Stage 1 with 6 individuals and 5 generations after the first."""
    scorer = GatedScorer(permits)
    settings = SubsetSettings(population=6, generations=5, seed=4)
    written = None if journal is None else Journal(journal)
    return SubsetSearch(SOURCES, BLOCKS, scorer, settings, journal=written), scorer


def searches_by_model(
    journal: Path | str | None = None,
) -> tuple[BayesianSubsetSearch, BayesianRoutingSearch]:
    """Both stages by a model, of the same formula, done."""
    scorer = GatedScorer(100)
    written = None if journal is None else Journal(journal)
    settings = BayesianSubsetSettings(population=4, generations=6)
    first = BayesianSubsetSearch(SOURCES, BLOCKS, scorer, settings, journal=written)
    budget = BayesianRoutingSettings(evaluations=10)
    second = BayesianRoutingSearch(SOURCES[:3], BLOCKS, scorer, budget, journal=written)
    first.run()
    second.run()
    return first, second


def routing_search(
    permits: int = 0, journal: Path | str | None = None, *, tied: bool = False
) -> tuple[RoutingSearch, GatedScorer]:
    """Stage 2 over three sources with 40 evaluations."""
    scorer = GatedScorer(permits)
    settings = RoutingSettings(evaluations=40, seed=4, tied=tied)
    written = None if journal is None else Journal(journal)
    return RoutingSearch(SOURCES[:3], BLOCKS, scorer, settings, journal=written), scorer
