"""One network for all domains: retrained on the union of their data, or merged."""

from __future__ import annotations

import pandas as pd
import teaser

from sfkit import bank
from sfkit.analysis.tables import markdown_lines
from sfkit.bank.plan import BANKS
from sfkit.bank.sharp import JOINT
from sfkit.datasets.synthetic.domains import BASE


def section() -> str:
    """A table for each bank that ``benchmarks/teaser.py`` has measured.

    Raises:
        SystemExit: that is none.
    """
    files = {name: teaser.FOLDER / f"{name}.csv" for name in BANKS}
    parts = [_table(name, pd.read_csv(file)) for name, file in files.items() if file.is_file()]
    if not parts:
        raise SystemExit("nothing is measured yet: run python benchmarks/teaser.py --pool NAME first")
    return "\n\n".join([HEAD, *parts])


HEAD = """## Retraining on the union of all data, or merging

`python benchmarks/teaser.py --pool NAME`: the paper's figure 1. bad-3.0 in percent, lower is better, on three
worlds that guided nothing. Seconds are what it takes once a new source's data are there, on the clock of one
thread: the whole joint training, or the longest fine-tuning and the search's evaluations."""


def _table(name: str, frame: pd.DataFrame) -> str:
    rows = [[row[0], *(f"{value:.2f}" for value in row[1:])] for row in frame.itertuples(index=False)]
    spent = {network: float(entry["cpu_seconds"]) for network, entry in bank.trainings(name).items()}
    table = f"### `{name}`\n\n{markdown_lines(list(frame.columns), rows)}"
    if JOINT not in spent:  # a joint network of one's own, whose seconds were given
        return table
    longest = max(value for network, value in spent.items() if network not in (BASE.name, JOINT))
    clock = (
        f"The machine did other work meanwhile: of a processor joint training took {spent[JOINT]:,.0f} s, "
        f"the longest fine-tuning {longest:,.0f} s."
    )
    return f"{table}\n\n{clock}"
