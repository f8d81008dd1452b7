"""Evaluations until the best of all subsets: ours, the model's, and other programs', on two landscapes.

    python benchmarks/optimum.py --minutes 30         # go on with what is missing, at most so long
    python benchmarks/optimum.py grown                # a part of it
    python benchmarks/optimum.py --list               # what there is to do, and what is done
    python benchmarks/results.py optimum              # write what is there into benchmarks/README.md

As ``search.py``, on the scores of all subsets of the embedded bank, where an evaluation is a look into a
table and only distinct ones count. Searches beside each other; the model's in batches for several workers;
and a pool that gains each source of the best subset in turn. pymoo, DEAP and Optuna take part where they are
installed (``make bench``).
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from bayesian import grown, in_batches, newcomers, run
from exhaustive import subset_scores
from kept import RUNS, Job, KeptRuns
from landscapes import Landscape
from search import Search, searches

LANDSCAPES = (20, 8)
"""Validation pairs; the table has the scores on the first 8 as quick ones."""
SEEDS, TOGETHER = 200, 10
"""Seeds of what costs little, and how many of them are one job."""
BATCHES, BATCH_SEEDS = (1, 2, 4, 16, 64), 40
GROWN_SEEDS = 3


@dataclass(frozen=True)
class Entry:
    """A search that competes.

    Attributes:
        search: landscape and seed -> the masks evaluated, in order.
        seeds: how many it is run from.
        together: how many of them are one job.
    """

    search: Search
    seeds: int = SEEDS
    together: int = TOGETHER


def entries() -> dict[str, Entry]:
    """Everything that is compared, by name."""
    found = {"sfkit, a model of the score": Entry(run)}
    for name, search in searches().items():
        found[name] = Entry(search, 1 if name == "greedy soup" else SEEDS)
    if importlib.util.find_spec("optuna"):
        from peers_optuna import gp, on_subsets, tpe

        found["Optuna TPE"] = Entry(on_subsets(tpe, 300))
        found["Optuna GP"] = Entry(on_subsets(gp, 100), 40, 1)
    if importlib.util.find_spec("sklearn") and importlib.util.find_spec("botorch"):
        from peers_models import botorch, scikit_learn, searched_by

        found["the same search by scikit-learn's model"] = Entry(searched_by(scikit_learn), 40, 5)
        found["the same search by BoTorch's model"] = Entry(searched_by(botorch), 40, 5)
    return found


def jobs() -> dict[str, Job]:
    """Name -> job: the first seeds of everything first."""
    found: list[tuple[int, str, Job]] = []
    for pairs in LANDSCAPES:
        for name, entry in entries().items():
            for first in range(0, entry.seeds, entry.together):
                seeds = range(first, min(first + entry.together, entry.seeds))
                job = partial(alone, name, entry.search, pairs, seeds)
                found.append((first, f"search-{pairs:02d}-{slug(name)}-{first:03d}", job))
        for batch in BATCHES:
            for first in range(0, BATCH_SEEDS, TOGETHER):
                seeds = range(first, first + TOGETHER)
                found.append(
                    (
                        first,
                        f"batch-{pairs:02d}-{batch:02d}-{first:03d}",
                        partial(batched, batch, pairs, seeds),
                    )
                )
        for seed in range(GROWN_SEEDS):
            found.append((TOGETHER * seed, f"grown-{pairs:02d}-{seed:03d}", partial(growing, pairs, seed)))
    return {name: job for _, name, job in sorted(found, key=lambda one: one[0])}


def slug(name: str) -> str:
    """A search's name as part of a file's."""
    return "".join(letter if letter.isalnum() else "_" for letter in name.lower())


def landscape(pairs: int) -> Landscape:
    """The scores on the first so many validation pairs."""
    return Landscape(subset_scores(), quick=pairs != LANDSCAPES[0])


def alone(name: str, search: Search, pairs: int, seeds: Sequence[int], _: Path) -> pd.DataFrame:
    """A row a seed: distinct evaluations until the optimum, infinite without; CPU seconds an evaluation."""
    land, rows = landscape(pairs), []
    for seed in seeds:
        began = time.process_time()
        curve = land.regrets(search(land, seed))
        seconds = (time.process_time() - began) / len(curve)
        rows.append((name, pairs, seed, curve.index(0.0) + 1 if 0.0 in curve else np.inf, seconds))
    return pd.DataFrame(rows, columns=["search", "pairs", "seed", "needed", "seconds"])


def batched(batch: int, pairs: int, seeds: Sequence[int], _: Path) -> pd.DataFrame:
    """The model's search by as many workers as a batch has."""
    return in_batches(landscape(pairs), batch, seeds).assign(batch=batch, pairs=pairs)


def growing(pairs: int, seed: int, _: Path) -> pd.DataFrame:
    """A row a newcomer and way."""
    land = landscape(pairs)
    rows = [
        (pairs, seed, newcomer, *row) for newcomer in newcomers(land) for row in grown(land, newcomer, seed)
    ]
    return pd.DataFrame(rows, columns=["pairs", "seed", "newcomer", "way", "needed"])


kept = KeptRuns(__doc__, jobs, RUNS / "optimum")

if __name__ == "__main__":
    kept.main()
