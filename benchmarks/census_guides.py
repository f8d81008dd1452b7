"""Both stages on the real AnyNet pool, guided by unlabelled pairs and by labelled ones at equal budget.

    python benchmarks/census_guides.py --json

Needs SFKIT_REAL_DATA. The unlabelled guide is all five pairs by ``census``; the labelled ones are one pair,
and three, by bad-1.0. AdaMerging's entropy, the other guide without labels, sees the same five pairs. True
errors are over all pixels with ground truth. Everything scored is kept in a store: started again it goes on
where it was.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import evidence_real
import torch
from stages import answered, both

import sfkit
from sfkit import baselines
from sfkit.merging import Recipe

GUIDES: dict[str, tuple[str, tuple[str, ...]]] = {
    "five unlabelled": ("census", evidence_real.PAIRS),
    "one labelled": ("bad-1.0", ("eth3d",)),
    "three labelled": ("bad-1.0", ("eth3d", "cones", "motorcycle")),
}
TRUE = "bad-1.0"
ENTROPY = ("adamerging_blocks",)


def measure(seeds: int, evaluations: int, store: Path) -> list[dict[str, Any]]:
    """One row a network: what guided it, the seed, its subset, and its true error on each pair in percent."""
    torch.set_num_threads(1)
    pool, benchmarks = evidence_real.opened(), evidence_real.benchmarks()
    store.parent.mkdir(parents=True, exist_ok=True)
    rows = []
    with sfkit.EvaluationStore(store) as kept:
        judges = {name: sfkit.Evaluator(pool, b, store=kept, metric=TRUE) for name, b in benchmarks.items()}

        def row(guide: str, stage: str, seed: int, recipe: Recipe) -> dict[str, Any]:
            scores = {name: judge([recipe])[0].score for name, judge in judges.items()}
            return {"guide": guide, "stage": stage, "seed": seed, "sources": list(recipe.sources), **scores}

        rows.append(row("", "base", 0, pool.base_recipe()))
        rows.append(row("", "uniform", 0, pool.uniform()))
        rows += [row("", name, 0, pool.equal(name)) for name in pool.names]
        seen = sfkit.CombinedScorer(
            [sfkit.Evaluator(pool, b, store=kept, metric="census") for b in benchmarks.values()]
        )
        for method in ENTROPY:
            entry = baselines.baseline_named(method)
            rows.append(row("entropy of five unlabelled", entry.label, 0, entry(pool, seen).recipe))
        for seed in range(seeds):
            for guide, (metric, names) in GUIDES.items():
                scorers = [sfkit.Evaluator(pool, benchmarks[n], store=kept, metric=metric) for n in names]
                scorer = scorers[0] if len(scorers) == 1 else sfkit.CombinedScorer(scorers)
                first, second = both(pool, scorer, seed, population=8, generations=3, evaluations=evaluations)
                rows.append(row(guide, "Stage 1", seed, first.run().recipe))
                rows.append(row(guide, "Stage 1+2", seed, second.run().recipe))
    return rows


OPTIONS = {"seeds": 2, "evaluations": 150, "store": Path("runs/census_guides.sqlite")}
"""Of the command line."""

if __name__ == "__main__":
    answered(__doc__, measure, OPTIONS)
