"""How census ranks the merges of the bank that was not softened, world by world."""

from __future__ import annotations

import census_bank
from processes import call, shown
from sections.census import worlds

from sfkit.analysis.tables import markdown_lines

COMMAND = ("census_worlds.py", "--pool", "bank-sharp", "--store", "runs/census_worlds_sharp.csv", "--json")
SEARCHES = ("census_bank.py", "--pool", "bank-sharp", "--seeds", "1")
SEARCHES += ("--store", "runs/census_bank_sharp.sqlite", "--json")


def section() -> str:
    """A table of the worlds, then both stages guided on each, and what is said of trust."""
    rows = call(*COMMAND)
    cells = []
    for row in rows:
        low, high = row["interval"]
        scores = [f"{row[key]:.2f}" for key in KEYS]
        cells.append((row["world"], f"{row['correlation']:.2f} ({low:.2f} to {high:.2f})", *scores))
    table = markdown_lines(COLUMNS, cells, [False, *[True] * (len(COLUMNS) - 1)])
    return "\n\n".join([HEAD, table, GUIDED, worlds(call(*SEARCHES))])


KEYS = ("fine", "coarse", "two scales", "halves", "picked", "best", "uniform", "single")
COLUMNS = (
    "world",
    "rank correlation",
    "fine scale alone",
    "coarse alone",
    "of both scales",
    "halves of the pairs",
    "its pick",
    "best",
    "uniform",
    "best single",
)
HEAD = f"""## Search without ground truth on the sharper bank

`{shown(*COMMAND)}`: 63 merges of its sources, single ones among them, on the first eight pairs of each world.
Rank correlation (Spearman) of `census` with the true bad-3.0, and of each of its two scales; how the scales
rank among themselves, and halves of the pairs; then bad-3.0 in percent."""
GUIDED = f"""`{shown(*SEARCHES)}`: eight pairs of a world guide both stages (M = {census_bank.POPULATION},
T = {census_bank.GENERATIONS}, 80 evaluations) without their labels or with them, eight labelled ones of
courtyard do instead, and AdaMerging descends on their entropy. bad-3.0 in percent on 16 further pairs of
that world, one seed."""
