"""Does a search fit its validation pairs? What a hold-out saw of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from sfkit.analysis.intervals import FEWEST_IMAGES, PairedEstimate, RunsOnImages, paired_estimate
from sfkit.analysis.labels import points
from sfkit.datasets.metric import Metric
from sfkit.evaluation.combining import CombinedScorer, evaluators_of
from sfkit.evaluation.evaluator import Evaluator
from sfkit.merging.recipe import Recipe
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
        candidates: among how many the best on the guiding pairs was found.
        pairs: how many were held out, those of all folds together.
        interval: 95 % interval of ``held`` over the pairs held out; None under five of them, or where
            benchmarks are combined otherwise than by their mean.
    """

    guiding: float
    held: float
    chosen: float
    folds: int
    metric: str | None = None
    candidates: int = 1
    pairs: int = 0
    interval: tuple[float, float] | None = None

    @property
    def overfit(self) -> bool:
        """True where the guiding score falls, and the held-out pairs show that theirs rises."""
        return self.guiding < 0 and self.interval is not None and self.interval[0] > 0

    @property
    def sentence(self) -> str:
        """What the check says, for tables and reports."""
        unit = "" if self.metric is None else f" {points(Metric.parse(self.metric).unit)}"
        what = "score" if self.metric is None else self.metric
        if self.guiding >= 0:
            return f"Stage 2 found nothing better than equal weights ({what} on the pairs that guide it)."
        claim = (
            f"{what} changes by {self.guiding:+.2f}{unit} on the pairs that guide Stage 2 (chosen among "
            f"{self.candidates} on these pairs), and by {self.held:+.2f}{unit} on {self.pairs} held out"
        )
        if self.interval is None:
            claim += (
                ", which are too few to judge by" if self.pairs < FEWEST_IMAGES else ", without an interval"
            )
        else:
            low, high = self.interval
            claim += f": 95 % interval {low:+.2f} to {high:+.2f}"
            claim += ", which shows neither gain nor loss" if low <= 0 <= high else ""
        instead = ""
        if self.chosen != self.held:
            among = "" if self.folds > 1 else f", chosen among {self.candidates} on these pairs"
            instead = "; the recipe was chosen on the held-out pairs instead "
            instead += f"(change {self.chosen:+.2f}{unit}{among})"
        if self.overfit:
            return f"Warning: {claim}: what it gains are these pairs, not the task{instead}."
        return f"{claim[0].upper()}{claim[1:]}{instead}."


def holdout_check(search: RoutingSearch, *, metric: str | None = None) -> HoldoutCheck | None:
    """What a hold-out saw of a search; None without a hold-out, or while x = 0 has no score.

    Args:
        search: of Stage 2, running or finished.
        metric: what the scores are, for the sentence.
    """
    if not search.folds or not search.candidates or search.candidates[0].failed:
        return None
    zero, best = search.candidates[0], search.best
    rows, leads = [], []
    for fold in range(search.folds):
        at_zero = zero.outcome.parts[fold]
        found = [c for c in search.candidates if c.fold == fold and not c.failed]
        # What a search without a hold-out would take; of equals the earlier.
        lead = min((zero, *found), key=lambda c: (c.outcome.parts[fold].guiding + c.penalty, c.number))
        chosen = (best or zero).outcome.parts[fold].held
        part = lead.outcome.parts[fold]
        # Each against x = 0 of the same fold: folds differ in how hard they are.
        rows.append((part.guiding - at_zero.guiding, part.held - at_zero.held, chosen - at_zero.held))
        leads.append(lead.recipe)
    guiding, held, chosen = (math.fsum(column) / len(rows) for column in zip(*rows, strict=True))
    evaluators = evaluators_of(search.scorer)
    pairs = sum(len(images) for evaluator in evaluators for images in evaluator.splits)
    several = search.scorer if isinstance(search.scorer, CombinedScorer) else None
    # Intervals are over images of a mean; the worst of several, or their changes, are none.
    by_mean = several is None or (several.how == "mean" and several.changes is None)
    interval = _interval(evaluators, zero.recipe, leads, held) if by_mean else None
    # A repeated candidate is no further chance.
    among = sum(not (c.failed or c.repeated) for c in search.candidates)
    return HoldoutCheck(guiding, held, chosen, search.folds, metric, among, pairs, interval)


def _interval(
    evaluators: Sequence[Evaluator], zero: Recipe, leads: Sequence[Recipe], held: float
) -> tuple[float, float] | None:
    """Of the folds' leads minus x = 0, over all pairs held out; None where these cannot tell."""
    both = []
    for evaluator in evaluators:
        images = [(fold, image) for fold, split in enumerate(evaluator.splits) for image in sorted(split)]
        if len(images) < 2:
            return None
        # A view of its own: looking these up again adds to nobody's counts.
        reader, rule = evaluator.with_store(evaluator.store), evaluator.benchmark.rule
        found = [rule.terms(one.images, evaluator.metric) for one in reader.evaluate([zero, *leads])]
        below = np.array([found[0][1][image] for _, image in images])
        sides = (
            np.array([[found[0][0][image] for _, image in images]]),
            np.array([[found[1 + fold][0][image] for fold, image in images]]),
        )
        before, after = (RunsOnImages.of_terms(above, below) for above in sides)
        both.append((after, before))
    if sum(len(one.values[0]) for one, _ in both) < FEWEST_IMAGES:
        return None
    estimate = paired_estimate(both)
    # Around the mean over folds, which is what the sentence states.
    low, high = PairedEstimate(held, estimate.error, estimate.freedom).interval()
    return (low, high) if math.isfinite(low) and math.isfinite(high) else None


def holdout_sentence(search: RoutingSearch, *, metric: str | None = None) -> str:
    """What :func:`holdout_check` says of a search, or that no pair was held out from it."""
    check = holdout_check(search, metric=metric)
    if check is not None:
        return check.sentence
    return (
        "No validation pair was held out: whether Stage 2's gain is the task's or these pairs' is not known."
    )
