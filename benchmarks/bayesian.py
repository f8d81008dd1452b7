"""Model-based Stage 1 against the true optimum: evaluations needed, alone and in batches.

    python benchmarks/bayesian.py [--seeds 200] [--batches 1 4 16 64] [--quick] [--json]

As ``search.py``, on the scores of all subsets of the embedded bank: an evaluation is a look into a table,
and a source scored alone costs, and wins nothing.
"""

from __future__ import annotations

import argparse
import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from landscapes import Landscape

from sfkit.bank.exhaustive import subset_scores
from sfkit.evaluation.outcome import Outcome
from sfkit.merging.recipe import Recipe
from sfkit.search import BayesianSubsetSearch, BayesianSubsetSettings

SEEDS = 200
BATCHES = (1, 4, 16, 64)
MOST = 160


@dataclass(frozen=True)
class Row:
    """All seeds at one size of batch.

    Attributes:
        batch: candidates proposed at a time.
        seeds: searches.
        median, most: evaluations until the best subset was found, over the seeds; infinite
            where one did not.
        within: share of seeds that found it within 60 and within 90 evaluations.
        waits: median number of rounds until then, at whose end workers wait for one another.
        seconds: CPU seconds of the model an evaluation, mean over all searches.
    """

    batch: int
    seeds: int
    median: float
    most: float
    within: tuple[float, float]
    waits: float
    seconds: float


def needed(land: Landscape, seed: int, batch: int) -> tuple[float, float, float]:
    """Evaluations and rounds until the optimum, and CPU seconds an evaluation until then."""
    names = land.names

    def scorer(recipes: Sequence[Recipe]) -> list[Outcome]:
        masks = (sum(1 << names.index(source) for source in recipe.sources) for recipe in recipes)
        return [Outcome(land.scores[mask]) for mask in masks]

    settings = BayesianSubsetSettings(generations=-(-MOST // batch), batch=batch, seed=seed)
    search = BayesianSubsetSearch(names, ("all",), scorer, settings)
    started = time.process_time()
    for generation in search:
        for candidate in generation.candidates:
            if len(candidate.subset) >= 2 and candidate.score == land.best:
                spent = (time.process_time() - started) / len(search.candidates)
                return candidate.number + 1, generation.number + 1, spent
    return float("inf"), float("inf"), (time.process_time() - started) / len(search.candidates)


def measure(land: Landscape, batch: int, seeds: int) -> Row:
    """One size of batch from every seed."""
    counts, rounds, seconds = np.array([needed(land, seed, batch) for seed in range(seeds)]).T
    within = (float(np.mean(counts <= 60)), float(np.mean(counts <= 90)))
    return Row(
        batch,
        seeds,
        float(np.median(counts)),
        float(np.max(counts)),
        within,
        float(np.median(rounds)),
        float(np.mean(seconds)),
    )


def compare(seeds: int, batches: Sequence[int], *, quick: bool = False) -> list[Row]:
    """All sizes of batch, on the scores on 20 pairs or, quick, on 8."""
    land = Landscape(subset_scores(), quick=quick)
    return [measure(land, batch, seeds) for batch in batches]


def table(rows: Sequence[Row]) -> str:
    """The rows as a Markdown table."""
    lines = [
        "| batch | seeds | median evaluations | most | within 60 | within 90 | rounds | model, CPU ms |",
        "|--:|--:|--:|--:|--:|--:|--:|--:|",
    ]
    for row in rows:
        sixty, ninety = (f"{100 * share:.1f} %" for share in row.within)
        lines.append(
            f"| {row.batch} | {row.seeds} | {row.median:.0f} | {row.most:.0f} | {sixty} | {ninety} "
            f"| {row.waits:.0f} | {1000 * row.seconds:.1f} |"
        )
    return "\n".join(lines)


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print a table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    parser.add_argument("--batches", type=int, nargs="+", default=BATCHES)
    parser.add_argument("--quick", action="store_true", help="the scores on 8 pairs instead of 20")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args(arguments)
    rows = compare(options.seeds, options.batches, quick=options.quick)
    print(json.dumps([asdict(row) for row in rows]) if options.json else table(rows))


if __name__ == "__main__":
    main()
