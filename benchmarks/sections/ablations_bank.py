"""The full report's ablations on the sharp bank, at the setting of the section ``report-bank``."""

from __future__ import annotations

import json
from pathlib import Path

import pandas as pd
from processes import sfkit
from sections import report_bank as setting
from tabulated import markdown


def measure() -> Path:
    """Make the report on that section's store; the folder of its tables."""
    out = setting.FOLDER
    values: dict[str, object] = {
        "pool": setting.POOL,
        "benchmark_pairs": setting.GUIDES,
        "report_on": [{"name": name, "pairs": setting.TESTS} for name in setting.worlds()],
        "population": setting.POPULATION,
        "generations": setting.GENERATIONS,
        "evaluations": setting.EVALUATIONS,
        "seeds": setting.SEEDS,
        "resamples": setting.RESAMPLES,
    }
    given = [w for name, value in values.items() for w in ("-p", name, _text(value))]
    sfkit("report", "report", *given, "-p", "out", str(out), "-o", str(out / "report.html"))

    return out / "tables"


def section() -> str:
    """The tables that change one thing at a time."""
    folder = measure()

    def table(name: str, index: str) -> str:
        return markdown(pd.read_csv(folder / f"{name}.csv", index_col=index))

    return f"""## What the answer on the embedded bank depends on

The other tables of the report that the section above begins, `sfkit report` on the pool `{setting.POOL}`:
{setting.GUIDES} pairs of courtyard guide, {setting.TESTS} pairs each of three other worlds test;
M = {setting.POPULATION}, T = {setting.GENERATIONS}, {setting.EVALUATIONS} evaluations of Stage 2.

As many sources as the search chose, picked by the likeness of their data to each target (the paper's data-set
combinations), against what the search found:

{table("similarity", "network")}

Stages and scales, then the metric, and benchmark and metric together, that guide:

{table("stages", "variant")}

{table("metrics", "fitness metric")}

{table("guides", "fitness")}

Each source and its strongest competitor over these guides:

{table("rivals", "source")}

The best subset of Stage 1 by the size of its population:

{table("population", "population")}"""


def _text(value: object) -> str:
    return value if isinstance(value, str) else json.dumps(value)
