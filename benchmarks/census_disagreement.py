"""Do guides that need no label disagree where ``census`` misleads?

    python benchmarks/census_disagreement.py --json

Over the networks every pool has, and over some of those that the unlabelled searches of census_bank.py and
census_guides.py compared (run once more on their stores): how census ranks them beside the truth, and how
much the rankings agree that come from halves of the pairs, from its fine and its coarse scale, from the upper
and the lower half of the images, and from census, the left-right check and the entropy of the matching.
Everything scored is kept in a store: started again it goes on where it was.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import census
import census_bank
import census_guides
import census_signs
import evidence_real
import numpy as np
import torch
from numpy.typing import NDArray
from scipy.stats import spearmanr
from stages import both, printed

import sfkit
from sfkit import bank
from sfkit.analysis.ranking import agreement, yardstick_recipes
from sfkit.analysis.trust import stability
from sfkit.datasets import Sample
from sfkit.datasets.census import CensusScale, CensusTarget
from sfkit.datasets.metric import Count, Metric, Ratio, register_metric
from sfkit.evaluation.gradients import matching_entropy
from sfkit.evaluation.outcome import Scorer
from sfkit.evaluation.self_check import consistency
from sfkit.merging import Pool, Recipe
from sfkit.merging.live import LiveModel

Table = NDArray[np.float64]
SEARCHED, VIEWED = 24, 2  # networks of a search, and pairs of a benchmark that see a second pass
FINE, UPPER, LOWER = "census-fine", "census-upper", "census-lower"
SIGNS = ("halves of the pairs", "two scales", "image halves", "left-right", "entropy")


def _counts(rows: Callable[[int], slice], scales: Sequence[CensusScale]) -> Callable[..., Count]:
    """A recorder that sees a part of the image's rows, at some scales."""

    def recorder(sample: Sample, valid: NDArray[np.bool_]) -> Count:
        seen = rows(sample.left.shape[0])
        target = CensusTarget(sample.left[seen], sample.right[seen], scales=scales)

        def count(map_: NDArray[np.floating[Any]]) -> Ratio:
            return target.residual(np.ascontiguousarray(map_[seen])).score, 1.0

        return count

    return recorder


