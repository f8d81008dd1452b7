"""Racing during Stage 1, and noise by merge, on the scores of all subsets on each pair.

It needs ``images-bank.csv``, which ``python benchmarks/exhaustive.py --images benchmarks/images-bank.csv``
makes.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
import pandas as pd
from bayesian import BLOCK, MOST
from exhaustive import PAIRS, SubsetScores, image_scores, subset_scores
from landscapes import Landscape
from noise import NONE, by_noise, told
from optimum import number
from tabulated import markdown_lines, percent

from sfkit.evaluation.outcome import Outcome
from sfkit.merging.recipe import Recipe
from sfkit.search import BayesianSubsetSearch, BayesianSubsetSettings
from sfkit.search.acquisition import equal_weights
from sfkit.search.gaussian_process import Array

FIRST = 7
"""Pairs that every subset is scored on."""
PART = FIRST / PAIRS
BOUNDS: tuple[float | None, ...] = (None, 2.0, 1.0, 0.0)
"""Standard errors by which a subset may be behind and is finished still; None scores all pairs of all."""
COSTS = (24, 32, 40)
SEEDS = 40
SEEN = 8
"""Pairs that a model learns from where the others judge."""

Images = Mapping[int, Array]
"""By subset its score on each pair."""


class Race:
    """A scorer that scores subsets on the first pairs, and on all where they may yet be the best.

    A subset is finished unless its mean difference to the best finished one, on the first pairs of both,
    exceeds so many of its standard errors; a source alone cannot win and is not finished. What is not
    finished is told by the best one's score and that difference. Of what comes together the first subset is
    finished before anything else is compared.
    """

    def __init__(self, land: Landscape, images: Images, bound: float | None) -> None:
        self.land, self.images, self.bound = land, images, bound
        self.spent = 0.0
        """In evaluations on all pairs."""
        self.met = 0
        """Subsets of two sources or more that were scored."""
        self.finished: dict[int, float] = {}
        """Subsets of two sources or more, with their exact scores."""
        self.course: list[tuple[float, float]] = []
        """What was spent, and the regret of the best finished one then."""

    def __call__(self, recipes: Sequence[Recipe]) -> list[Outcome]:
        """One outcome a recipe, in order."""
        masks = [self.land.mask(recipe.sources) for recipe in recipes]
        order = sorted(range(len(masks)), key=lambda n: masks[n].bit_count() < 2)
        scores = {n: self._score(masks[n]) for n in order}
        return [Outcome(scores[n]) for n in range(len(masks))]

    def regret(self, cost: float) -> float:
        """Of what would be returned for so many evaluations."""
        return min((regret for spent, regret in self.course if spent <= cost + 1e-9), default=np.inf)

    @property
    def needed(self) -> float:
        """Evaluations until the best of all is finished; infinite where it never was."""
        return min((spent for spent, regret in self.course if regret == 0.0), default=np.inf)

    def _score(self, mask: int) -> float:
        several = mask.bit_count() >= 2
        self.met += several
        if self.bound is not None and self.finished:
            best = min(self.finished, key=self.finished.__getitem__)
            apart = self.images[mask][:FIRST] - self.images[best][:FIRST]
            error = float(apart.std(ddof=1)) / FIRST**0.5
            if not several or apart.mean() > self.bound * error:
                self.spent += PART
                return self.finished[best] + float(apart.mean())
        self.spent += 1.0
        score = self.land.scores[mask]
        if several:
            self.finished[mask] = score
            self.course.append((self.spent, min(self.finished.values()) - self.land.best))
        return score


def raced(land: Landscape, images: Images, bound: float | None, seed: int) -> Race:
    """One search's race: until the best of all is finished, or the search has proposed what it may."""
    race = Race(land, images, bound)
    settings = BayesianSubsetSettings(generations=MOST, seed=seed)
    search = BayesianSubsetSearch(land.names, BLOCK, race, settings)
    while not search.done and race.needed == np.inf:
        search.step()
    return race


def races(land: Landscape, images: Images, seeds: Sequence[int] = range(SEEDS)) -> pd.DataFrame:
    """A row a bound and seed."""
    rows = []
    for bound in BOUNDS:
        for seed in seeds:
            race = raced(land, images, bound, seed)
            regrets = {f"after {cost}": race.regret(cost) for cost in COSTS}
            share = len(race.finished) / race.met
            rows.append({"bound": name_of(bound), "needed": race.needed, "finished": share, **regrets})
    return pd.DataFrame(rows)


