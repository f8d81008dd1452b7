"""A search by a model in numbers: what the model foretold of each proposal, what came, how sure it may be."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from statistics import NormalDist
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.special import bdtr

from sfkit.errors import InputError
from sfkit.search.base import Search
from sfkit.search.bayesian_routing import BayesianRoutingSearch
from sfkit.search.bayesian_subset import BayesianSubsetSearch
from sfkit.search.journal import JournalledSearch, journalled_score
from sfkit.search.operators import SMALLEST
from sfkit.search.subset import SubsetSearch

Floats = NDArray[np.float64]

LEVELS = (0.5, 0.8, 0.9, 0.95, 0.99)
"""Of the intervals whose coverage is counted."""


@dataclass(frozen=True, eq=False)
class Predictions:
    """Every proposal of a model in a search, in order; n of them, none in a search by the paper's method.

    Attributes:
        metric: of the scores, such as ``bad-1.0``; None where it is not known.
        number: (n,) of the candidates.
        mean: (n,) the score the model expected, before it was measured.
        sd: (n,) standard deviation of that, of the score without its noise, in the same unit.
        bound: (n,) what the proposal was chosen by, the smallest there was: mean - beta * sd, and in Stage 2
            the penalties.
        score: (n,) measured; ``inf`` where the candidate failed.
        best: (n,) the best the search had found before each; ``inf`` where nothing.
        learned: evaluations of other searches that the model knew from the beginning.
        by_model: whether a model proposes at all.
    """

    metric: str | None
    number: NDArray[np.int64]
    mean: Floats
    sd: Floats
    bound: Floats
    score: Floats
    best: Floats
    learned: int
    by_model: bool = True

    def __len__(self) -> int:
        return len(self.number)

    @property
    def measured(self) -> NDArray[np.bool_]:
        """(n,) which proposals have a finite score."""
        return np.isfinite(self.score)


@dataclass(frozen=True, eq=False)
class PredictionCalibration:
    """How what a model foretold compares with what came; m proposals with a finite score.

    Proposals are chosen where the model expects little, so that it errs there on the hopeful side more often
    than at random places: a mean error above 0 is no surprise.

    Attributes:
        metric: of the scores; None where it is not known.
        number: (m,) of the candidates.
        mean: (m,) predicted.
        sd: (m,) standard deviation of that.
        score: (m,) measured.
        failed: proposals without a finite score, which are left out.
        levels: of the intervals mean ± q * sd, normal, in (0, 1).
        coverage: for each level, the share of measured scores inside.
        honest: for each level, the ends of the range in which the coverage of a model that is right would lie
            in 95 of 100 searches (binomial) that propose one at a time on scores without noise: with noise,
            or in batches, whose earlier proposals it believes unheard, more lie outside.
        error: mean of measured - predicted, in the metric's unit.
        rms: root mean square of the same.
        correlation: of predicted and measured; NaN below three proposals, or where one of them is constant.
    """

    metric: str | None
    number: NDArray[np.int64]
    mean: Floats
    sd: Floats
    score: Floats
    failed: int
    levels: tuple[float, ...]
    coverage: tuple[float, ...]
    honest: tuple[tuple[float, float], ...]
    error: float
    rms: float
    correlation: float


def predictions(search: Search[Any], *, metric: str | None = None) -> Predictions:
    """What the model of a running or finished search foretold; nothing where no model proposes.

    Args:
        search: of either stage.
        metric: what the scores are, for labels.
    """
    if not isinstance(search, BayesianSubsetSearch | BayesianRoutingSearch):
        return _told(search.kind, [], metric, None)
    entries = [candidate.as_record() for candidate in search.candidates]
    return _told(search.kind, entries, metric, search.known)


def watched_predictions(
    records: Iterable[Mapping[str, Any]], search: str, *, metric: str | None = None
) -> Predictions:
    """The same of a search that runs elsewhere, from its journal; nothing in a journal from before models.

    Args:
        records: what :func:`~sfkit.search.journal.read_journal` returned.
        search: ``subset`` or ``routing``.
        metric: what the scores are, for labels.

    Raises:
        InputError: the journal holds no generation of that search.
    """
    found = JournalledSearch.begun(records, search)
    known = found.start.get("known", ()) if found.by_model else None
    return _told(found.kind, found.candidates, metric, known)


def calibration(told: Predictions, levels: Sequence[float] = LEVELS) -> PredictionCalibration:
    """Compare what was foretold with what came.

    Args:
        told: with at least one proposal that has a finite score.
        levels: of the intervals, each in (0, 1).

    Raises:
        InputError: no such proposal, or a level out of its range.
    """
    if wrong := [level for level in levels if not 0.0 < level < 1.0]:
        raise InputError(f"levels: found {wrong[0]!r}, expected shares between 0 and 1, such as 0.95")
    kept = told.measured
    if not kept.any():
        raise InputError(
            "predictions: found no scored proposal of a model, expected at least one: search with "
            "BayesianSubsetSearch or BayesianRoutingSearch (--method bayesian)"
        )
    mean, sd, score = told.mean[kept], told.sd[kept], told.score[kept]
    apart = score - mean
    # Two tails: half of what is left out lies beyond each end.
    inside = [np.abs(apart) <= NormalDist().inv_cdf((1.0 + level) / 2.0) * sd for level in levels]
    return PredictionCalibration(
        metric=told.metric,
        number=told.number[kept],
        mean=mean,
        sd=sd,
        score=score,
        failed=int((~kept).sum()),
        levels=tuple(float(level) for level in levels),
        coverage=tuple(float(within.mean()) for within in inside),
        honest=tuple(_honest(float(level), len(score)) for level in levels),
        error=float(apart.mean()),
        rms=float(np.sqrt(np.mean(apart**2))),
        correlation=_correlation(mean, score),
    )


def _told(
    kind: str, entries: Sequence[Mapping[str, Any]], metric: str | None, known: Sequence[object] | None
) -> Predictions:
    rows: list[tuple[float, ...]] = []
    best = math.inf
    for entry in entries:
        score = journalled_score(entry)
        if (expected := entry.get("predicted_mean")) is not None and math.isfinite(expected):
            told = float(expected), float(entry["predicted_sd"]), float(entry["acquisition"])
            rows.append((entry["candidate"], *told, score, best))
        if kind != SubsetSearch.kind:
            # Stage 2 is led by the score with its penalties.
            score = journalled_score(entry, "penalised")
        elif len(entry["subset"]) < SMALLEST:  # a source alone teaches the model and wins nothing
            continue
        best = min(best, score)
    # The shape is given: without a row there would be no columns to unpack.
    number, mean, sd, bound, measured, before = np.array(rows, dtype=np.float64).reshape(len(rows), 6).T
    return Predictions(
        metric=metric,
        number=number.astype(np.int64),
        mean=mean,
        sd=sd,
        bound=bound,
        score=measured,
        best=before,
        learned=len(known or ()),
        by_model=known is not None,
    )


def _honest(level: float, count: int) -> tuple[float, float]:
    """Ends of the middle 95 % of a binomial share."""
    # The binomial's distribution function at 0 to count; 2.5 % lie beyond each end.
    below = bdtr(np.arange(count + 1), count, level)
    return tuple(float(np.searchsorted(below, tail) / count) for tail in (0.025, 0.975))  # type: ignore[return-value]


def _correlation(one: Floats, other: Floats) -> float:
    # Two points always lie on a line, and a constant has no correlation.
    if len(one) < 3 or np.ptp(one) == 0.0 or np.ptp(other) == 0.0:
        return math.nan
    return float(np.corrcoef(one, other)[0, 1])