for _name, _rows, _scales in (
    (FINE, lambda height: slice(None), census.SCALES[:1]),
    (UPPER, lambda height: slice(height // 2), census.SCALES),
    (LOWER, lambda height: slice(height // 2, None), census.SCALES),
):
    register_metric(
        Metric(_name, of="census bits", pools=False, needs_truth=False, recorder=_counts(_rows, _scales))
    )
PARTS = ("census", FINE, UPPER, LOWER)


def signs(scorers: Sequence[sfkit.Evaluator], recipes: Sequence[Recipe], true: str) -> dict[str, Any]:
    """How networks are ranked by census beside the truth, and how guides without labels agree."""
    evaluations = [scorer.evaluate(recipes) for scorer in scorers]

    def table(metric: str) -> Table:
        """(networks, pairs), lower is better."""
        return np.array(
            [[i.value(metric) for row in evaluations for i in row[n].images] for n in range(len(recipes))]
        )

    whole, fine, upper, lower = (table(name) for name in PARTS)
    agreed = agreement(whole.mean(axis=1), truth := table(true).mean(axis=1), true)
    return {
        "networks": len(recipes),
        "correlation": agreed.correlation,
        "interval": agreed.interval,
        "regret": agreed.regret,
        "best": float(truth.min()),
        "halves of the pairs": stability(whole),
        "two scales": _ranked(fine, 2.0 * whole - fine),
        "image halves": _ranked(upper, lower),
    }


def second_views(scorers: Sequence[sfkit.Evaluator], recipes: Sequence[Recipe]) -> dict[str, float]:
    """How census ranks networks beside the left-right check, and beside their matching's entropy."""
    pool = scorers[0].pool
    live, inputs = LiveModel(pool), pool.architecture.inputs(pool.options)
    entropy = matching_entropy(pool) if pool.architecture.matching else None
    samples = [s for scorer in scorers for s in scorer.benchmark.first(VIEWED).samples()]
    found: dict[str, list[list[float]]] = {"census": [], "left-right": [], "entropy": []}
    pairs = [
        (
            CensusTarget(sample.left, sample.right),
            inputs.prepare(sample.left, sample.right),
            inputs.prepare(*census._mirrored(sample)),
        )
        for sample in samples
    ]
    for recipe in recipes:
        live.apply(recipe)
        row: dict[str, list[float]] = {name: [] for name in found}
        for target, pair, mirrored in pairs:
            map_, _ = census._predicted(live, pair)
            of_right, _ = census._predicted(live, mirrored)
            agree, inside = consistency(map_, of_right[:, ::-1])
            row["census"].append(target.residual(map_).score)
            row["left-right"].append(100.0 * float((inside & ~agree).mean()))
            if entropy is not None:
                with torch.inference_mode():
                    row["entropy"].append(float(entropy(live.network, pair, torch.empty(0))))
        for name, values in row.items():
            found[name].append(values)
    ours = np.array(found.pop("census"))
    return {name: _ranked(ours, np.array(rows)) for name, rows in found.items() if rows[0]}


def _ranked(first: Table, second: Table) -> float:
    return float(spearmanr(first.mean(axis=1), second.mean(axis=1)).statistic)


def asked(pool: Pool, scorer: Scorer, **budget: int) -> tuple[Recipe, list[Recipe]]:
    """What both stages find, and every network they compared."""
    asking = census_signs.Remembering(scorer)
    _, second = both(pool, asking, budget.pop("seed", 0), **budget)
    return second.run().recipe, list(asking.asked)


def drawn(recipes: Sequence[Recipe]) -> list[Recipe]:
    """Some of them."""
    order = np.random.default_rng(0).permutation(len(recipes))[:SEARCHED]
    return [recipes[n] for n in order]


def on_the_bank(kept: sfkit.EvaluationStore, store: Path) -> Iterator[dict[str, Any]]:
    """Two rows a world: the usual networks, and those its search compared."""
    pool, true = sfkit.open_pool("bank"), census_bank.TRUE
    budget = {"population": census_bank.POPULATION, "generations": census_bank.GENERATIONS}
    for world in bank.benchmarks():
        own = bank.benchmark(world).first(8)
        with sfkit.EvaluationStore(store) as theirs:
            guide = sfkit.Evaluator(pool, own, store=theirs, metric="census", also=[true, "census"])
            _, searched = asked(pool, guide, **budget, evaluations=80)
        scorer = sfkit.Evaluator(pool, own, store=kept, metric="census", also=[true, *PARTS])
        usual = list(yardstick_recipes(pool).values())
        yield {"place": world, "of": "usual", **signs([scorer], usual, true), **second_views([scorer], usual)}
        yield {"place": world, "of": "searched", **signs([scorer], drawn(searched), true)}


def on_real_pairs(kept: sfkit.EvaluationStore, store: Path) -> Iterator[dict[str, Any]]:
    """Base and all merges of the four real sources on five pairs and on each; networks a search compared."""
    pool, true = evidence_real.opened(), census_guides.TRUE
    benchmarks = evidence_real.benchmarks()
    with sfkit.EvaluationStore(store) as theirs:
        guides = [sfkit.Evaluator(pool, b, store=theirs, metric="census") for b in benchmarks.values()]
        scorer = sfkit.CombinedScorer(guides)
        _, searched = asked(pool, scorer, population=8, generations=3, evaluations=150)
    usual = list(census.merges(pool).values())
    scorers = {
        name: sfkit.Evaluator(pool, one, store=kept, metric="census", also=[true, *PARTS])
        for name, one in benchmarks.items()
    }
    every = list(scorers.values())
    yield {
        "place": "five real pairs",
        "of": "usual",
        **signs(every, usual, true),
        **second_views(every, usual),
    }
    yield {"place": "five real pairs", "of": "searched", **signs(every, drawn(searched), true)}
    for name, one in scorers.items():
        yield {"place": name, "of": "usual", **signs([one], usual, true)}


def measure(store: Path, bank: Path, real: Path) -> list[dict[str, Any]]:
    """One row a place and group of networks."""
    torch.set_num_threads(1)
    store.parent.mkdir(parents=True, exist_ok=True)
    with sfkit.EvaluationStore(store) as kept:
        rows = list(on_the_bank(kept, bank))
        if "SFKIT_REAL_DATA" in os.environ:
            rows += on_real_pairs(kept, real)
    return rows


def line(row: dict[str, Any]) -> str:
    """A row as text."""
    return "  ".join(f"{k} {v:.2f}" if isinstance(v, float) else f"{k} {v}" for k, v in row.items())


OPTIONS = {
    "store": Path("runs/census_disagreement.sqlite"),
    "bank": Path("runs/census_bank.sqlite"),
    "real": Path("runs/census_guides.sqlite"),
}
"""Of the command line: its own store, and those of census_bank.py and census_guides.py."""

if __name__ == "__main__":
    printed(__doc__, measure, OPTIONS, line)
