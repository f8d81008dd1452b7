"""The bootstrap-averaged winner: one recipe in place of the best on a few validation pairs (Breiman, 1996).

Which candidate is best depends on which pairs happened to guide. Every evaluation in the store has the
errors of each image, so that the candidates can be judged again on resamples of the pairs, at no forward
pass. One of them wins each resample; the average of these winners is one recipe more, which is scored once.
What was measured of it on unseen pairs stands in docs/results.md ("What to return", "Which rule should a
verdict follow?"): a search by a model returns it unless it is told otherwise, the paper's where it is asked
to. Tied winners give it strengths of its own in every block.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from sfkit.errors import InputError
from sfkit.evaluation.combining import CombinedScorer, evaluators_for
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.outcome import Outcome, Scorer
from sfkit.merging.recipe import Recipe
from sfkit.search.base import Search
from sfkit.search.checks import RESAMPLES, check_choice
from sfkit.search.journal import Journal
from sfkit.search.records import Candidate
from sfkit.search.routing import RoutingSearch
from sfkit.settings import require_whole
from sfkit.streams import Stream, generator

AVERAGED = "averaged winner"
"""What the network is called where networks have names."""
FEWEST_PAIRS = 2
"""Resamples of one pair are that pair."""

Indices = NDArray[np.int64]
Scores = NDArray[np.float64]


@dataclass(frozen=True)
class Win:
    """A candidate that won resamples.

    Attributes:
        stage: the search it is of: ``subset`` or ``routing``.
        candidate: itself.
        wins: how many resamples.
    """

    stage: str
    candidate: Candidate
    wins: int


@dataclass(frozen=True)
class Averaged:
    """The average of what wins resamples of the validation pairs.

    Attributes:
        recipe: the average; the winner itself where one candidate wins all resamples.
        outcome: what the scorer said of it, on the pairs as they are.
        wins: the winners, those of most resamples first.
        resamples: how many there were.
    """

    recipe: Recipe
    outcome: Outcome
    wins: tuple[Win, ...]
    resamples: int

    @property
    def score(self) -> float:
        """On the validation pairs, in the metric's unit, lower is better."""
        return self.outcome.score

    @property
    def finite(self) -> bool:
        """Whether it has a score to be judged by."""
        return math.isfinite(self.score)

    @property
    def table(self) -> pd.DataFrame:
        """A row a winner: stage, candidate (its number), wins, score, subset."""
        rows = [
            (win.stage, win.candidate.number, win.wins, win.candidate.score, "+".join(win.candidate.subset))
            for win in self.wins
        ]
        return pd.DataFrame(rows, columns=["stage", "candidate", "wins", "score", "subset"])

    def as_record(self) -> dict[str, Any]:
        """Plain values, for the journal."""
        return {
            "resamples": self.resamples,
            "wins": [
                {"stage": win.stage, "candidate": win.candidate.number, "wins": win.wins} for win in self.wins
            ],
            "recipe": self.recipe.as_dict(),
            "score": self.score,
            "failed": self.outcome.failed,
            "error": self.outcome.error,
            "cached": self.outcome.cached,
            "seconds": self.outcome.seconds,
            "cpu_seconds": self.outcome.cpu_seconds,
            "key": self.outcome.key,
        }


def averaged_winner(
    searches: Sequence[Search[Any]],
    scorer: Scorer,
    resamples: int = RESAMPLES,
    *,
    seed: int = 0,
    journal: Journal | None = None,
) -> Averaged:
    """Average what wins resamples of the validation pairs, and score the average: one evaluation.

    A function of the seed and the searches' scores, so that it is the same after a kill.

    Args:
        searches: finished ones of one pool and scorer; of equals the candidate that came first wins.
        scorer: what guided them: an evaluator, or several combined.
        resamples: how many are drawn; at least 1.
        seed: of the draws.
        journal: is told of the winners and of the average.

    Raises:
        InputError: as :func:`check_averaging` and :func:`check_choice`, or no candidate has a finite score.
    """
    require_whole("resamples", resamples, 1)
    evaluators = check_averaging(scorer)
    for search in searches:
        if isinstance(search, RoutingSearch):
            check_choice(search.settings)
    # One entry a recipe: what both stages scored must not have its wins counted apart.
    found: dict[Recipe, tuple[str, Candidate]] = {}
    for search in searches:
        for candidate in search.candidates:
            if not candidate.failed:
                found.setdefault(candidate.recipe, (search.kind, candidate))
    if not found:
        raise InputError("averaged winner: found no candidate with a finite score, expected at least one")
    recipes = list(found)
    won = Counter(winners(resampled(scorer, recipes, resamples, seed)))
    # Ties by number: the average sums floats in this order, the same on every run.
    ranked = sorted(won.items(), key=lambda entry: (-entry[1], entry[0]))
    wins = tuple(Win(*found[recipes[number]], wins=count) for number, count in ranked)
    recipe = average({win.candidate.recipe: win.wins for win in wins}, evaluators[0].pool.names)
    # One evaluation more, unless a stage scored it.
    (outcome,) = scorer([recipe])
    averaged = Averaged(recipe, outcome, wins, resamples)
    if journal is not None:
        journal.write("average", search="average", seed=seed, **averaged.as_record())
    return averaged


