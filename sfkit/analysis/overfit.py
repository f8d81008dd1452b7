"""Does a search fit its validation pairs? The check within one search, and curves over many."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from sfkit.datasets.metric import Metric
from sfkit.errors import InputError
from sfkit.search.routing import RoutingSearch

Floats = NDArray[np.float64]

ALONG = ("pairs", "evaluations")


@dataclass(frozen=True)
class HoldoutCheck:
    """What a hold-out saw of one Stage 2 search; changes are against x = 0, below 0 where better.

    Attributes:
        guiding: change on the guiding pairs of the candidate that is best there, which a search without a
            hold-out would choose.
        held: change of that same candidate on the pairs held out.
        chosen: change on the pairs held out of the candidate that was chosen.
        folds: over how many splits these are means.
        metric: what the scores are; None where it is not known.
    """

    guiding: float
    held: float
    chosen: float
    folds: int
    metric: str | None = None

    @property
    def overfit(self) -> bool:
        """True where the guiding score falls and the held-out score does not."""
        return self.guiding < 0 <= self.held

    @property
    def sentence(self) -> str:
        """What the check says, for tables and reports."""
        unit = "" if self.metric is None else f" {Metric.parse(self.metric).unit}"
        what = "score" if self.metric is None else self.metric
        guided = f"{what} falls by {-self.guiding:.2f}{unit} on the pairs that guide Stage 2"
        if self.guiding >= 0:
            return f"Stage 2 found nothing better than equal weights ({what} on the pairs that guide it)."
        if self.overfit:
            return (
                f"Warning: {guided} and does not fall on those held out (change {self.held:+.2f}{unit}): "
                "what it gains are these pairs, not the task; the recipe was chosen on the held-out pairs "
                f"instead (change {self.chosen:+.2f}{unit})."
            )
        return f"{guided[0].upper()}{guided[1:]} and by {-self.held:.2f}{unit} on those held out."


def holdout_check(search: RoutingSearch, *, metric: str | None = None) -> HoldoutCheck | None:
    """What a hold-out saw of a search; None without a hold-out, or while x = 0 has no score.

    Args:
        search: of Stage 2, running or finished.
        metric: what the scores are, for the sentence.
    """
    if not search.folds or not search.candidates or search.candidates[0].failed:
        return None
    zero, best = search.candidates[0], search.best
    rows = []
    for fold in range(search.folds):
        at_zero = zero.outcome.parts[fold]
        found = [c for c in search.candidates if c.fold == fold and not c.failed]
        lead = min((zero, *found), key=lambda c: (c.outcome.parts[fold].guiding + c.penalty, c.number))
        chosen = (best or zero).outcome.parts[fold].held
        part = lead.outcome.parts[fold]
        rows.append((part.guiding - at_zero.guiding, part.held - at_zero.held, chosen - at_zero.held))
    guiding, held, chosen = (math.fsum(column) / len(rows) for column in zip(*rows, strict=True))
    return HoldoutCheck(guiding, held, chosen, search.folds, metric)


def holdout_sentence(search: RoutingSearch, *, metric: str | None = None) -> str:
    """What :func:`holdout_check` says of a search, or that no pair was held out from it."""
    check = holdout_check(search, metric=metric)
    if check is not None:
        return check.sentence
    return (
        "No validation pair was held out: whether Stage 2's gain is the task's or these pairs' is not known."
    )


@dataclass(frozen=True, eq=False)
class LearningCurve:
    """Unseen against validation score, along the number of validation pairs or of evaluations.

    T trials, K places. Changes are against x = 0, Stage 1's equal weights; below 0 is better.

    Attributes:
        along: ``pairs`` or ``evaluations``.
        trials: T names.
        places: K numbers, ascending.
        unseen: (T, K) change of the mean over the unseen benchmarks, mean over runs; NaN without a run.
        lowest: (T, K) the least of the runs.
        highest: (T, K) the most of them.
        validation: (T, K) change on all validation pairs, mean over runs; NaN where it was not scored.
        runs: (T, K) how many runs.
        metric: what the scores are.
    """

    along: str
    trials: tuple[str, ...]
    places: tuple[int, ...]
    unseen: Floats
    lowest: Floats
    highest: Floats
    validation: Floats
    runs: NDArray[np.int64]
    metric: str | None = None


def learning_curve(
    table: pd.DataFrame,
    judges: Sequence[str],
    *,
    along: str = "pairs",
    trials: Sequence[str] | None = None,
    metric: str | None = None,
) -> LearningCurve:
    """A curve from tables of :func:`~sfkit.analysis.generalisation.run_trials`.

    Args:
        table: one or several, with a column ``pairs`` for the number of validation pairs.
        judges: the unseen benchmarks to average, by column.
        along: ``pairs`` takes the end of every search; ``evaluations`` all that was judged on the way.
        trials: which, in this order; all unless given.
        metric: for labels.

    Raises:
        InputError: another word for ``along``, a judge that is no column, or an empty table.
    """
    if along not in ALONG:
        raise InputError(f"along: found {along!r}, expected pairs or evaluations")
    for judge in judges:
        if f"{judge}:equal" not in table:
            raise InputError(f"judges: found {judge!r}, which is no benchmark of the table's columns")
    if table.empty or not judges:
        raise InputError("learning curve: found nothing to average, expected rows and at least one judge")
    frame = with_changes(table, judges)
    if along == "pairs":
        frame = frame[
            frame["evaluations"] == frame.groupby(["pairs", "trial", "seed"])["evaluations"].transform("max")
        ]
    names = tuple(dict.fromkeys(frame["trial"])) if trials is None else tuple(trials)
    places = tuple(sorted(int(place) for place in frame[along].unique()))
    shape = (len(names), len(places))
    grids = {name: np.full(shape, np.nan) for name in ("unseen", "lowest", "highest", "validation")}
    runs = np.zeros(shape, dtype=np.int64)
    for row, trial in enumerate(names):
        for column, place in enumerate(places):
            part = frame[(frame["trial"] == trial) & (frame[along] == place)]
            runs[row, column] = len(part)
            for name, values, how in _COLUMNS:
                grids[name][row, column] = part[values].agg(how)
    return LearningCurve(along, names, places, **grids, runs=runs, metric=metric)


_COLUMNS = (
    ("unseen", "unseen", "mean"),
    ("lowest", "unseen", "min"),
    ("highest", "unseen", "max"),
    ("validation", "change", "mean"),
)


def with_changes(table: pd.DataFrame, judges: Sequence[str]) -> pd.DataFrame:
    """The table with ``change`` on all validation pairs, and ``unseen``, the mean change over judges."""
    after = table[list(judges)].mean(axis=1, skipna=False)
    before = table[[f"{judge}:equal" for judge in judges]].mean(axis=1, skipna=False)
    return table.assign(change=table["validation"] - table["equal"], unseen=after - before)
