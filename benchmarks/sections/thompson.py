"""What chooses a batch: the kriging believer, which the library has, beside Thompson sampling."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd
from bayesian import CHOOSERS, in_batches
from exhaustive import subset_scores, table_path
from landscapes import Landscape
from optimum import FOUND, number, share_within
from tabulated import markdown_lines

DOCUMENT = "benchmarks/README.md"

LANDSCAPES = {
    "`bank`, the first 20 validation pairs": ("bank", False),
    "`bank`, the first 8": ("bank", True),
    "`bank-sharp`, the first 20": ("bank-sharp", False),
}
"""Name -> bank, and whether its quick scores."""
BATCHES = (4, 16, 64)
SEEDS = tuple(range(40))

HEAD = f"""## What chooses a batch: the kriging believer beside Thompson sampling

Stage 1 by the model on the scores of all subsets of two banks, {len(SEEDS)} seeds a row, the same for both.
The believer takes the smallest bound, hears the model's own mean there, and takes the next; Thompson takes
the best of one joint draw of the posterior at all subsets for each proposal. Evaluations until the best
subset, sources scored alone with them; rounds are batches, the one before there is a model with them."""


def measure(land: Landscape, batches: Sequence[int] = BATCHES, seeds: Sequence[int] = SEEDS) -> pd.DataFrame:
    """A row a batch, chooser and seed, as :func:`bayesian.in_batches`."""
    return pd.concat(
        [
            in_batches(land, batch, seeds, chooser).assign(batch=batch, chooser=name)
            for batch in batches
            for name, chooser in CHOOSERS.items()
        ],
        ignore_index=True,
    )


def table(found: pd.DataFrame) -> str:
    """A row a batch and chooser."""
    rows = [
        (
            batch,
            chooser,
            *share_within(part["needed"]),
            *(number(value) for value in part["rounds"].quantile((0.5, 0.9), interpolation="higher")),
            f"{1000 * part['seconds'].mean():.1f}",
        )
        for (batch, chooser), part in found.groupby(["batch", "chooser"], sort=False)
    ]
    heads = (
        "batch",
        "chosen by",
        *FOUND,
        "rounds, median",
        "rounds, 90 %",
        "CPU, ms",
    )
    return markdown_lines(heads, rows)


def section() -> str:
    """A table a landscape."""
    parts = [HEAD]
    for title, (bank, quick) in LANDSCAPES.items():
        land = Landscape(subset_scores(table_path(bank)), quick=quick)
        parts.append(f"On {title}:\n\n{table(measure(land))}")
    return "\n\n".join(parts)
