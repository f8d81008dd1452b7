"""A model of the score over recipes: what it sees of a recipe, what it learned from, what it foretells."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from sfkit.evaluation.known import Known
from sfkit.merging.recipe import Recipe
from sfkit.search.gaussian_process import Array, GaussianProcess, Points, fit, log_evidence
from sfkit.search.records import Candidate

TIED = 1e-9  # a group of features that differ by less, which is rounding, says nothing
LARGEST = 400
"""The most points a model learns from, the best ones; its cost grows with the cube of their number."""


@dataclass(frozen=True)
class Prediction:
    """What the model said of a candidate before it was scored.

    Attributes:
        mean: expected score, in the metric's unit.
        sd: standard deviation of that, in the same unit.
        acquisition: lower confidence bound it was chosen by, the smallest of those drawn: mean - beta * sd,
            in Stage 2 of scores as its model bends them.
    """

    mean: float
    sd: float
    acquisition: float

    def as_record(self) -> dict[str, float]:
        """Plain values for the history and the journal."""
        return {"predicted_mean": self.mean, "predicted_sd": self.sd, "acquisition": self.acquisition}


UNPREDICTED = Prediction(math.nan, math.nan, math.nan)
PREDICTED = tuple(UNPREDICTED.as_record())
"""Columns that histories of searches by a model have besides, in the score's unit."""


@dataclass(frozen=True, kw_only=True)
class Proposed(Candidate):
    """A candidate, and what the model said of it before.

    Attributes:
        prediction: of the score, the bound with the penalties; None where no model proposed it.
    """

    prediction: Prediction | None = None

    def as_record(self) -> dict[str, Any]:
        """Plain values for the history and the journal; NaN where no model proposed it."""
        return {**super().as_record(), **(self.prediction or UNPREDICTED).as_record()}


def known_records(known: Iterable[Known]) -> list[dict[str, Any]]:
    """What a model knew before a search began, as plain values for the journal."""
    return [{"subset": entry.recipe.sources, "score": entry.score, "origin": entry.origin} for entry in known]


def features(rows: Array, scales: Array) -> Points:
    """What the model sees of m recipes: groups that have a length scale each.

    Args:
        rows: routing weights, (m, B, N).
        scales: module scales, (m, B).

    Returns:
        Weights at the mean over blocks (m, N), what each block's differ from it by (m, B * N), and scales
        (m, B), the latter two divided by sqrt(B). All subsets differ in the first group alone.
    """
    count, blocks, sources = rows.shape
    mean = rows.mean(axis=1)
    # By sqrt(B), so that a length scale means the same for any number of blocks.
    apart = (rows - mean[:, None, :]).reshape(count, blocks * sources) / math.sqrt(blocks)
    return mean, apart, scales / math.sqrt(blocks)


def by_block(rows: Array, scales: Array) -> Points:
    """What the model of Stage 2 sees of m recipes: a group for each block, that of its coefficients.

    A block's merged task vector is the sum of its sources' by scale times weight, so that two recipes are as
    near in a block as these are; each block has a length scale of its own, as it changes the score.

    Args:
        rows: routing weights, (m, B, N).
        scales: module scales, (m, B).

    Returns:
        B groups, (m, N).
    """
    return tuple(np.moveaxis(rows * scales[:, :, None], 1, 0))


def apart(rows: Array, scales: Array) -> Points:
    """Weights and scales apart: what the model of Stage 2 sees of m recipes whose blocks share their weights.

    One row of weights moves the coefficients of all blocks at once; seen by these (:func:`by_block`), a step
    along it is a step in every block, however little the score asks for the weights.

    Args:
        rows: routing weights, (m, B, N).
        scales: module scales, (m, B).

    Returns:
        Weights at the mean over blocks (m, N), what each block's differ from it by (m, B * N) as in
        :func:`features`, and B groups of one scale, (m, 1).
    """
    mean, differences, _ = features(rows, scales)
    return (mean, differences, *(scales[:, [block]] for block in range(scales.shape[1])))


def recipe_features(recipes: Iterable[Recipe], sources: Sequence[str], blocks: Sequence[str]) -> Points:
    """The features of recipes over some of these sources, as :func:`features`."""
    return features(*rows_and_scales(recipes, sources, blocks))


def routing_points(rows: Array, scales: Array, *, tied: bool) -> Points:
    """What the model of Stage 2 sees of m recipes: :func:`by_block`, before it :func:`apart` where tied."""
    blockwise = by_block(rows, scales)
    return (*apart(rows, scales), *blockwise) if tied else blockwise


def routing_views(blocks: int, *, tied: bool) -> tuple[tuple[int, ...], ...]:
    """The groups of :func:`routing_points` that a model of Stage 2 may look at: one way, or the other."""
    first = 2 + blocks if tied else 0
    blockwise = tuple(range(first, first + blocks))
    return (tuple(range(first)), blockwise) if tied else (blockwise,)


def routing_features(
    recipes: Iterable[Recipe], sources: Sequence[str], blocks: Sequence[str], *, tied: bool
) -> Points:
    """The features of recipes over some of these sources, as :func:`routing_points`."""
    return routing_points(*rows_and_scales(recipes, sources, blocks), tied=tied)


