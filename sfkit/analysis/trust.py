"""May ``census`` be trusted for a pool and its pairs: by labels where there are any, else by its own signs.

The limits were set on real networks and on the embedded bank: docs/results.md, "Search without ground truth".
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from sfkit.datasets.census import CENSUS, CensusTarget
from sfkit.errors import InputError
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging.live import LiveModel
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe
from sfkit.streams import Stream, generator

CORRELATION = 0.6  # the interval's lower end; below, the ranking without labels is not to be trusted
STABILITY = 0.7  # of the ranking over halves of the pairs
TEXTURE = 0.3  # share of pixels with texture
INSIDE = 0.7  # share of pixels whose match lies inside the right image
FLAT = 1.0  # pixels between the 5th and the 95th percentile of a disparity map
FEW_PAIRS = 4
FEW_NETWORKS = 8
DRAWS = 1000

Table = NDArray[np.float64]


@dataclass(frozen=True)
class Agreement:
    """How ``census`` ranks networks beside a metric with labels.

    Attributes:
        correlation: Spearman's rank correlation over the networks.
        interval: its 95 % percentile interval over networks drawn with replacement.
        regret: how much worse the network with the best census is than the best, in the metric's unit.
        networks: how many were compared.
        metric: the metric with labels, and its benchmark.
    """

    correlation: float
    interval: tuple[float, float]
    regret: float
    networks: int
    metric: str


@dataclass(frozen=True)
class Trust:
    """What speaks for and against a ranking without labels.

    Attributes:
        agreement: with labels, None where none are at hand.
        stability: mean rank correlation of the networks' scores over random halves of the pairs; NaN with
            fewer than two pairs or three networks.
        texture: share of pixels with texture, of all pairs.
        inside: share of pixels whose match lies inside the right image, under the best network.
        collapsed: share of the best network's maps that are nearly constant or nearly zero.
        pairs: how many pairs there are.
    """

    agreement: Agreement | None
    stability: float
    texture: float
    inside: float
    collapsed: float
    pairs: int

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why not to trust it, each in words; none where nothing speaks against it."""
        found = []
        one = self.agreement
        if one is not None and one.interval[0] < CORRELATION:
            low, high = one.interval
            found.append(
                f"over {one.networks} networks it ranks as {one.metric} with a correlation of "
                f"{one.correlation:.2f} ({low:.2f} to {high:.2f}, expected {CORRELATION} or more), and its "
                f"pick is {one.regret:.2f} worse than the best"
            )
        if self.pairs < FEW_PAIRS:
            found.append(f"{self.pairs} pair{'s' * (self.pairs != 1)} can be overfitted, as labels can")
        if self.stability < STABILITY:
            found.append(
                f"halves of the pairs rank the networks with a correlation of {self.stability:.2f} "
                f"(expected {STABILITY} or more): add pairs"
            )
        if self.texture < TEXTURE:
            found.append(f"{100 * self.texture:.0f} % of the pixels have texture, the rest tells nothing")
        if self.inside < INSIDE:
            found.append(f"under the best network {100 * self.inside:.0f} % of matches lie inside the image")
        if self.collapsed > 0:
            found.append(
                f"{100 * self.collapsed:.0f} % of the best network's maps are nearly constant or zero: "
                "it may win where images have no texture"
            )
        return tuple(found)

    @property
    def trusted(self) -> bool:
        """True where nothing speaks against it."""
        return not self.doubts

    @property
    def sentence(self) -> str:
        """The whole in one sentence."""
        if self.doubts:
            return f"Do not trust the ranking without labels yet: {'; '.join(self.doubts)}."
        if self.agreement is None:
            return (
                "Nothing speaks against the ranking without labels (stability over halves of the pairs "
                f"{self.stability:.2f}); without labels that is no proof."
            )
        one = self.agreement
        return (
            f"The ranking without labels agrees with {one.metric}: correlation {one.correlation:.2f} "
            f"({one.interval[0]:.2f} to {one.interval[1]:.2f}) over {one.networks} networks, its pick "
            f"{one.regret:.2f} worse than the best."
        )


def agreement(census: Sequence[float], truth: Sequence[float], metric: str, *, seed: int = 0) -> Agreement:
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
    rng = generator(seed, Stream.TRUST)
    drawn = (rng.integers(len(ours), size=len(ours)) for _ in range(DRAWS))
    spread = [_correlation(ours[chosen], theirs[chosen]) for chosen in drawn]
    low, high = np.nanpercentile(spread, (2.5, 97.5))
    regret = float(theirs[int(ours.argmin())] - theirs.min())
    return Agreement(_correlation(ours, theirs), (float(low), float(high)), regret, len(ours), metric)


