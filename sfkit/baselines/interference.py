"""Methods against interference between task vectors: TIES, DARE, and both."""

from __future__ import annotations

import math
import statistics
from collections.abc import Sequence
from itertools import product

from sfkit.baselines.registry import Choice, Network, baseline
from sfkit.baselines.trials import Trials, lowest
from sfkit.errors import InputError
from sfkit.merging.pool import Pool
from sfkit.merging.prepare import prepare
from sfkit.merging.recipe import Recipe
from sfkit.merging.sparsity import Thresholds
from sfkit.merging.steps import Drop, Elect, Mean, Step, Trim

DENSITIES = (0.1, 0.2, 0.3, 0.5)
STRENGTHS = (0.2, 0.3, 0.5, 0.8, 1.0, 1.3, 1.8, 2.5)
"""TIES was tuned from 0.8 to 2.5, and is run untuned at 1; smaller ones are for networks that break there."""
PROBABILITIES = (0.3, 0.5, 0.7, 0.9)


@baseline("ties", label="TIES", paper="Yadav et al., NeurIPS 2023")
def ties(
    trials: Trials,
    *,
    densities: Sequence[float] = DENSITIES,
    lambdas: Sequence[float] = STRENGTHS,
    per: str = "vector",
    zero: str = "majority",
) -> Choice:
    """Trim each source, elect signs, average what agrees; density and strength tuned on validation.

    Args:
        trials: the run.
        densities: shares of entries to keep.
        lambdas: what the elected task vector is multiplied by; running statistics stay convex.
        per: as for :class:`~sfkit.merging.steps.Trim`; the paper's ``"vector"``, mergekit's ``"tensor"``.
        zero: as for :class:`~sfkit.merging.steps.Elect`; the paper's ``"majority"``, mergekit's ``"plus"``.

    Raises:
        InputError: a density or strength out of its range.
    """
    # Before the first preparation, which reads every task vector.
    _check(lambdas, "lambdas", densities, "densities")
    known, tried = Thresholds(), []
    for density in densities:
        with trials.timed():
            pool = prepare(trials.pool, Trim(density, per), Elect(zero=zero), thresholds=known)
        recipes = [_strong(pool, strength) for strength in lambdas]
        about = [{"density": density, "lambda": strength} for strength in lambdas]
        scores = trials.score(recipes, about, pool=pool)
        tried += list(zip(scores, [pool] * len(recipes), recipes, about, strict=True))
    _, pool, recipe, chosen = tried[lowest([score for score, *_ in tried])]
    return Choice(recipe, pool, chosen)


@baseline("dare", label="DARE", paper="Yu et al., ICML 2024")
def dare(
    trials: Trials,
    *,
    probabilities: Sequence[float] = PROBABILITIES,
    lambdas: Sequence[float] = (1.0,),
    draws: int = 3,
    seed: int = 0,
) -> Choice:
    """Drop entries at random, enlarge the rest, average the sources; the mean over several draws is tuned.

    Args:
        trials: the run.
        probabilities: of an entry to be dropped.
        lambdas: what the mean of the dropped task vectors is multiplied by; E is task arithmetic with 1.
        draws: random networks at each setting; the first one is what the method would deploy.
        seed: of the first draw; the others follow.

    Raises:
        InputError: fewer than one draw, or a setting out of its range.
    """
    return _drawn(trials, Mean("dare"), probabilities, lambdas, draws, seed)


@baseline("dare_ties", label="DARE + TIES", paper="Yu et al., ICML 2024")
def dare_ties(
    trials: Trials,
    *,
    probabilities: Sequence[float] = PROBABILITIES,
    lambdas: Sequence[float] = (0.5, 1.0),
    draws: int = 3,
    seed: int = 0,
) -> Choice:
    """Drop entries at random, enlarge the rest, elect signs, average what agrees: dropping replaces trimming.

    The arguments are those of :func:`dare`.
    """
    return _drawn(trials, Elect("dare_ties"), probabilities, lambdas, draws, seed)


def _drawn(
    trials: Trials,
    last: Step,
    probabilities: Sequence[float],
    lambdas: Sequence[float],
    draws: int,
    seed: int,
) -> Choice:
    _check(lambdas, "lambdas", probabilities, "probabilities")
    if draws < 1:
        raise InputError(f"draws: found {draws}, expected at least 1")
    found: dict[tuple[float, float], list[tuple[float, Network]]] = {}
    for probability, draw in product(probabilities, range(draws)):
        # To prepare task vectors is the method's work, as scoring is.
        with trials.timed():
            # No two runs with different seeds share a draw's, for up to a thousand draws.
            pool = prepare(trials.pool, Drop(probability, 1000 * seed + draw), last)
        recipes = [_strong(pool, strength) for strength in lambdas]
        about = [{"probability": probability, "lambda": s, "draw": draw} for s in lambdas]
        for strength, recipe, score in zip(
            lambdas, recipes, trials.score(recipes, about, pool=pool), strict=True
        ):
            found.setdefault((probability, strength), []).append((score, Network(pool, recipe)))
    settings = list(found)
    means = [math.fsum(score for score, _ in found[setting]) / draws for setting in settings]
    # By the mean over draws: the best of single ones is luck, which another seed does not have.
    chosen, mean = settings[lowest(means)], min(means)
    scores = [score for score, _ in found[chosen]]
    networks = tuple(network for _, network in found[chosen])
    spread = f" ± {statistics.stdev(scores):.3f}" if draws > 1 and math.isfinite(mean) else ""
    return Choice(
        networks[0].recipe,
        networks[0].pool,
        {"probability": chosen[0], "lambda": chosen[1]},
        networks,
        f"validation {mean:.3f}{spread} over {draws} draw{'s' * (draws > 1)}",
    )


def _strong(pool: Pool, strength: float) -> Recipe:
    # The one vector that the last step made of all.
    return Recipe.weighted({pool.names[0]: strength}, pool.blocks)


def _check(lambdas: Sequence[float], name: str, grid: Sequence[float], of: str) -> None:
    if not lambdas or not grid:
        raise InputError(f"{of if lambdas else name}: found an empty grid, expected at least one value")