def rows_and_scales(
    recipes: Iterable[Recipe], sources: Sequence[str], blocks: Sequence[str]
) -> tuple[Array, Array]:
    """Routing weights (m, B, N) and module scales (m, B) of recipes over some of these sources."""
    # By name: a recipe may list its blocks in an order of its own.
    parts = [recipe.over(sources, blocks) for recipe in recipes]
    rows, scales = (np.array([part[n] for part in parts], dtype=np.float64) for n in (0, 1))
    # Of no recipe at all the axes are there too.
    shape = (len(parts), len(blocks), len(sources))
    return rows.reshape(shape), scales.reshape(shape[:2])


@dataclass(frozen=True)
class Bend:
    """Scores above a knee drawn together logarithmically: how bad a bad one is says little of the good ones.

    Attributes:
        knee: up to here scores stay as they are.
        unit: above 0; so far above the knee a step counts half.
    """

    knee: float = math.inf
    unit: float = 1.0

    def __call__(self, scores: Array) -> Array:
        """Bent scores."""
        over = np.maximum(scores - self.knee, 0.0)
        return np.minimum(scores, self.knee) + self.unit * np.log1p(over / self.unit)

    def undone(self, bent: Array) -> Array:
        """Scores again."""
        over = np.maximum(bent - self.knee, 0.0)
        return np.minimum(bent, self.knee) + self.unit * np.expm1(over / self.unit)

    def slope(self, bent: Array) -> Array:
        """What one unit of the bent score is there, in scores."""
        return np.exp(np.maximum(bent - self.knee, 0.0) / self.unit)


@dataclass(frozen=True)
class Surrogate:
    """A Gaussian process over the feature groups in which its points differ.

    Attributes:
        process: the fitted model.
        groups: the feature groups it looks at.
        bend: of the scores it learned from.
    """

    process: GaussianProcess
    groups: tuple[int, ...]
    bend: Bend = Bend()

    def predict(self, points: Points) -> tuple[Array, Array]:
        """Mean and standard deviation of m recipes' scores, in the metric's unit."""
        mean, sd = self.process.predict(self._seen(points))
        return self.bend.undone(mean), sd * self.bend.slope(mean)

    def believing(self, points: Points) -> Surrogate:
        """The same, believing its own mean at these points."""
        return replace(self, process=self.process.believing(self._seen(points)))

    def bounds(self, points: Points, beta: float) -> tuple[Array, Array, Array]:
        """Mean, standard deviation and lower confidence bound mean - beta * sd, (m,) each.

        The bound is taken of bent scores, and rounded to some 9 digits of the signal's deviation, so that
        what differs by rounding alone ties, and a tie goes to the earlier.
        """
        mean, sd = self.process.predict(self._seen(points))
        unit = 1e-9 * math.sqrt(self.process.variance)
        bound = np.round((mean - beta * sd) / unit) * unit
        return self.bend.undone(mean), sd * self.bend.slope(mean), self.bend.undone(bound)

    def _seen(self, points: Points) -> Points:
        return tuple(points[group] for group in self.groups)


def learned(
    points: Points,
    scores: Array,
    *,
    knee: float = math.inf,
    like: Surrogate | None = None,
    views: Sequence[tuple[int, ...]] = (),
) -> Surrogate:
    """The model of what was scored; a score that is not finite counts as the worst that is.

    Args:
        points: features of n >= 2 recipes.
        scores: (n,), at least one of them finite.
        knee: scores above are drawn together (:class:`Bend`), by what the best lies below it.
        like: a model whose length scales and noise are taken, rather than fitted.
        views: sets of feature groups, of which the one of highest evidence is looked at, the earlier one of a
            tie; all groups without one.
    """
    finite = np.isfinite(scores)
    values = np.where(finite, scores, np.max(scores[finite]))
    # The best ones, in the order they came: sums then have one order.
    kept = np.sort(np.argsort(values, kind="stable")[:LARGEST])
    chosen = tuple(group[kept] for group in points)
    bend = _bend(values, knee)
    if like is not None:
        told = tuple(chosen[g] for g in like.groups)
        return Surrogate(fit(told, bend(values[kept]), like=like.process), like.groups, bend)
    # Where no point differs in a group its length scale has no bearing on the evidence: a climb along it
    # would find ties alone.
    spread = [float(np.max(np.ptp(group, axis=0), initial=0.0)) for group in chosen]
    bent = bend(values[kept])
    found = []
    for view in views or (tuple(range(len(chosen))),):
        groups = tuple(g for g in view if spread[g] > TIED) or view[:1]
        found.append(Surrogate(fit(tuple(chosen[g] for g in groups), bent), groups, bend))
    if len(found) == 1:
        return found[0]
    # Rounded, as bounds are: the last bit of a sum is the processor's, and a tie goes to the earlier view.
    return max(found, key=lambda one: float(f"{log_evidence(one.process, bent):.9g}"))


def _bend(values: Array, knee: float) -> Bend:
    """What bends above the knee by what the best gains on it, or a twentieth of it where that is more."""
    unit = max(knee - float(values.min()), 0.05 * abs(knee))
    return Bend(knee, unit) if 0.0 < unit < math.inf else Bend()
