"""CMA-ES (Hansen 2016, "The CMA Evolution Strategy: A Tutorial"), by pycma, as a function of a seed.

pycma seeds and draws from numpy's global state unless it is given ``randn`` and a ``seed`` of nan; here
iteration t draws from ``numpy.random.default_rng([seed, 2, t])`` and nothing global is touched (island i
of several: ``[seed, 2, i, t]``).
"""

from __future__ import annotations

import math
import warnings
from collections.abc import Sequence
from typing import Any

import numpy as np

from sfkit.search.encoding import Vector
from sfkit.search.routing_records import Distribution
from sfkit.streams import Stream, generator


def pycma() -> Any:
    """The library, with all of scipy's distributions behind it: imported when the first search starts."""
    with warnings.catch_warnings():
        # It warns on import where matplotlib, which it plots with, is not installed.
        warnings.filterwarnings("ignore", message="Could not import matplotlib", category=UserWarning)
        import cma
    return cma


def default_population(dimension: int) -> int:
    """4 + floor(3 ln n), pycma's and the tutorial's default."""
    return 4 + math.floor(3 * math.log(dimension))


class CmaEs:
    """Ask and tell; the same seed and the same fitness values give the same populations.

    Mirrored sampling, pycma's default for populations below 6, is off, so that every vector is an
    independent draw, as Algorithm 2 has it. Nothing is printed or written to files.
    """

    def __init__(
        self,
        mean: Vector,
        sigma: float,
        population: int,
        seed: int,
        *,
        tolfun: float,
        tolx: float,
        island: int = 0,
    ) -> None:
        """Begin at ``mean`` with C = I.

        Args:
            mean: n numbers, n >= 2.
            sigma: initial step size, above 0.
            population: vectors an iteration, at least 3.
            seed: at least 0.
            tolfun: stop condition, range of recent fitness values.
            tolx: stop condition, standard deviations of x.
            island: several searches under one seed have a number each, and draw from streams of their own.
        """
        self._seed, self._island = seed, (island,) if island else ()
        self._iteration = 0
        self._rng = self._fresh_generator()
        self._asked: list[Vector] = []
        options = {
            "popsize": population,
            # The search's own generator, anew for each iteration: nothing global is read, and a replay draws
            # alike.
            "randn": lambda rows, columns: self._rng.standard_normal((rows, columns)),
            # pycma seeds numpy's global state unless this is NaN.
            "seed": math.nan,
            # pycma would mirror samples in populations below 6; here all are plain draws.
            "CMA_mirrors": 0,
            "tolfun": tolfun,
            "tolx": tolx,
            "verbose": -10,
            "verb_disp": 0,
            "verb_log": 0,
        }
        self._es = pycma().CMAEvolutionStrategy(mean, sigma, options)
        self.distribution = self._read()
        self.stops: tuple[str, ...] = ()

    def ask(self) -> tuple[Vector, ...]:
        """The next population; ``distribution`` is then what it was drawn from."""
        self._iteration += 1
        self._rng = self._fresh_generator()
        self._asked = [np.asarray(x, dtype=np.float64) for x in self._es.ask()]
        self.distribution = self._read()
        # Copies: pycma is told of the very vectors it gave.
        return tuple(x.copy() for x in self._asked)

    def tell(self, fitness: Sequence[float]) -> None:
        """Learn from the population last asked for.

        ``stops`` then names the stop conditions of pycma that hold.

        Args:
            fitness: one finite value a vector, in order; lower is better.
        """
        self._es.tell(self._asked, list(fitness))
        self.stops = tuple(sorted(self._es.stop()))

    def _fresh_generator(self) -> np.random.Generator:
        return generator(self._seed, Stream.ROUTING_SEARCH, *self._island, self._iteration)

    def _read(self) -> Distribution:
        sigma = float(self._es.sigma)
        # D holds the roots of C's eigenvalues: these are standard deviations along the principal axes.
        axes = sorted(sigma * float(root) for root in self._es.sm.D)
        return Distribution(tuple(float(m) for m in self._es.mean), sigma, tuple(axes))


def finite_fitness(fitness: Sequence[float], worst: float) -> list[float]:
    """Fitness values CMA-ES can rank: a candidate without a finite one loses against every other.

    pycma accepts NaN and infinities without a word and computes on with them. Here such a candidate gets
    ``worst + 1``, the next ``worst + 2``, so that ties go to the earlier one.

    Args:
        fitness: one value a candidate; ``inf`` where it failed.
        worst: the worst finite fitness of the search so far, these candidates included.
    """
    # All different: equal ones would look like a flat function, on which CMA-ES stops.
    return [value if math.isfinite(value) else worst + 1.0 + i for i, value in enumerate(fitness)]
