"""Does ``census`` rank networks as labels do? The same networks measured both ways, where labels are."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import rankdata

from sfkit.datasets.census import CENSUS
from sfkit.datasets.metric import Metric
from sfkit.errors import InputError
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.known import scored
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe
from sfkit.streams import Stream, generator

FEW_NETWORKS = 8
DRAWS = 1000
ENDS = (2.5, 97.5)  # percentiles: 95 % lie between

Scores = NDArray[np.float64]


@dataclass(frozen=True)
class Agreement:
    """How ``census`` ranks networks beside a metric with labels.

    Attributes:
        correlation: Spearman's rank correlation over the networks; NaN where either score is constant.
        interval: its 95 % percentile interval over networks drawn with replacement.
        regret: how much worse the network with the best census is than the best, in the metric's unit.
        regret_interval: its 95 % percentile interval over the same draws, each drawn set with a pick and a
            best of its own.
        networks: how many were compared.
        metric: the metric with labels, and its benchmark.
    """

    correlation: float
    interval: tuple[float, float]
    regret: float
    regret_interval: tuple[float, float]
    networks: int
    metric: str


@dataclass(frozen=True, eq=False)
class Ranking:
    """Networks on one benchmark, scored without labels and with; N networks that did not fail.

    Attributes:
        benchmark: its name.
        metric: the metric with labels.
        networks: N names.
        census: (N,) percent of census bits that differ.
        truth: (N,) in the metric's unit.
        agreement: how one ranks beside the other.
    """

    benchmark: str
    metric: Metric
    networks: tuple[str, ...]
    census: Scores
    truth: Scores
    agreement: Agreement

    @property
    def picked(self) -> int:
        """The place of the network with the lowest census."""
        return int(self.census.argmin())

    @property
    def best(self) -> int:
        """The place of the network with the lowest true error."""
        return int(self.truth.argmin())


def rank_networks(
    scorers: Sequence[Evaluator], recipes: Mapping[str, Recipe], metric: str, *, seed: int = 0
) -> tuple[Ranking, ...]:
    """One ranking a benchmark with ground truth; both scores come from the same forward passes.

    Args:
        scorers: of benchmarks with ground truth, one pool's, which count ``metric`` and ``census`` both
            (``Evaluator(..., also=[metric, "census"])``).
        recipes: the networks by name; those that fail are left out.
        metric: the one with labels.
        seed: of the draws behind the intervals.

    Raises:
        InputError: fewer than eight networks without failure, or a scorer that does not count both.
    """
    wanted = Metric.parse(metric)
    found = []
    for scorer in scorers:
        evaluations = scorer.evaluate(list(recipes.values()))
        # Both rankings are over the same networks.
        sound = {name: one for name, one in zip(recipes, evaluations, strict=True) if not one.failure}
        census, truth = (
            np.array([scorer.score(one.images, by) for one in sound.values()]) for by in (CENSUS, wanted)
        )
        label = f"{wanted} on {scorer.benchmark.name}"
        agreed = agreement(census, truth, label, seed=seed)
        found.append(Ranking(scorer.benchmark.name, wanted, tuple(sound), census, truth, agreed))
    return tuple(found)


def ranking_table(rankings: Sequence[Ranking]) -> pd.DataFrame:
    """One row a benchmark: rank correlation and regret with intervals, what is picked, what there is."""
    rows = [
        {
            "benchmark": one.benchmark,
            "networks": one.agreement.networks,
            "rank correlation": one.agreement.correlation,
            "low": one.agreement.interval[0],
            "high": one.agreement.interval[1],
            "regret": one.agreement.regret,
            "regret, low": one.agreement.regret_interval[0],
            "regret, high": one.agreement.regret_interval[1],
            "picked": one.networks[one.picked],
            f"{one.metric} of the pick": one.truth[one.picked],
            "of the best": one.truth[one.best],
            "of the worst": one.truth.max(),
        }
        for one in rankings
    ]
    return pd.DataFrame(rows).set_index("benchmark")


def drawn_networks(pool: Pool, subsets: int, *, seed: int = 0) -> dict[str, Recipe]:
    """Networks to compare by name: those of :func:`yardstick_recipes`, and subsets drawn at random.

    Of a pool that has fewer subsets of three and more sources than that, all of them.
    """
    found = yardstick_recipes(pool)
    rng, names = generator(seed, Stream.TRUST), pool.names
    for _ in range(20 * subsets):  # a small pool runs out of new ones
        if len(found) >= len(yardstick_recipes(pool)) + subsets or len(names) < 3:
            break
        # 2 to N - 1: singles and the whole are among the yardsticks.
        size = int(rng.integers(2, len(names)))
        # In the pool's order: a subset has one name.
        kept = sorted(rng.choice(len(names), size=size, replace=False).tolist())
        found.setdefault("+".join(names[n] for n in kept), pool.equal(*(names[n] for n in kept)))
    return found


def yardstick_recipes(pool: Pool) -> dict[str, Recipe]:
    """Networks that every pool has: base, uniform, each source alone, and all sources but one."""
    names = pool.names
    left_out = {f"all but {name}": tuple(n for n in names if n != name) for name in names}
    return {
        "base": pool.base_recipe(),
        "uniform": pool.uniform(),
        **{name: pool.equal(name) for name in names},
        # Of two sources all but one is the other alone.
        **({name: pool.equal(*kept) for name, kept in left_out.items()} if len(names) > 2 else {}),
    }


def scored_by_both(unlabelled: Sequence[Evaluator], labelled: Evaluator) -> tuple[Scores, Scores]:
    """Scores without and with labels of every network that the evaluators' stores hold, by whomever.

    Without labels the mean over the evaluators.
    """
    ours, theirs = [scored(one) for one in unlabelled], scored(labelled)
    both = [key for key in theirs if all(key in table for table in ours)]
    census = [
        [one.score(table[key].images, CENSUS) for key in both]
        for one, table in zip(unlabelled, ours, strict=True)
    ]
    return np.mean(census, axis=0), np.array([labelled.score(theirs[key].images) for key in both])


def agreement(
    census: Sequence[float] | Scores, truth: Sequence[float] | Scores, metric: str, *, seed: int = 0
) -> Agreement:
    """How scores without labels rank networks beside scores with labels; a network a place, lower is better.

    Raises:
        InputError: different numbers, or fewer than eight networks.
    """
    if len(census) != len(truth) or len(census) < FEW_NETWORKS:
        raise InputError(
            f"trust: found {len(census)} scores without and {len(truth)} with labels, expected as many "
            f"of both, at least {FEW_NETWORKS}: score more merges"
        )
    ours, theirs = np.asarray(census, np.float64), np.asarray(truth, np.float64)
    # Networks are drawn with replacement, each with both of its scores.
    drawn = generator(seed, Stream.TRUST).integers(len(ours), size=(DRAWS, len(ours)))
    spread = rank_correlations(ours[drawn], theirs[drawn])
    # A draw that repeats one network only has no correlation.
    low, high = np.nanpercentile(spread, ENDS)
    least, most = np.percentile(regrets(ours[drawn], theirs[drawn]), ENDS)
    return Agreement(
        rank_correlation(ours, theirs),
        (float(low), float(high)),
        float(regrets(ours[None], theirs[None])[0]),
        (float(least), float(most)),
        len(ours),
        metric,
    )


def regrets(ours: Scores, theirs: Scores) -> Scores:
    """Of each two rows (D, N) -> (D,): how much worse by the second the first's lowest is than the lowest."""
    picked = np.take_along_axis(theirs, ours.argmin(axis=1, keepdims=True), axis=1)[:, 0]
    lost: Scores = picked - theirs.min(axis=1)
    return lost


def rank_correlation(first: Scores, second: Scores) -> float:
    """Spearman's; NaN where either is constant."""
    return float(rank_correlations(first[None], second[None])[0])


def rank_correlations(first: Scores, second: Scores) -> Scores:
    """Spearman's of each two rows (D, N) -> (D,): Pearson's of their ranks, ties sharing theirs."""
    one, other = (rankdata(rows, axis=1) for rows in (first, second))
    one, other = (ranks - ranks.mean(axis=1, keepdims=True) for ranks in (one, other))
    spread = np.sqrt((one**2).sum(axis=1) * (other**2).sum(axis=1))
    found: Scores = np.full(len(spread), np.nan)
    # Rows without spread keep their NaN, and nothing warns.
    np.divide((one * other).sum(axis=1), spread, out=found, where=spread > 0)
    return found