def stability(scores: Table, *, seed: int = 0, splits: int = 50) -> float:
    """Mean rank correlation over random halves of the pairs; NaN for too few.

    ``scores`` is (networks, pairs).
    """
    networks, pairs = scores.shape
    if networks < 3 or pairs < 2:
        return float("nan")
    rng = generator(seed, Stream.TRUST)
    found = []
    for _ in range(splits):
        order = rng.permutation(pairs)
        first, second = order[: pairs // 2], order[pairs // 2 :]
        found.append(_correlation(scores[:, first].mean(axis=1), scores[:, second].mean(axis=1)))
    return float(np.nanmean(found)) if not np.isnan(found).all() else float("nan")


def is_collapsed(disparity: NDArray[np.floating[Any]]) -> bool:
    """True where a map (H, W) in pixels is nearly constant or nearly zero."""
    low, high = np.percentile(disparity, (5, 95))
    return bool(high - low < FLAT or high < FLAT)


def yardstick_recipes(pool: Pool) -> list[Recipe]:
    """Networks that every pool has: base, uniform, each source alone, and all sources but one."""
    names = pool.names
    left_out = [tuple(n for n in names if n != name) for name in names] if len(names) > 2 else []
    return [
        pool.base_recipe(),
        pool.uniform(),
        *(pool.equal(*s) for s in [*((n,) for n in names), *left_out]),
    ]


def trust(
    scorer: Evaluator,
    recipes: Sequence[Recipe],
    *,
    labelled: Evaluator | None = None,
    seed: int = 0,
) -> Trust:
    """Look at the ranking of networks by ``census``; whatever the stores have is not computed again.

    Args:
        scorer: of the pairs without labels, by ``census``.
        recipes: the networks, such as those a search scored.
        labelled: where labels are at hand, a scorer of the same pool by a metric that needs them.
        seed: of the draws behind interval and halves.

    Raises:
        InputError: another metric, no network, or with labels fewer than eight.
    """
    if scorer.metric.name != CENSUS.name:
        raise InputError(f"trust: found the metric {scorer.metric}, expected a scorer by census")
    if not recipes:
        raise InputError("trust: found no network, expected those that were scored")
    evaluations = scorer.evaluate(recipes)
    sound = [n for n, one in enumerate(evaluations) if not one.failure]
    if not sound:
        raise InputError("trust: every network failed, expected one that was scored")
    table = np.array([[image.value(CENSUS) for image in evaluations[n].images] for n in sound])
    found = None
    if labelled is not None:
        outcomes = labelled([recipes[n] for n in sound])
        both = [(row.mean(), o.score) for row, o in zip(table, outcomes, strict=True) if not o.failed]
        metric = f"{labelled.metric} on {labelled.benchmark.name}"
        found = agreement([ours for ours, _ in both], [theirs for _, theirs in both], metric, seed=seed)
    best = recipes[sound[int(table.mean(axis=1).argmin())]]
    texture, inside, collapsed = _seen(scorer.pool, scorer.prepared, best, scorer.device)
    return Trust(found, stability(table, seed=seed), texture, inside, collapsed, table.shape[1])


def trust_of(pool: Pool, evaluators: Sequence[Evaluator]) -> Trust | None:
    """Whether the guide without labels among a search's guides may be trusted; None where there is none.

    Looks at :func:`yardstick_recipes`; a guide with labels beside it says how well they agree.
    """
    unlabelled = next((one for one in evaluators if one.metric.name == CENSUS.name), None)
    if unlabelled is None:
        return None
    recipes = yardstick_recipes(pool)
    labelled = next((one for one in evaluators if one.metric.needs_truth), None)
    return trust(unlabelled, recipes, labelled=labelled if len(recipes) >= FEW_NETWORKS else None)


def _seen(pool: Pool, prepared: PreparedBenchmark, recipe: Recipe, device: str) -> tuple[float, float, float]:
    """Shares of pixels with texture and inside, and of maps that are collapsed, under one network."""
    live = LiveModel(pool, device=device)
    live.apply(recipe)
    rows = []
    for sample, pair in prepared:
        map_ = pair.window.crop(live.disparity(pair.left, pair.right)).numpy()
        target = CensusTarget(sample.left, sample.right)
        finite = bool(np.isfinite(map_).all())
        rows.append((target.texture, target.residual(map_).inside, is_collapsed(map_) if finite else True))
    texture, inside, collapsed = np.mean(rows, axis=0).tolist()
    return texture, inside, collapsed


def _correlation(first: Table, second: Table) -> float:
    if np.ptp(first) == 0 or np.ptp(second) == 0:
        return float("nan")
    return float(spearmanr(first, second).statistic)
