"""Where ways to run Stage 2 compete: small benchmarks on the first bank and on the real AnyNet pool.

Forward passes are dear on two cores, so that every pair is cut to a window: what is compared is how soon a
search finds what is good on its own validation pairs, not how that holds elsewhere (``evidence.py``). All
windows have one size and pass the network together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import combinations, islice
from pathlib import Path

import numpy as np
from exhaustive import evaluated
from real_pairs import PAIRS, benchmarks, opened, window

import sfkit
from sfkit.bank import VALIDATION, benchmark
from sfkit.datasets import Benchmark, Sample
from sfkit.datasets.benchmark import memory_benchmark
from sfkit.evaluation.known import Known
from sfkit.evaluation.outcome import Outcome
from sfkit.merging import Pool
from sfkit.merging.live import LiveModel
from sfkit.merging.recipe import Recipe

BANK_PAIRS, BANK_WINDOW = 4, (96, 192)
REAL_PAIRS, REAL_WINDOW = 3, (192, 384)
BANK, REAL = "bank", "real"


class Together:
    """Scores as its evaluator would, all pairs of a recipe in one pass."""

    def __init__(self, evaluator: sfkit.Evaluator) -> None:
        self.evaluator, self.live = evaluator, LiveModel(evaluator.pool)

    def __call__(self, recipes: Sequence[Recipe]) -> list[Outcome]:
        """One outcome a recipe, in order."""
        found = [evaluated(self.evaluator, self.live, recipe) for recipe in recipes]
        return [Outcome(self.evaluator.score(one.images), one.seconds, key=one.key) for one in found]


@dataclass(frozen=True)
class SearchWorld:
    """A pool, what guides, and the subset that Stage 1 found there.

    Attributes:
        pool: whose sources are mixed.
        scorer: the validation pairs, with a store.
        stage1: finished.
        seed: of the pairs and of every search.
    """

    pool: Pool
    scorer: Together
    stage1: sfkit.BayesianSubsetSearch
    seed: int

    @property
    def subset(self) -> tuple[str, ...]:
        """Stage 1's best."""
        assert self.stage1.best is not None
        return self.stage1.best.subset

    @property
    def known(self) -> tuple[Known, ...]:
        """What Stage 1 evaluated."""
        return tuple(Known(c.recipe, c.score) for c in self.stage1.candidates if not c.repeated)


def world(kind: str, seed: int, store: sfkit.EvaluationStore) -> SearchWorld:
    """One draw of validation pairs, and Stage 1 by its model on them.

    Args:
        kind: ``BANK`` or ``REAL``; the latter needs SFKIT_REAL_DATA.
        seed: which pairs, and the searches' draws.
        store: keeps every evaluation.
    """
    pool, guide = (bank_pool(), bank_pairs(seed)) if kind == BANK else (opened(), real_pairs(seed))
    scorer = Together(sfkit.Evaluator(pool, guide, store=store))
    stage1 = sfkit.BayesianSubsetSearch(
        pool.names, pool.blocks, scorer, sfkit.BayesianSubsetSettings(seed=seed)
    )
    stage1.run()
    return SearchWorld(pool, scorer, stage1, seed)


@lru_cache
def bank_pool() -> Pool:
    """The first bank."""
    return sfkit.open_pool("bank")


def bank_pairs(seed: int) -> Benchmark:
    """Windows of the validation world's pairs, drawn by the seed."""
    known = benchmark(VALIDATION)
    drawn = np.random.default_rng([seed, 7]).permutation(len(known))[:BANK_PAIRS]
    pairs = [window(known.pairs[n].load(), BANK_WINDOW) for n in sorted(drawn)]
    return memory_benchmark(f"{VALIDATION}-windows", pairs, protocol=known.protocol, metric=known.metric)


def real_pairs(seed: int) -> Benchmark:
    """Windows of three of the five real pairs; the seed says which."""
    every = combinations(PAIRS, REAL_PAIRS)
    (names,) = islice(every, seed, seed + 1)
    found = real_samples()
    return memory_benchmark("real-windows", [found[name] for name in names], metric="bad-1.0")


@lru_cache
def real_samples() -> dict[str, Sample]:
    """A window of every real pair, by the data set's name."""
    return {
        name: replace(window(whole.pairs[0].load(), REAL_WINDOW), id=name)
        for name, whole in benchmarks().items()
    }


def store_in(folder: Path) -> sfkit.EvaluationStore:
    """Every evaluation of these comparisons."""
    return sfkit.EvaluationStore(folder / "evaluations.sqlite")
