"""Single sources, the mean of all, and task arithmetic."""

from __future__ import annotations

import math
from collections.abc import Sequence

from sfkit.baselines.registry import Choice, baseline
from sfkit.baselines.trials import Trials, Validation, lowest
from sfkit.errors import InputError
from sfkit.merging.recipe import Recipe

LAMBDAS = tuple(round(0.05 * step, 2) for step in range(1, 21))
"""0.05 to 1 in steps of 0.05; 1/E always joins them."""


@baseline("single_best", label="single best (validation)", paper="StereoFactory, section V")
def single_best(trials: Trials) -> Choice:
    """The source that scores best on validation: what one would deploy without merging."""
    recipes = [trials.pool.equal(name) for name in trials.pool.names]
    chosen = lowest(trials.score(recipes))
    return Choice(recipes[chosen], settings={"source": trials.pool.names[chosen]})


@baseline(
    "single_best_oracle",
    label="single best (oracle)",
    paper="StereoFactory, section V",
    tuned_on_validation=False,
    oracle=True,
)
def single_best_oracle(trials: Trials, *, tests: Sequence[Validation] = ()) -> Choice:
    """The source with the best mean over all benchmarks of the report: it needs their answers.

    Raises:
        InputError: no benchmark to look at.
    """
    if not tests:
        raise InputError("single_best_oracle: found no tests, expected evaluators of the report's benchmarks")
    recipes = [trials.pool.equal(name) for name in trials.pool.names]
    trials.score(recipes)
    # A network that fails on one test cannot be the best.
    table = [[math.inf if o.failed else o.score for o in test(recipes)] for test in tests]
    chosen = lowest([math.fsum(column) / len(tests) for column in zip(*table, strict=True)])
    note = f"chosen by the {len(tests)} benchmarks it is reported on"
    return Choice(recipes[chosen], settings={"source": trials.pool.names[chosen]}, note=note)


@baseline(
    "uniform", label="uniform", paper="Wortsman et al., ICML 2022 (uniform soup)", tuned_on_validation=False
)
def uniform(trials: Trials) -> Choice:
    """The mean of all sources."""
    recipe = trials.pool.uniform()
    trials.score([recipe])
    return Choice(recipe)


@baseline("task_arithmetic", label="task arithmetic", paper="Ilharco et al., ICLR 2023")
def task_arithmetic(trials: Trials, *, lambdas: Sequence[float] = LAMBDAS) -> Choice:
    """Base plus lambda times the sum of all task vectors, one lambda tuned on validation.

    1/E joins the grid, which is the uniform merge: on validation this is never worse than that.
    """
    grid = lambda_grid(lambdas, len(trials.pool.names))
    recipes = [summed(trials, value) for value in grid]
    chosen = lowest(trials.score(recipes, [{"lambda": value} for value in grid]))
    return Choice(recipes[chosen], settings={"lambda": grid[chosen]})


def lambda_grid(lambdas: Sequence[float], sources: int) -> tuple[float, ...]:
    """The grid with 1/E in it, ascending.

    Raises:
        InputError: a value that is not above 0.
    """
    for value in lambdas:
        if not (math.isfinite(value) and value > 0):
            raise InputError(f"lambdas: found {value}, expected finite numbers above 0")
    # A set: a grid that names 1/E already has it once.
    return tuple(sorted({*map(float, lambdas), 1.0 / sources}))


def summed(trials: Trials, strength: float) -> Recipe:
    """Base plus ``strength`` times the sum of task vectors; running statistics stay convex."""
    if strength == 1.0 / len(trials.pool.names):
        return trials.pool.uniform()  # the same recipe, so that it is scored once
    return Recipe.weighted(dict.fromkeys(trials.pool.names, strength), trials.pool.blocks)