def check_averaging(scorer: Scorer) -> tuple[Evaluator, ...]:
    """The evaluators behind a scorer whose validation pairs can be resampled.

    Raises:
        InputError: a scorer that does not know its images, or a single pair.
    """
    known = evaluators_for("resamples", scorer)
    if sum(len(one.benchmark) for one in known) < FEWEST_PAIRS:
        raise InputError(
            f"resamples: found one validation pair, expected at least {FEWEST_PAIRS} to draw resamples of: "
            "add some, or leave resamples at 0"
        )
    return known


def resampled(scorer: Scorer, recipes: Sequence[Recipe], resamples: int, seed: int) -> Scores:
    """Scores of recipes on resamples of the validation pairs, (resamples, recipes), lower is better.

    Pairs are drawn with replacement within their benchmark; of several benchmarks first the benchmarks are,
    and what was drawn is combined as the scorer does.

    Raises:
        InputError: as :func:`check_averaging`.
    """
    evaluators = check_averaging(scorer)
    # (recipes, images) of each benchmark, from the store.
    tables = [_terms(evaluator, recipes) for evaluator in evaluators]
    sizes = [len(evaluator.benchmark) for evaluator in evaluators]
    if not isinstance(scorer, CombinedScorer):
        (size,), (table,) = sizes, tables
        drawn = _drawn(resamples, size, size, seed)
        return np.stack([_score(table, images) for images in drawn])
    # A benchmark that is drawn twice is drawn with different pairs: every slot has draws of its own.
    slots = range(len(sizes))
    chosen = _drawn(resamples, len(sizes), len(sizes), seed)
    images = [[_drawn(resamples, n, n, seed, slot, b) for b, n in enumerate(sizes)] for slot in slots]
    changes = None if scorer.changes is None else scorer.changes.yardsticks()
    found = []
    for r, benchmarks in enumerate(chosen):
        scores = []
        for slot, b in enumerate(benchmarks):
            score = _score(tables[b], images[slot][b][r])
            # Yardsticks are of all pairs: a resample moves scores, not their unit.
            scores.append(score if changes is None else (score - changes[b].uniform) / changes[b].spread)
        every = np.stack(scores)
        found.append(every.max(axis=0) if scorer.how == "worst" else every.mean(axis=0))
    return np.stack(found)


def winners(scores: Scores) -> list[int]:
    """The number of the recipe of least score in each resample; the earlier one of equals."""
    return [int(n) for n in scores.argmin(axis=1)]


def average(counts: Mapping[Recipe, int], names: Sequence[str]) -> Recipe:
    """One recipe whose strengths, gamma_b pi_b,e, are the mean of several, each as often as it counts.

    Args:
        counts: recipes over the same blocks, and how often each one counts.
        names: the pool's sources, in order.

    Raises:
        InputError: no recipe, or recipes over other blocks or preparations than the first one's.
    """
    if not counts:
        raise InputError("average: found no recipe, expected at least one")
    first = next(iter(counts))
    # As it is: through a product and a quotient its weights would change in their last bits.
    if len(counts) == 1:
        return first
    if any((one.blocks, one.preparation) != (first.blocks, first.preparation) for one in counts):
        raise InputError("average: found recipes over other blocks or preparations, expected the same ones")
    # In the pool's order, whichever winner names a source first.
    sources = tuple(name for name in names if any(name in recipe.sources for recipe in counts))
    total = sum(counts.values())
    strengths = np.zeros((len(first.blocks), len(sources)))
    plain = np.zeros_like(strengths)
    for recipe, count in counts.items():
        columns = [sources.index(name) for name in recipe.sources]
        weights = np.array(recipe.weights) * (count / total)
        plain[:, columns] += weights
        # Scales are averaged within the product: gamma times pi is what a task vector is multiplied by.
        strengths[:, columns] += weights * np.array(recipe.scales)[:, None]
    rows, scales = [], []
    for b, strength in enumerate(strengths):
        scale = float(strength.sum())
        # A frozen block stays one to the last bit, and a block that nobody merges has weights all the same.
        fixed = all(recipe.scales[b] == 1.0 for recipe in counts)
        scales.append(1.0 if fixed else scale)
        rows.append(tuple(map(float, plain[b] if fixed or scale == 0.0 else strength / scale)))
    return Recipe(sources, first.blocks, tuple(rows), tuple(scales), first.preparation)


def _drawn(resamples: int, size: int, count: int, seed: int, *part: int) -> Indices:
    """(resamples, count) numbers below ``size``."""
    return generator(seed, Stream.BOOTSTRAP_AVERAGE, *part).integers(size, size=(resamples, count))


def _terms(evaluator: Evaluator, recipes: Sequence[Recipe]) -> tuple[Scores, Scores]:
    """Numerators and denominators, (recipes, images) each, from the store; no count goes up."""
    # The same store with counts of its own: what is read again is no evaluation of the search.
    reader = evaluator.with_store(evaluator.store)
    rule, metric = evaluator.benchmark.rule, evaluator.metric
    terms = [rule.terms(evaluation.images, metric) for evaluation in reader.evaluate(recipes)]
    return np.stack([above for above, _ in terms]), np.stack([below for _, below in terms])


def _score(terms: tuple[Scores, Scores], images: Indices) -> Scores:
    """(recipes,) on the images drawn; equal rows get equal sums, so that ties stay ties."""
    above, below = (part[:, images].sum(axis=1) for part in terms)
    return np.asarray(above / below)
