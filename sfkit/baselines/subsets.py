"""Subsets with equal weights: at random, all of them, by Stage 1; then Stage 2; then the averaged winner."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations

from sfkit.baselines.registry import Choice, baseline
from sfkit.baselines.trials import Trials, lowest
from sfkit.errors import InputError
from sfkit.search import (
    RoutingCandidate,
    RoutingSearch,
    RoutingSettings,
    SubsetCandidate,
    SubsetSearch,
    SubsetSettings,
)
from sfkit.search.averaging import AVERAGED, averaged_winner, check_averaging
from sfkit.search.checks import RESAMPLES, check_resamples
from sfkit.streams import Stream, generator

MOST = 4096
"""Subsets that exhaustive search scores at most: those of 12 sources."""

STEREOFACTORY = "StereoFactory"


@baseline("random_subsets", label="random subsets", paper="")
def random_subsets(trials: Trials, *, budget: int = 800, seed: int = 0) -> Choice:
    """The best of ``budget`` different subsets drawn at random, each as likely as any other.

    Args:
        trials: the run.
        budget: subsets to score; Stage 1's number of evaluations makes the comparison fair.
        seed: of the draws.

    Raises:
        InputError: a budget below 1, or fewer than two sources.
    """
    names = trials.pool.names
    if budget < 1:
        raise InputError(f"budget: found {budget}, expected at least 1 evaluation")
    _require_two(names)
    rng, drawn = generator(seed, Stream.RANDOM_SUBSETS), dict[tuple[str, ...], None]()
    # All there are in a small pool, where draws of new ones would never end.
    while len(drawn) < min(budget, 2 ** len(names) - 1 - len(names)):
        # By a coin for each source: so all subsets are equally likely, where a size drawn first favours small
        # and large.
        inside = rng.random(len(names)) < 0.5
        if inside.sum() >= 2:
            drawn[tuple(name for name, taken in zip(names, inside, strict=True) if taken)] = None
    return _best(trials, list(drawn))


@baseline("exhaustive", label="best subset (exhaustive)", paper="", on_request=True)
def exhaustive(trials: Trials, *, most: int = MOST) -> Choice:
    """The best of all subsets of two or more sources: what Stage 1 could find at most.

    Raises:
        InputError: more subsets than ``most``, or fewer than two sources.
    """
    names = trials.pool.names
    _require_two(names)
    # But the empty one and single sources.
    count = 2 ** len(names) - 1 - len(names)
    if count > most:
        raise InputError(
            f"exhaustive: {len(names)} sources have {count:,} subsets, expected at most {most:,}: "
            f"allow more (most={count}), or leave it to Stage 1"
        )
    return _best(trials, [c for size in range(2, len(names) + 1) for c in combinations(names, size)])


@baseline("stage1", label="Stage 1", paper=f"{STEREOFACTORY}, Algorithm 1")
def stage1(
    trials: Trials,
    *,
    population: int = 50,
    generations: int = 15,
    seed: int = 0,
    which: SubsetSettings | None = None,
) -> Choice:
    """The genetic algorithm over subsets, merged with equal weights.

    Args:
        trials: the run.
        population: M.
        generations: T_1.
        seed: of the draws.
        which: all settings of Stage 1, in place of these three.
    """
    which = which or SubsetSettings(population=population, generations=generations, seed=seed)
    _, best = _stage1(trials, which)
    return Choice(best.recipe, settings={"subset": best.subset})


@baseline("stage1_2", label="Stage 1+2", paper=f"{STEREOFACTORY}, Algorithms 1 and 2")
def stage1_2(
    trials: Trials,
    *,
    population: int = 50,
    generations: int = 15,
    evaluations: int = 300,
    seed: int = 0,
    which: SubsetSettings | None = None,
    how: RoutingSettings | None = None,
) -> Choice:
    """Stage 1, then CMA-ES over routing weights and module scales; its evaluations are those of both.

    Args:
        trials: the run.
        population: M.
        generations: T_1.
        evaluations: N_eval.
        seed: of the draws of both stages.
        which: all settings of Stage 1, in place of those above.
        how: all settings of Stage 2, in place of those above.
    """
    which = which or SubsetSettings(population=population, generations=generations, seed=seed)
    _, first = _stage1(trials, which)
    _, best = _stage2(trials, first.subset, how or RoutingSettings(evaluations=evaluations, seed=seed))
    return Choice(best.recipe, settings={"subset": first.subset})


@baseline("averaged", label=AVERAGED, paper="Breiman, Machine Learning 1996", on_request=True)
def averaged(
    trials: Trials,
    *,
    population: int = 50,
    generations: int = 15,
    evaluations: int = 300,
    resamples: int = RESAMPLES,
    seed: int = 0,
    which: SubsetSettings | None = None,
    how: RoutingSettings | None = None,
) -> Choice:
    """Both stages, then the average of what wins resamples of the validation pairs: one evaluation more.

    Args:
        trials: the run.
        population: M.
        generations: T_1.
        evaluations: N_eval.
        resamples: of the validation pairs.
        seed: of the draws of both stages, and of the resamples.
        which: all settings of Stage 1, in place of those above.
        how: all settings of Stage 2, in place of those above.

    Raises:
        InputError: as :func:`~sfkit.search.averaging.averaged_winner`, before either stage begins, or a
            setting that no average can keep to, such as a hold-out.
    """
    how = how or RoutingSettings(evaluations=evaluations, seed=seed)
    check_averaging(trials.validation)
    check_resamples(resamples, how)
    which = which or SubsetSettings(population=population, generations=generations, seed=seed)
    first, best = _stage1(trials, which)
    second, _ = _stage2(trials, best.subset, how)
    # Both stages were scored pair by pair: what wins a resample is known without another evaluation.
    found = averaged_winner([first, second], trials.validation, resamples, seed=seed)
    trials.score([found.recipe], [{"stage": "average"}])
    return Choice(found.recipe, settings={"winners": len(found.wins)})


def _stage1(trials: Trials, settings: SubsetSettings) -> tuple[SubsetSearch, SubsetCandidate]:
    search = SubsetSearch(trials.pool.names, trials.pool.blocks, trials.validation, settings)
    best = search.run()
    trials.adopt(search.history.assign(stage="Stage 1"), [c.outcome for c in search.candidates])
    return search, best


def _stage2(
    trials: Trials, subset: Sequence[str], settings: RoutingSettings
) -> tuple[RoutingSearch, RoutingCandidate]:
    search = RoutingSearch(subset, trials.pool.blocks, trials.validation, settings)
    best = search.run()
    trials.adopt(search.history.assign(stage="Stage 2"), [c.outcome for c in search.candidates])
    return search, best


def _best(trials: Trials, subsets: list[tuple[str, ...]]) -> Choice:
    recipes = [trials.pool.equal(*subset) for subset in subsets]
    chosen = recipes[lowest(trials.score(recipes))]
    return Choice(chosen, settings={"subset": chosen.sources})


def _require_two(names: tuple[str, ...]) -> None:
    if len(names) < 2:
        raise InputError(f"sources: found {len(names)}, expected at least two to choose among")
