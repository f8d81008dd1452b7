"""Optuna's samplers at our tasks: TPE and GP on subsets, GP and CMA-ES on routing vectors."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import optuna
from landscapes import Landscape
from stage2_worlds import SearchWorld

from sfkit.search.encoding import Encoding

optuna.logging.set_verbosity(optuna.logging.ERROR)

PENALTY = 100.0
"""Percent: what the empty subset scores, which no network stands for."""
REACH = 2.0
"""Bounds of every entry of x, which Optuna needs: weights up to e^4 apart, scales in [0.43, 1.57]."""

Sampler = Callable[[int], optuna.samplers.BaseSampler]


def on_subsets(sampler: Sampler, evaluations: int) -> Callable[[Landscape, int], list[int]]:
    """A search over N switches; it ends at the optimum, which no sampler knows.

    Args:
        sampler: seed -> sampler.
        evaluations: distinct subsets at most; a study that repeats itself ends after twice as many trials.
    """

    def run(land: Landscape, seed: int) -> list[int]:
        met: list[int] = []
        study = optuna.create_study(sampler=sampler(seed))
        for _ in range(2 * evaluations):
            trial = study.ask()
            bits = [trial.suggest_categorical(name, (False, True)) for name in land.names]
            mask = sum(1 << n for n, bit in enumerate(bits) if bit)
            score = land.scores.get(mask, PENALTY)
            study.tell(trial, score)
            if mask:
                met.append(mask)
            if (score == land.best and mask.bit_count() >= 2) or len(set(met)) >= evaluations:
                break
        return met

    return run


def tpe(seed: int) -> optuna.samplers.BaseSampler:
    """Optuna's default."""
    return optuna.samplers.TPESampler(seed=seed)


def gp(seed: int) -> optuna.samplers.BaseSampler:
    """Optuna's Gaussian process."""
    return optuna.samplers.GPSampler(seed=seed)


def cma(seed: int) -> optuna.samplers.BaseSampler:
    """Optuna's CMA-ES, by the library ``cmaes``, at its own first step size."""
    return optuna.samplers.CmaEsSampler(seed=seed)


def gp_sampler(world: SearchWorld, evaluations: int = 80) -> Iterator[float]:
    """Optuna's Gaussian process over x."""
    return _routed(gp, world, evaluations)


def cma_sampler(world: SearchWorld, evaluations: int = 150) -> Iterator[float]:
    """Optuna's CMA-ES over x."""
    return _routed(cma, world, evaluations)


def _routed(sampler: Sampler, world: SearchWorld, evaluations: int) -> Iterator[float]:
    """Zeros first, as in ours."""
    encoding = Encoding(world.subset, world.pool.blocks)
    names = [f"x{n}" for n in range(encoding.dimension)]
    study = optuna.create_study(sampler=sampler(world.seed))
    study.enqueue_trial(dict.fromkeys(names, 0.0))
    for _ in range(evaluations):
        trial: Any = study.ask()
        x = np.array([trial.suggest_float(name, -REACH, REACH) for name in names])
        score = world.scorer([encoding.decode(x)])[0].score
        study.tell(trial, score)
        yield score
