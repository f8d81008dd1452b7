"""Where a model stops paying: block-specific routing, whose x has B x E + B entries, by the model and CMA-ES.

    python benchmarks/blockwise.py --minutes 60       # go on with what is missing, at most so long
    python benchmarks/blockwise.py --list             # what there is to do, and what is done
    python benchmarks/results.py blockwise            # write what is there into benchmarks/README.md

Searches over the best subsets of three to eleven sources by the table of all subsets, on the pairs that the
table scores quickly. What the model knows before is what Stage 1 by its model evaluates of that table. Every
evaluation goes through a store, so that a run can be interrupted at any moment.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache, partial
from pathlib import Path

import numpy as np
import pandas as pd
from exhaustive import subset_scores, table_path
from kept import RUNS, Job, KeptRuns
from landscapes import Landscape
from stage2_worlds import Together
from tabulated import markdown_lines

import sfkit
import sfkit.bank as bank
from sfkit.datasets.synthetic.domains import QUICK_PAIRS
from sfkit.evaluation.known import Known
from sfkit.evaluation.outcome import Scorer
from sfkit.merging import Pool, Recipe

DOCUMENT = "benchmarks/README.md"

BANKS = ("bank", "bank-sharp")
SIZES = (3, 4, 5, 6, 8, 11)
"""Sources of the subset, a search each."""
MARKS = (40, 60, 80, 100, 150)
MOST = 150
"""Evaluations by the model."""
SOONER, LATER = 100, 300
"""Evaluations by CMA-ES that the model is measured against; the latter is where it ends."""
MODEL, CMA_ES = "model", "CMA-ES"
APART, TIED = "block-specific", "tied"
WAYS = ((MODEL, APART), (CMA_ES, APART), (MODEL, TIED), (CMA_ES, TIED))


@dataclass(frozen=True)
class Place:
    """What one search is given: a pool, the pairs that guide, a subset, and what Stage 1 evaluated."""

    pool: Pool
    scorer: Scorer
    subset: tuple[str, ...]
    known: tuple[Known, ...]


def place(name: str, size: int, store: sfkit.EvaluationStore) -> Place:
    """The best subset of so many sources on a bank, and a Stage 1 whose seed is their number."""
    land, pool = landscape(name), opened(name)
    best = min((mask for mask in land.scores if mask.bit_count() == size), key=land.scores.__getitem__)
    settings = sfkit.BayesianSubsetSettings(seed=size)
    stage1 = sfkit.BayesianSubsetSearch(pool.names, pool.blocks, land.scored, settings)
    stage1.run()
    return Place(
        pool,
        Together(sfkit.Evaluator(pool, bank.benchmark(bank.VALIDATION).first(QUICK_PAIRS), store=store)),
        tuple(source for n, source in enumerate(land.names) if best >> n & 1),
        tuple(Known(c.recipe, c.score) for c in stage1.candidates if not c.repeated),
    )


@lru_cache
def landscape(name: str) -> Landscape:
    """A bank's table on the quick pairs."""
    return Landscape(subset_scores(table_path(name)), quick=True)


@lru_cache
def opened(name: str) -> Pool:
    """A bank."""
    return sfkit.open_pool(name)


def scores(place: Place, way: str, tied: bool, seed: int) -> Iterator[float]:
    """The scores of a search's candidates, in order."""
    search: sfkit.RoutingSearch
    if way == MODEL:
        search = sfkit.BayesianRoutingSearch(
            place.subset,
            place.pool.blocks,
            place.scorer,
            sfkit.BayesianRoutingSettings(evaluations=MOST, tied=tied, seed=seed),
            known=place.known,
        )
    else:
        settings = sfkit.RoutingSettings(evaluations=LATER, converge=False, tied=tied, seed=seed)
        search = sfkit.RoutingSearch(place.subset, place.pool.blocks, place.scorer, settings)
    for generation in search:
        yield from (candidate.score for candidate in generation.candidates)


def searched(name: str, way: str, routing: str, size: int, folder: Path) -> pd.DataFrame:
    """One search: a row an evaluation."""
    with sfkit.EvaluationStore(folder / "evaluations.sqlite") as store:
        given = place(name, size, store)
        found = list(scores(given, way, routing == TIED, seed=size))
        blocks = len(given.pool.blocks)
        own = Recipe.equal(given.subset, given.pool.blocks)
        knows = sum(set(k.recipe.sources) <= set(given.subset) and k.recipe != own for k in given.known)
    return pd.DataFrame(
        {
            "bank": name,
            "way": way,
            "routing": routing,
            "size": size,
            "entries": size * (blocks if routing == APART else 1) + blocks,
            "knows": knows if way == MODEL else 0,
            "evaluation": range(1, len(found) + 1),
            "score": found,
        }
    )


def jobs() -> dict[str, Job]:
    """Name -> job: the first bank's block-specific searches first."""
    return {
        f"{name}-{routing}-{way.lower()}-{size}": partial(searched, name, way, routing, size)
        for name in BANKS
        for way, routing in WAYS
        for size in SIZES
    }


