"""How large must the population of Stage 1 be? On the table of all subsets, where a search costs nothing."""

from __future__ import annotations

from exhaustive import SubsetScores, subset_scores, table_path
from landscapes import Landscape
from tabulated import markdown

from sfkit.analysis import PopulationSizes, population_sizes

BANKS = ("bank", "bank-sharp")
SIZES = (4, 8, 12, 20, 30, 40, 50, 60)
SEEDS = tuple(range(20))
GENERATIONS = 15


def measure(table: SubsetScores | None = None) -> PopulationSizes:
    """Stage 1 with every size and seed on a bank's table, the first bank's unless given."""
    land = Landscape(table or subset_scores())
    return population_sizes(
        land.names,
        ("all",),
        land.scored,
        sizes=SIZES,
        seeds=SEEDS,
        generations=GENERATIONS,
        metric="bad-3.0",
        optimum=land.best,
    )


def section() -> str:
    """The paper's figure as a table, on each bank whose subsets are all scored."""
    parts = [
        f"""## How large must the population be?

The paper's figure of population sizes on pools of whose 2,036 subsets of two or more every score is known:
bad-3.0 in percent of the best subset that Stage 1 finds with T = {GENERATIONS}, over {len(SEEDS)} seeds,
and how many subsets it had scored for that."""
    ]
    for name in BANKS:
        found = measure(subset_scores(table_path(name)))
        optimal = [f"{(row == found.optimum).sum()} of {len(SEEDS)}" for row in found.best]
        table = found.table().assign(**{"at the optimum": optimal})
        about = (
            f"On `{name}`, by `benchmarks/{table_path(name).name}`; the best of all is {found.optimum:.2f}:"
        )
        parts += [about, markdown(table)]
    return "\n\n".join(parts)