def name_of(bound: float | None) -> str:
    """A race's name in the table."""
    return "no racing" if bound is None else f"finished up to {bound:.0f} standard errors behind"


def race_table(found: pd.DataFrame) -> str:
    """A row a bound."""
    rows = []
    for bound, part in found.groupby("bound", sort=False):
        regrets = [part[f"after {cost}"] for cost in COSTS]
        cells = [f"{one.mean():.3f} ({(one == 0.0).sum()})" for one in regrets]
        needed = part["needed"]
        ends = (percent(np.isfinite(needed).mean()), *map(number, (needed.median(), needed.max())))
        rows.append((bound, len(part), *cells, *ends, percent(part["finished"].mean())))
    heads = (
        "search",
        "seeds",
        *(f"after {cost}" for cost in COSTS),
        "found it",
        "median",
        "most",
        "finished",
    )
    return markdown_lines(heads, rows)


def noises(names: tuple[str, ...], images: Images, seeds: Sequence[int] = range(SEEDS)) -> pd.DataFrame:
    """A row a search and kind of noise: rank correlation with the unseen pairs, and regret there."""
    rows = []
    for seed in seeds:
        seen = np.sort(np.random.default_rng([seed, 9]).permutation(PAIRS)[:SEEN])
        scores = {mask: float(row[seen].mean()) for mask, row in images.items()}
        land = Landscape(SubsetScores(names, scores, {}))
        search = BayesianSubsetSearch(names, BLOCK, land.scored, BayesianSubsetSettings(seed=seed))
        search.run()
        masks = [land.mask(c.subset) for c in search.candidates if not c.repeated]
        genes = [tuple(n for n in range(len(names)) if mask >> n & 1) for mask in masks]
        table = np.array([images[mask] for mask in masks])  # (merges, pairs)
        unseen = np.delete(table, seen, axis=1).mean(axis=1)
        several = np.array([len(one) >= 2 for one in genes])
        means = by_noise((equal_weights(genes, len(names)),), table[:, seen])
        rows += [(seed, name, *told(mean[several], unseen[several])) for name, mean in means.items()]
    return pd.DataFrame(rows, columns=["seed", "noise", "correlation", "regret"])


def noise_table(found: pd.DataFrame) -> str:
    """A row a kind of noise."""
    regrets = found.pivot(index="seed", columns="noise", values="regret")
    rows = []
    for name, part in found.groupby("noise", sort=False):
        apart = regrets[name] - regrets[NONE]
        error = apart.std(ddof=1) / len(apart) ** 0.5
        told_apart = "" if name == NONE else f"{apart.mean():+.2f} (standard error {error:.2f})"
        rows.append((name, f"{part['correlation'].mean():.3f}", f"{part['regret'].mean():.2f}", told_apart))
    return markdown_lines(("noise", "rank correlation", "regret", "against the scores themselves"), rows)


def section() -> str:
    """The section."""
    table, images = subset_scores(), image_scores()
    return f"""## Racing during Stage 1, and noise by merge

On the scores of all subsets of `bank` on each of {PAIRS} pairs (`benchmarks/images-bank.csv`). A search by
the model scores every subset on the first {FIRST} pairs, and on the others unless its mean difference to the
best finished one, on these pairs of both, exceeds so many standard errors of that difference; sources alone
are never finished. Of what is not finished the model hears the best one's score and that difference. What is
returned is the best finished one, by its exact score. Regret, points at the mean, for what the search costs
in evaluations on all pairs, in brackets in how many seeds it is the best of all; then how many seeds finish
the best of all with at most {MOST} proposals, what that costs, and the share of subsets finished by then.

{race_table(races(Landscape(table), images))}

Noise by merge: a search with the defaults on {SEEN} pairs drawn by the seed, {SEEDS} seeds, and what two
models and the scores themselves say of the subsets it evaluated, against scores on the {PAIRS - SEEN} other
pairs: rank correlation, and how far the subset that each prefers is from the best there, points. In the
section `noise`, whose searches see three windows and are judged by one, the scores themselves have the least
regret of the three on `bank` and the most on `bank-sharp`; the last column says how much of such a difference
may be chance.

{noise_table(noises(table.names, images))}
"""