kept = KeptRuns(__doc__, jobs, RUNS / "blockwise")

HEAD = f"""## Where a model of Stage 2 stops paying: block-specific routing

`python benchmarks/blockwise.py` runs the searches and goes on where it was: Stage 2 over the best subset of
each size by the table of all subsets, on the first {QUICK_PAIRS} validation pairs, a search a size. Numbers
are points behind (above 0) or ahead (below 0) of what CMA-ES with block-specific routing has after {LATER}
evaluations of the same search; after 1 is x = 0, the equal merge. The last columns are how many evaluations
a search takes for what that CMA-ES has after {SOONER} and after {LATER}, "never" where it ended before: the
model after {MOST}, CMA-ES after {LATER}. `knows` is how many merges of these sources the model has seen
before, of Stage 1 by a model. With tied weights x has E + B entries, otherwise B x E + B."""


def section() -> str:
    """Tables of whatever ``benchmarks/blockwise.py`` has finished.

    Raises:
        SystemExit: that is no search by CMA-ES, block-specific.
    """
    frame = kept.results("")
    aims = pd.DataFrame() if frame.empty else frame[(frame["way"] == CMA_ES) & (frame["routing"] == APART)]
    if aims.empty:
        raise SystemExit("nothing is finished yet: run python benchmarks/blockwise.py first (half an hour)")
    parts = [HEAD]
    for name, aimed in aims.groupby("bank"):
        sizes = sorted(aimed["size"].unique())
        found = frame[(frame["bank"] == name) & frame["size"].isin(sizes)]
        searches = "1 search" if len(sizes) == 1 else f"{len(sizes)} searches"
        parts += [f"On `{name}`, {searches} a way:", table(found), "Medians over them:", medians(found)]
    return "\n\n".join(parts)


def curves(found: pd.DataFrame) -> dict[tuple[int, str, str], np.ndarray]:
    """(size, way, routing) -> the best score after each evaluation, in the order of ``WAYS``, by size."""
    parts = dict(iter(found.sort_values("evaluation").groupby(["size", "way", "routing"])))
    order = [(size, *way) for size in sorted(found["size"].unique()) for way in WAYS]
    return {key: parts[key]["score"].cummin().to_numpy() for key in order if key in parts}


def behind(best: np.ndarray, aim: float) -> list[float]:
    """Points behind at 1, at each mark, and at the last one; NaN where a search ended before."""
    return [best[mark - 1] - aim if len(best) >= mark else np.nan for mark in (1, *MARKS, LATER)]


def reaches(best: np.ndarray, aim: float) -> float:
    """Evaluations until a score; infinite where it was not met."""
    return float(np.argmax(best <= aim)) + 1 if (best <= aim).any() else np.inf


COLUMNS = [*(f"after {mark}" for mark in (1, *MARKS, LATER)), f"reaches its {SOONER}", f"its {LATER}"]


def measured(found: pd.DataFrame) -> pd.DataFrame:
    """A row a search: size, way, routing, entries, knows, then ``COLUMNS``."""
    every, rows = curves(found), []
    told = found.drop_duplicates(["size", "way", "routing"]).set_index(["size", "way", "routing"])
    for key, best in every.items():
        aim = every[key[0], CMA_ES, APART]
        ends = (aim[SOONER - 1], aim[-1])
        about = (told.loc[key, "entries"], told.loc[key, "knows"])
        rows.append((*key, *about, *behind(best, ends[1]), *(reaches(best, end) for end in ends)))
    return pd.DataFrame(rows, columns=["size", "way", "routing", "entries", "knows", *COLUMNS])


def table(found: pd.DataFrame) -> str:
    """A row a search."""
    rows = [
        (row["size"], row["entries"], f"{row['way']}, {row['routing']}", row["knows"], *cells(row))
        for _, row in measured(found).iterrows()
    ]
    return markdown_lines(("sources", "entries of x", "Stage 2", "knows", *COLUMNS), rows)


def medians(found: pd.DataFrame) -> str:
    """A row a way, over the searches that it has finished."""
    rows = []
    for (way, routing), part in measured(found).groupby(["way", "routing"], sort=False):
        middle = part[COLUMNS].median(skipna=False)
        rows.append((f"{way}, {routing}", len(part), *cells(middle)))
    return markdown_lines(("Stage 2", "searches", *COLUMNS), rows)


def cells(row: pd.Series) -> list[str]:
    """Points with their sign, counts of evaluations; nothing where there is none, never where not reached."""
    points = ["" if np.isnan(row[c]) else f"{row[c]:+.2f}" for c in COLUMNS[:-2]]
    counts = ["never" if np.isinf(row[c]) else f"{row[c]:.0f}" for c in COLUMNS[-2:]]
    return points + counts


if __name__ == "__main__":
    kept.main()
