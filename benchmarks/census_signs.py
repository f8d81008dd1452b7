"""What a guide without labels might betray of itself, beside what labels say of the network it found.

    python benchmarks/census_signs.py --json

The searches of census_bank.py and, with SFKIT_REAL_DATA, census_guides.py are run once more on their stores,
which costs next to nothing where those have run. Of every guide, without labels: how stable the ranking is
over halves of its pairs, of the networks every pool has and of those the search compared, and how much of
the gain over the equal mixture the best network on one half keeps on the other. Beside that, with labels: the
rank correlation, and the change against the equal mixture on the guide's own pairs and on further ones.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import census_bank
import census_guides
import evidence_real
import numpy as np
import torch
from numpy.typing import NDArray
from stages import answered

import sfkit
from sfkit import bank
from sfkit.analysis.ranking import rank_correlation, yardstick_recipes
from sfkit.analysis.trust import stability
from sfkit.evaluation.outcome import Outcome, Scorer
from sfkit.merging import Pool, Recipe

Table = NDArray[np.float64]
SPLITS = 200


class Remembering:
    """A scorer that remembers which recipes it was asked about."""

    def __init__(self, scorer: Scorer) -> None:
        self._scorer = scorer
        self.asked: dict[Recipe, None] = {}

    def __call__(self, recipes: Sequence[Recipe]) -> Sequence[Outcome]:
        self.asked |= dict.fromkeys(recipes)
        return self._scorer(recipes)


def table(scorers: Sequence[sfkit.Evaluator], recipes: Sequence[Recipe], metric: str) -> Table:
    """(networks, pairs), in percent."""
    rows = [scorer.evaluate(recipes) for scorer in scorers]
    return np.array([[i.value(metric) for row in rows for i in row[n].images] for n in range(len(recipes))])


def kept(scores: Table, uniform: Table) -> float:
    """Of the gain over ``uniform`` of the best on half of the pairs, the share it has on the other half."""
    rng, pairs = np.random.default_rng(0), scores.shape[1]
    here = there = 0.0
    for _ in range(SPLITS):
        order = rng.permutation(pairs)
        first, second = order[: pairs // 2], order[pairs // 2 :]
        best = int(scores[:, first].mean(axis=1).argmin())
        here += float((uniform[first] - scores[best, first]).mean())
        there += float((uniform[second] - scores[best, second]).mean())
    return there / here


def signs(
    name: str,
    pool: Pool,
    guides: Sequence[sfkit.Evaluator],
    truths: Sequence[sfkit.Evaluator],
    true: str,
    further: sfkit.Evaluator | None,
    stages: tuple[sfkit.SubsetSettings, sfkit.RoutingSettings],
) -> dict[str, Any]:
    """One guide: its signs, and what labels say of the network it found."""
    scorer = Remembering(guides[0] if len(guides) == 1 else sfkit.CombinedScorer(guides))
    subset = sfkit.SubsetSearch(pool.names, pool.blocks, scorer, stages[0]).run().subset
    found = sfkit.RoutingSearch(subset, pool.blocks, scorer, stages[1]).run().recipe
    usual, both = list(yardstick_recipes(pool).values()), [pool.uniform(), found]
    ours, labels = (table(by, usual, metric) for by, metric in ((guides, "census"), (truths, true)))
    searched = table(guides, list(scorer.asked), "census")
    change = {
        f"{which} on {where}": float(np.diff(table(by, both, metric).mean(axis=1))[0])
        for where, mine, theirs in (
            ("its pairs", guides, truths),
            *([("further pairs", [further], [further])] if further else []),
        )
        for which, by, metric in (("census", mine, "census"), (true, theirs, true))
    }
    return {
        "guide": name,
        "true": true,
        "correlation": rank_correlation(ours.mean(axis=1), labels.mean(axis=1)),
        "stability": stability(ours),
        "stability of the searched": stability(searched),
        "kept": kept(np.concatenate([ours, searched]), ours[usual.index(pool.uniform())]),
        "change": change,
    }


def on_the_bank(store: Path, pairs: int, evaluations: int) -> Iterator[dict[str, Any]]:
    """Each world guided by its own first pairs, as census_bank.py does; the next ones are further pairs."""
    pool, true = sfkit.open_pool("bank"), census_bank.TRUE
    stages = (
        sfkit.SubsetSettings(population=census_bank.POPULATION, generations=census_bank.GENERATIONS),
        sfkit.RoutingSettings(evaluations=evaluations, converge=False),
    )
    with sfkit.EvaluationStore(store) as kept_in:
        for world in bank.benchmarks():
            whole = bank.benchmark(world)
            own, further = whole.first(pairs), whole.select(whole.ids[pairs : 3 * pairs])
            guide, judge = (
                sfkit.Evaluator(pool, each, store=kept_in, metric=metric, also=[true, "census"])
                for each, metric in ((own, "census"), (further, true))
            )
            yield signs(world, pool, [guide], [guide], true, judge, stages)


def on_real_pairs(store: Path, seeds: int, evaluations: int) -> Iterator[dict[str, Any]]:
    """Five real pairs, as census_guides.py does."""
    pool, true = evidence_real.opened(), census_guides.TRUE
    with sfkit.EvaluationStore(store) as kept_in:
        guides, truths = (
            [
                sfkit.Evaluator(pool, one, store=kept_in, metric=metric)
                for one in evidence_real.benchmarks().values()
            ]
            for metric in ("census", true)
        )
        for seed in range(seeds):
            stages = (
                sfkit.SubsetSettings(population=8, generations=3, seed=seed),
                sfkit.RoutingSettings(evaluations=evaluations, converge=False, seed=seed),
            )
            yield signs(f"five real pairs, seed {seed}", pool, guides, truths, true, None, stages)


def measure(bank: Path, real: Path) -> list[dict[str, Any]]:
    """One row a guide; the arguments are the stores of the searches that are run again."""
    torch.set_num_threads(1)
    seen = on_real_pairs(real, 2, 150) if "SFKIT_REAL_DATA" in os.environ else ()
    return [*seen, *on_the_bank(bank, 8, 80)]


OPTIONS = {"bank": Path("runs/census_bank.sqlite"), "real": Path("runs/census_guides.sqlite")}
"""Of the command line."""

if __name__ == "__main__":
    answered(__doc__, measure, OPTIONS)
