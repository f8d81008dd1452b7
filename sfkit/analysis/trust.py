"""May ``census`` be trusted for a pool and its pairs: by labels where there are any, else by its own signs.

The limits were set on real networks and on the embedded bank: docs/results.md, "Search without ground truth".
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfkit.analysis.ranking import (
    FEW_NETWORKS,
    Agreement,
    agreement,
    rank_correlation,
    scored_by_both,
    yardstick_recipes,
)
from sfkit.datasets.census import CENSUS, CensusTarget
from sfkit.datasets.pairs import Sample
from sfkit.errors import InputError, SfkitWarning
from sfkit.evaluation.combining import CombinedScorer, evaluators_of
from sfkit.evaluation.evaluator import Evaluator
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe
from sfkit.streams import Stream, generator

CORRELATION = 0.6  # the interval's lower end; below, the ranking without labels is not to be trusted
STABILITY = 0.7  # of the ranking over halves of the pairs
TEXTURE = 0.3  # share of pixels with texture
INSIDE = 0.7  # share of pixels whose match lies inside the right image
FLAT = 1.0  # pixels between the 5th and the 95th percentile of a disparity map
FEW_PAIRS = 4
BEST, FOUND = "the best network", "the network found"

Table = NDArray[np.float64]


@dataclass(frozen=True)
class KeptBack:
    """The census of the network found against that of the equal mixture, in points; below 0 is better.

    Attributes:
        guiding: on the pairs that guided.
        further: on pairs without labels that guided nothing.
        pairs: how many of these there are.
    """

    guiding: float
    further: float
    pairs: int

    @property
    def sentence(self) -> str:
        """What the further pairs say."""
        return (
            f"against the equal mixture the census of the network found changes by {self.guiding:+.2f} "
            f"points on the pairs that guide, and by {self.further:+.2f} on {self.pairs} that guide nothing"
        )


@dataclass(frozen=True)
class Trust:
    """What speaks for and against a ranking without labels.

    Attributes:
        agreement: with labels, None where none are at hand.
        stability: mean rank correlation of the networks' scores over random halves of the pairs; NaN with
            fewer than two pairs or three networks.
        texture: share of pixels with texture, of all pairs.
        inside: share of pixels whose match lies inside the right image, under ``network``.
        collapsed: share of the maps of ``network`` that are nearly constant or nearly zero.
        pairs: how many pairs there are.
        kept_back: what further pairs without labels say of the network found, None where there are none.
        network: whose maps were looked at: the best of the networks ranked, or what a search found.
    """

    agreement: Agreement | None
    stability: float
    texture: float
    inside: float
    collapsed: float
    pairs: int
    kept_back: KeptBack | None = None
    network: str = BEST

    @property
    def doubts(self) -> tuple[str, ...]:
        """Why not to trust it, each in words; none where nothing speaks against it."""
        found = []
        one = self.agreement
        if one is not None and one.interval[0] < CORRELATION:
            low, high = one.interval
            found.append(
                f"over {one.networks} networks it ranks as {one.metric} with a correlation of "
                f"{one.correlation:.2f} ({low:.2f} to {high:.2f}, its lower end expected at {CORRELATION} or "
                f"more), and its pick is {_regret(one)} worse than the best"
            )
        if self.pairs < FEW_PAIRS:
            found.append(f"{self.pairs} pair{'s' * (self.pairs != 1)} can be overfitted, as labels can")
        if self.pairs > 1 and math.isnan(self.stability):
            found.append("the pairs do not tell the networks apart")
        if self.stability < STABILITY:
            found.append(
                f"halves of the pairs rank the networks with a correlation of {self.stability:.2f} "
                f"(expected {STABILITY} or more): add pairs"
            )
        if self.texture < TEXTURE:
            found.append(f"{100 * self.texture:.0f} % of the pixels have texture, the rest tells nothing")
        if self.inside < INSIDE:
            found.append(
                f"under {self.network} {100 * self.inside:.0f} % of matches lie inside the image "
                f"(expected {100 * INSIDE:.0f} % or more)"
            )
        if self.collapsed > 0:
            found.append(
                f"{100 * self.collapsed:.0f} % of the maps of {self.network} are nearly constant or zero: "
                "it may win where images have no texture"
            )
        back = self.kept_back
        # The equal mixture itself, where a search found that, changes nothing against itself.
        if back is not None and back.further >= 0 and (back.guiding, back.further) != (0.0, 0.0):
            found.append(f"{back.sentence} (expected below 0)")
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
        back = self.kept_back
        if self.agreement is None:
            tested = "pairs kept back from the search would tell more" if back is None else back.sentence
            return (
                "Nothing speaks against the ranking without labels (stability over halves of the pairs "
                f"{self.stability:.2f}; {tested}); without labels that is no proof."
            )
        one = self.agreement
        return (
            f"The ranking without labels agrees with {one.metric}: correlation {one.correlation:.2f} "
            f"({one.interval[0]:.2f} to {one.interval[1]:.2f}) over {one.networks} networks, its pick "
            f"{_regret(one)} worse than the best."
        )


def _regret(one: Agreement) -> str:
    low, high = one.regret_interval
    return f"{one.regret:.2f} ({low:.2f} to {high:.2f})"


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
        found.append(rank_correlation(scores[:, first].mean(axis=1), scores[:, second].mean(axis=1)))
    # Halves under which all networks score alike tell nothing.
    return float(np.nanmean(found)) if not np.isnan(found).all() else float("nan")


def is_collapsed(disparity: NDArray[np.floating[Any]]) -> bool:
    """True where a map (H, W) in pixels is nearly constant or nearly zero."""
    # Not the extremes: a few wild pixels would hide that a map is flat.
    low, high = np.percentile(disparity, (5, 95))
    return bool(high - low < FLAT or high < FLAT)


def signs_of(sample: Sample, disparity: NDArray[np.float32]) -> tuple[float, float, bool]:
    """Of a pair and a map (H, W) in pixels: shares with texture and inside, and whether it is collapsed."""
    target = CensusTarget(sample.left, sample.right)
    finite = bool(np.isfinite(disparity).all())
    # Percentiles of NaN compare as false: such a map would pass for sound.
    return target.texture, target.residual(disparity).inside, not finite or is_collapsed(disparity)


def trust(
    scorers: Evaluator | Sequence[Evaluator],
    recipes: Sequence[Recipe],
    *,
    labelled: Evaluator | None = None,
    found: Recipe | None = None,
    found_in: Pool | None = None,
    further: Sequence[Evaluator] = (),
    seed: int = 0,
) -> Trust:
    """Look at the ranking of networks by ``census``; whatever the stores have is not computed again.

    Args:
        scorers: of the pairs without labels, by ``census``; several are looked at as one set of pairs.
        recipes: the networks, such as :func:`~sfkit.analysis.ranking.yardstick_recipes`.
        labelled: where labels are at hand, a scorer of the same pool by a metric that needs them. Compared
            are all networks that the stores hold under both, whoever asked for them.
        found: what a search guided by these pairs found. Its maps are looked at, instead of the best
            network's where it is better, and it is scored on ``further`` as well.
        found_in: its pool, where that is another than the scorers', such as one of prepared task vectors.
        further: scorers by ``census`` of pairs that guided nothing.
        seed: of the draws behind interval and halves.

    Raises:
        InputError: another metric, no network, or with labels fewer than eight.
    """
    parts = (scorers,) if isinstance(scorers, Evaluator) else tuple(scorers)
    for part in (*parts, *further):
        if part.metric.name != CENSUS.name:
            raise InputError(f"trust: found the metric {part.metric}, expected a scorer by census")
    if not (parts and recipes):
        raise InputError("trust: found no scorer or no network, expected those that were scored")
    evaluations = [part.evaluate(recipes) for part in parts]
    sound = [n for n in range(len(recipes)) if not any(row[n].failure for row in evaluations)]
    if not sound:
        raise InputError("trust: every network failed, expected one that was scored")
    # Pairs of all guides in one row: they are looked at as one set.
    table = np.array([[i.value(CENSUS) for row in evaluations for i in row[n].images] for n in sound])
    agreed = None
    if labelled is not None:
        labelled.evaluate(recipes)
        census, truth = scored_by_both(parts, labelled)
        agreed = agreement(census, truth, f"{labelled.metric} on {labelled.benchmark.name}", seed=seed)
    means = table.mean(axis=1)
    best = int(means.argmin())
    theirs, tests = (
        [one if found_in is None else one.with_pool(found_in) for one in scorers]
        for scorers in (parts, further)
    )
    seen = _looked_at(parts, recipes[sound[best]], float(means[best]), theirs, found)
    # Of two networks the one that speaks more against the ranking.
    network, (texture, inside, collapsed) = max(seen.items(), key=lambda one: (one[1][2], -one[1][1]))
    kept = None if found is None else _kept_back((parts, further), (theirs, tests), found)
    steady = stability(table, seed=seed)
    return Trust(agreed, steady, texture, inside, collapsed, table.shape[1], kept, network)


def trust_of(
    pool: Pool,
    evaluators: Sequence[Evaluator],
    found: Recipe | None = None,
    tests: Sequence[Evaluator] = (),
    *,
    found_in: Pool | None = None,
) -> Trust | None:
    """Whether the guides without labels among all guides may be trusted; None where there is none.

    Looks at the networks every pool has (:func:`~sfkit.analysis.ranking.yardstick_recipes`); a guide with
    labels beside them says how well they agree, over these and all networks that were scored by both. The
    network ``found`` (of the pool ``found_in``, where that is another) shows its maps; tests without labels
    say whether it is better there, too.

    Warns (:class:`~sfkit.errors.SfkitWarning`) where something speaks against it, with the sentence.
    """
    verdict = _trust_of(pool, evaluators, found, tests, found_in=found_in)
    if verdict is not None and verdict.doubts:
        warnings.warn(verdict.sentence, SfkitWarning, stacklevel=2)
    return verdict


def trust_sentences(scorer: Evaluator | CombinedScorer) -> tuple[str, ...]:
    """The sentence of :func:`trust_of` on what guides, for a page; none where every guide has labels."""
    evaluators = evaluators_of(scorer)
    found = _trust_of(evaluators[0].pool, evaluators) if evaluators else None
    return () if found is None else (found.sentence,)


def _trust_of(
    pool: Pool,
    evaluators: Sequence[Evaluator],
    found: Recipe | None = None,
    tests: Sequence[Evaluator] = (),
    *,
    found_in: Pool | None = None,
) -> Trust | None:
    unlabelled = [one for one in evaluators if one.metric.name == CENSUS.name]
    if not unlabelled:
        return None
    recipes = list(yardstick_recipes(pool).values())
    labelled = next((one for one in evaluators if one.metric.needs_truth), None)
    if labelled is not None:
        for one in (*unlabelled, labelled):
            one.evaluate(recipes)
        if len(scored_by_both(unlabelled, labelled)[0]) < FEW_NETWORKS:
            labelled = None  # a pool of two sources that nothing searched: no correlation to speak of
    further = [one for one in tests if one.metric.name == CENSUS.name]
    return trust(unlabelled, recipes, labelled=labelled, found=found, found_in=found_in, further=further)


def _kept_back(
    usual: Sequence[Sequence[Evaluator]], theirs: Sequence[Sequence[Evaluator]], found: Recipe
) -> KeptBack | None:
    """Of what guided and of further pairs, in the equal mixture's pool and in that of what was found.

    None without further pairs, or where a network failed on some.
    """
    changes = []
    # Both networks on both sets of pairs: what a search gained may be those that guided it.
    for scorers, others in zip(usual, theirs, strict=True):
        before, after = [], []
        for one, other in zip(scorers, others, strict=True):
            uniform, ours = one.evaluate([one.pool.uniform()])[0], other.evaluate([found])[0]
            if uniform.failure or ours.failure:
                return None
            before += [image.value(CENSUS) for image in uniform.images]
            after += [image.value(CENSUS) for image in ours.images]
        if not before:
            return None
        changes.append(float(np.mean(after) - np.mean(before)))
    return KeptBack(changes[0], changes[1], len(after))


def _looked_at(
    parts: Sequence[Evaluator],
    best: Recipe,
    score: float,
    theirs: Sequence[Evaluator],
    found: Recipe | None,
) -> dict[str, list[float]]:
    """Whose maps were looked at -> signs: what was found, and the best network where that is better."""
    scored = [] if found is None else [one.evaluate([found])[0] for one in theirs]
    if found is None or any(one.failure for one in scored):
        return {BEST: _seen(parts, best)}
    signs = {FOUND: _seen(theirs, found)}
    # A search that other guides led as well may end above the best by census.
    ours = float(np.mean([image.value(CENSUS) for one in scored for image in one.images]))
    return signs if ours <= score else {**signs, BEST: _seen(parts, best)}


def _seen(parts: Sequence[Evaluator], recipe: Recipe) -> list[float]:
    """Over all pairs, shares of pixels with texture and inside, and of maps that are collapsed."""
    rows = []
    for part in parts:
        live = part.compute.model(part.pool, recipe)
        for sample, pair in part.prepared:
            map_ = pair.window.crop(live.disparity(pair.left, pair.right)).numpy()
            rows.append(signs_of(sample, map_))
    shares: list[float] = np.mean(rows, axis=0).tolist()
    return shares
