"""Does a search fit its validation pairs? What a hold-out saw of it."""

from __future__ import annotations

import math
from dataclasses import dataclass

from sfkit.datasets.metric import Metric
from sfkit.search.routing import RoutingSearch


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
