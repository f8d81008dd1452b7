"""Both stages on the embedded bank: each world guided by its own unlabelled pairs, beside labels.

    python benchmarks/census_bank.py [--pool bank] --json

The first pairs of a world guide by ``census``, by their own labels, or those of the validation world do by
labels; further pairs of the world, which guided nothing, judge by bad-3.0. Everything scored is kept in a
store: started again it goes on where it was.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from stages import answered, both

import sfkit
from sfkit import bank, baselines
from sfkit.analysis.ranking import yardstick_recipes
from sfkit.analysis.trust import trust
from sfkit.datasets import Benchmark
from sfkit.merging import Recipe

TRUE = "bad-3.0"
POPULATION, GENERATIONS = 16, 6
UNLABELLED, LABELLED, OTHER = "own unlabelled", "own labelled", f"labelled {bank.VALIDATION}"
ENTROPY = "own unlabelled, entropy"


def measure(pool: str, seeds: int, pairs: int, evaluations: int, store: Path) -> list[dict[str, Any]]:
    """One row a network and world: what guided it, its true error in percent, and what trust says."""
    torch.set_num_threads(1)
    opened, rows = sfkit.open_pool(pool), []
    store.parent.mkdir(parents=True, exist_ok=True)
    with sfkit.EvaluationStore(store) as kept:

        def scorer(benchmark: Benchmark, metric: str) -> sfkit.Evaluator:
            return sfkit.Evaluator(opened, benchmark, store=kept, metric=metric, also=[TRUE, "census"])

        def searched(guide: sfkit.Evaluator, seed: int) -> Recipe:
            _, second = both(
                opened, guide, seed, population=POPULATION, generations=GENERATIONS, evaluations=evaluations
            )
            return second.run().recipe

        validation = scorer(bank.benchmark(bank.VALIDATION).first(pairs), TRUE)
        for world in bank.benchmarks():
            whole = bank.benchmark(world)
            guides = {
                UNLABELLED: scorer(whole.first(pairs), "census"),
                LABELLED: scorer(whole.first(pairs), TRUE),
                OTHER: validation,
            }
            judge = scorer(whole.select(whole.ids[pairs : 3 * pairs]), TRUE)
            found = {("", "base", 0): opened.base_recipe(), ("", "uniform", 0): opened.uniform()}
            for seed in range(seeds):
                for name, guide in guides.items():
                    found[name, "Stage 1+2", seed] = searched(guide, seed)
            adapted = baselines.baseline_named("adamerging_blocks")(opened, guides[UNLABELLED])
            found[ENTROPY, "AdaMerging per block", 0] = adapted.recipe
            for (guide, stage, seed), recipe in found.items():
                score = judge([recipe])[0].score
                rows.append({"world": world, "guide": guide, "stage": stage, "seed": seed, "score": score})
            rows += _sentences(world, guides[UNLABELLED], guides[LABELLED])
    return rows


def _sentences(world: str, unlabelled: sfkit.Evaluator, labelled: sfkit.Evaluator) -> list[dict[str, Any]]:
    """What is said of the guide without labels: by its own signs, and by the labels of its pairs."""
    recipes = list(yardstick_recipes(unlabelled.pool).values())
    rows = []
    for stage, judge in (("trust, without labels", None), ("trust, with labels", labelled)):
        said = trust(unlabelled, recipes, labelled=judge).sentence
        rows.append({"world": world, "guide": UNLABELLED, "stage": stage, "sentence": said})
    return rows


OPTIONS = {
    "pool": "bank",
    "seeds": 2,
    "pairs": 8,
    "evaluations": 80,
    "store": Path("runs/census_bank.sqlite"),
}
"""Of the command line: pairs guide, and twice as many judge."""

if __name__ == "__main__":
    answered(__doc__, measure, OPTIONS)
