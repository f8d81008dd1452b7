"""Both stages on the embedded bank: each world guided by its own unlabelled pairs, beside labels.

    python benchmarks/census_bank.py --json

The first pairs of a world guide by ``census``, by their own labels, or those of the validation world do by
labels; further pairs of the world, which guided nothing, judge by bad-3.0. Everything scored is kept in a
store: started again it goes on where it was.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import torch

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


def measure(seeds: int, pairs: int, evaluations: int, store: Path) -> list[dict[str, Any]]:
    """One row a network and world: what guided it, its true error in percent, and what trust says."""
    torch.set_num_threads(1)
    pool, rows = sfkit.open_pool("bank"), []
    store.parent.mkdir(parents=True, exist_ok=True)
    with sfkit.EvaluationStore(store) as kept:

        def scorer(benchmark: Benchmark, metric: str) -> sfkit.Evaluator:
            return sfkit.Evaluator(pool, benchmark, store=kept, metric=metric, also=[TRUE, "census"])

        def searched(guide: sfkit.Evaluator, seed: int) -> Recipe:
            stage1 = sfkit.SubsetSettings(population=POPULATION, generations=GENERATIONS, seed=seed)
            subset = sfkit.SubsetSearch(pool.names, pool.blocks, guide, stage1).run().subset
            stage2 = sfkit.RoutingSettings(evaluations=evaluations, converge=False, seed=seed)
            return sfkit.RoutingSearch(subset, pool.blocks, guide, stage2).run().recipe

        validation = scorer(bank.benchmark(bank.VALIDATION).first(pairs), TRUE)
        for world in bank.benchmarks():
            whole = bank.benchmark(world)
            guides = {
                UNLABELLED: scorer(whole.first(pairs), "census"),
                LABELLED: scorer(whole.first(pairs), TRUE),
                OTHER: validation,
            }
            judge = scorer(whole.select(whole.ids[pairs : 3 * pairs]), TRUE)
            found = {("", "base", 0): pool.base_recipe(), ("", "uniform", 0): pool.uniform()}
            for seed in range(seeds):
                for name, guide in guides.items():
                    found[name, "Stage 1+2", seed] = searched(guide, seed)
            adapted = baselines.baseline_named("adamerging_blocks")(pool, guides[UNLABELLED])
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


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print a table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seeds", type=int, default=2)
    parser.add_argument("--pairs", type=int, default=8, help="that guide; twice as many judge")
    parser.add_argument("--evaluations", type=int, default=80, help="of Stage 2")
    parser.add_argument("--store", type=Path, default=Path("runs/census_bank.sqlite"))
    parser.add_argument("--json", action="store_true", help="print a JSON list of records")
    options = vars(parser.parse_args(arguments))
    as_json = options.pop("json")
    rows = measure(**options)
    if as_json:
        print(json.dumps(rows, indent=2))
        return
    for row in rows:
        print(
            "  ".join(
                f"{value:8.2f}" if isinstance(value, float) else f"{value:16}" for value in row.values()
            )
        )


if __name__ == "__main__":
    main()
