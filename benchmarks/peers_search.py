"""pymoo's and DEAP's genetic algorithms on subsets as bit strings, 50 individuals, 15 generations."""

from __future__ import annotations

import random
from typing import Any

import numpy as np
from landscapes import Landscape

POPULATION = 50
GENERATIONS = 15
PENALTY = 100.0  # percent: what the empty subset scores, which no network stands for


def pymoo_ga(land: Landscape, seed: int) -> list[int]:
    """Pymoo's ``GA`` with its operators for bits and its removal of duplicates."""
    from pymoo.algorithms.soo.nonconvex.ga import GA
    from pymoo.core.problem import ElementwiseProblem
    from pymoo.operators.crossover.pntx import TwoPointCrossover
    from pymoo.operators.mutation.bitflip import BitflipMutation
    from pymoo.operators.sampling.rnd import BinaryRandomSampling
    from pymoo.optimize import minimize

    met: list[int] = []

    class Subsets(ElementwiseProblem):  # type: ignore[misc]
        def __init__(self) -> None:
            super().__init__(n_var=len(land.names), n_obj=1, xl=0, xu=1, vtype=bool)

        def _evaluate(self, x: Any, out: dict[str, float], *_: Any, **__: Any) -> None:
            out["F"] = _score(land, x, met)

    algorithm = GA(
        pop_size=POPULATION,
        sampling=BinaryRandomSampling(),
        crossover=TwoPointCrossover(),
        mutation=BitflipMutation(),
        eliminate_duplicates=True,
    )
    minimize(Subsets(), algorithm, ("n_gen", GENERATIONS + 1), seed=seed, verbose=False)
    return met


def deap_simple(land: Landscape, seed: int) -> list[int]:
    """DEAP's ``eaSimple`` with the paper's rates, two-point crossover, bit flips and binary tournaments."""
    from deap import algorithms, base, creator, tools

    if not hasattr(creator, "Loss"):
        creator.create("Loss", base.Fitness, weights=(-1.0,))
        creator.create("Subset", list, fitness=creator.Loss)
    met: list[int] = []
    state = random.getstate()  # DEAP draws from the global generator alone
    random.seed(seed)
    try:
        box = base.Toolbox()
        box.register("bit", random.randint, 0, 1)
        box.register("individual", tools.initRepeat, creator.Subset, box.bit, len(land.names))
        box.register("population", tools.initRepeat, list, box.individual)
        box.register("evaluate", lambda bits: (_score(land, bits, met),))
        box.register("mate", tools.cxTwoPoint)
        box.register("mutate", tools.mutFlipBit, indpb=1 / len(land.names))
        box.register("select", tools.selTournament, tournsize=2)
        people = box.population(n=POPULATION)
        algorithms.eaSimple(people, box, cxpb=0.8, mutpb=0.3, ngen=GENERATIONS, verbose=False)
    finally:
        random.setstate(state)
    return met


def _score(land: Landscape, bits: Any, met: list[int]) -> float:
    mask = int(sum(1 << n for n in np.flatnonzero(np.asarray(bits))))
    if not mask:
        return PENALTY
    met.append(mask)
    return float(land.scores[mask])
