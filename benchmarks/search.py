"""Searches against the true optimum: how many evaluations they need on a landscape that is known in full.

    python benchmarks/search.py [--seeds 200] [--quick] [--json]

All 2047 subsets of the first bank are scored (``exhaustive.py``), so no network runs: an
evaluation is a look into that table, and only distinct ones count, as in the evaluation store. Regret is the
best score found so far minus the best of all subsets of two or more, in percentage points of bad-3.0.
pymoo and DEAP take part where they are installed (``make bench``).
"""

from __future__ import annotations

import importlib.util
import itertools
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from exhaustive import subset_scores
from landscapes import Landscape
from pictures import lines, picture
from processes import answered, shown
from tabulated import numbers, percent

from sfkit.search import SubsetSearch, SubsetSettings
from sfkit.search.breeding import Draft, bred, initial, survivors
from sfkit.search.operators import Chromosome, mutate, random_chromosome

DOCUMENT = "benchmarks/README.md"

SEEDS = 200
POPULATIONS = (10, 20, 30, 40, 50, 60)
MARKS = (50, 100, 200, 300)
TRIES = 20
TRUNCATION = SubsetSettings(population=20, generations=39, survival="truncation")


def mask_of(genes: Iterable[int]) -> int:
    """The bit mask of a chromosome."""
    return sum(1 << gene for gene in genes)


Search = Callable[[Landscape, int], list[int]]
"""Landscape and seed -> the masks evaluated, in order."""


def genetic(settings: SubsetSettings, *, fresh: bool = False) -> Search:
    """Our Stage 1; with ``fresh``, an offspring that was evaluated before mutates until it is new."""

    def run(land: Landscape, seed: int) -> list[int]:
        met: list[int] = []
        seen: set[int] = set()
        numbered: list[tuple[Chromosome, tuple[float, int]]] = []

        def ranked(drafts: Sequence[Draft], rng: np.random.Generator) -> list[tuple[float, int]]:
            ranks = []
            for draft in drafts:
                chromosome = draft.chromosome
                for _ in range(TRIES if fresh else 0):
                    if mask_of(chromosome) not in seen:
                        break
                    chromosome, _ = mutate(chromosome, land.space, rng)
                mask = mask_of(chromosome)
                seen.add(mask)
                met.append(mask)
                ranks.append((land.scores[mask], len(numbered)))
                numbered.append((chromosome, ranks[-1]))
            return ranks

        rng = np.random.default_rng([seed, 1, 0])
        population = ranked(initial(settings, land.space, (), rng), rng)
        for generation in range(1, settings.generations + 1):
            rng = np.random.default_rng([seed, 1, generation])
            parents = [numbered[number] for _, number in population]
            offspring = ranked(bred(parents, settings, land.space, rng), rng)
            pool = [numbered[number] for _, number in (*population, *offspring)]
            population = list(survivors(pool, settings, rng))
        return met

    return run


def random_search(land: Landscape, seed: int) -> list[int]:
    """Subsets drawn as the initial population is, 800 of them like a search of 50 x 16."""
    rng = np.random.default_rng([seed, 2])
    return [mask_of(random_chromosome(land.space, rng)) for _ in range(800)]


def greedy_soup(land: Landscape, _: int) -> list[int]:
    """Wortsman et al. 2022: all sources alone, then each in turn where the mean scores no worse with it."""
    alone = [1 << n for n in range(len(land.names))]
    first, *rest = sorted(alone, key=lambda mask: land.scores[mask])
    soup, met = first, list(alone)
    for mask in rest:
        met.append(soup | mask)
        if land.scores[soup | mask] <= land.scores[soup]:
            soup |= mask
    return met


def searches() -> dict[str, Search]:
    """Everything that is compared, by name."""
    paper = SubsetSettings()
    found: dict[str, Search] = {
        "sfkit, the paper's settings": genetic(paper),
        "sfkit, M = 20 and T = 39": genetic(SubsetSettings(population=20, generations=39)),
        "sfkit, the same with truncation": genetic(TRUNCATION),
        "sfkit, no subset twice": genetic(paper, fresh=True),
        "random search": random_search,
        "greedy soup": greedy_soup,
    }
    if importlib.util.find_spec("pymoo"):
        from peers_search import pymoo_ga

        found["pymoo GA"] = pymoo_ga
    if importlib.util.find_spec("deap"):
        from peers_search import deap_simple

        found["DEAP eaSimple"] = deap_simple
    return found


@dataclass(frozen=True)
class SearchRow:
    """One search over all seeds.

    Attributes:
        name: of the search.
        candidates: proposed, repetitions included; median over seeds.
        distinct: evaluated; median over seeds.
        optimum: share of seeds that found the best subset.
        to_optimum: distinct evaluations until then, median over those seeds; NaN where there is none.
        regrets: mean regret after ``MARKS`` distinct evaluations, and at the end; percentage points.
        curve: mean regret after each number of distinct evaluations; a search that ended keeps its last.
    """

    name: str
    candidates: float
    distinct: float
    optimum: float
    to_optimum: float
    regrets: tuple[float, ...]
    curve: tuple[float, ...]


def measure(name: str, search: Search, land: Landscape, seeds: int) -> SearchRow:
    """Run a search from every seed."""
    runs = [search(land, seed) for seed in range(seeds)]
    regrets = [land.regrets(run) for run in runs]
    hits = [curve.index(0.0) + 1 for curve in regrets if 0.0 in curve]
    longest = max(MARKS[-1], *(len(curve) for curve in regrets))
    even = np.array([curve + [curve[-1]] * (longest - len(curve)) for curve in regrets])
    even[np.isinf(even)] = max(land.scores.values()) - land.best  # nothing found yet: the worst there is
    mean = even.mean(axis=0)
    return SearchRow(
        name,
        float(np.median([len(run) for run in runs])),
        float(np.median([len(curve) for curve in regrets])),
        len(hits) / seeds,
        float(np.median(hits)) if hits else float("nan"),
        (*(float(mean[mark - 1]) for mark in MARKS), float(mean[-1])),
        tuple(float(value) for value in mean),
    )


def check(land: Landscape) -> None:
    """The genetic algorithm here walks the way of ``SubsetSearch`` itself, candidate by candidate."""
    for seed, settings in itertools.product(range(2), (SubsetSettings(), TRUNCATION)):
        search = SubsetSearch(land.names, ("all",), land.scored, replace(settings, seed=seed))
        search.run()
        theirs = [land.mask(candidate.recipe.sources) for candidate in search.state.candidates]
        if theirs != genetic(settings)(land, seed):
            raise SystemExit(f"seed {seed}: this benchmark's search left the way of SubsetSearch")


def table(rows: Sequence[SearchRow], first: str) -> str:
    """The rows as a Markdown table."""
    marks = (*(f"regret at {mark}" for mark in MARKS), "at the end")
    heads = (first, "candidates", "distinct", "found the optimum", "after distinct", *marks)
    cells = [
        (
            row.name,
            f"{row.candidates:.0f}",
            f"{row.distinct:.0f}",
            percent(row.optimum),
            "never" if np.isnan(row.to_optimum) else f"{row.to_optimum:.0f}",
            *(f"{value:.3f}" for value in row.regrets),
        )
        for row in rows
    ]
    return numbers(heads, cells)


def compare(several: Mapping[str, Search], seeds: int, *, quick: bool) -> list[SearchRow]:
    """A row a search, on the scores on 20 pairs or, quick, on 8."""
    land = Landscape(subset_scores(), quick=quick)
    check(land)
    return [measure(name, search, land, seeds) for name, search in several.items()]


def both(seeds: int = SEEDS, quick: bool = False) -> dict[str, list[SearchRow]]:
    """All searches, and ours over population sizes with the paper's 15 generations."""
    sizes = {str(size): genetic(SubsetSettings(population=size)) for size in POPULATIONS}
    kinds = {"searches": searches(), "populations": sizes}
    return {kind: compare(several, seeds, quick=quick) for kind, several in kinds.items()}


def tables(found: dict[str, list[SearchRow]]) -> str:
    """Both as Markdown."""
    return f"{table(found['searches'], 'search')}\n\n{table(found['populations'], 'population')}"


SHOWN = 450


def section() -> str:
    """Tables, a picture, and what they say."""
    rows, sizes = both().values()
    quick = compare(searches(), SEEDS, quick=True)
    best = min(rows, key=lambda row: row.curve[99])
    curves = {
        row.name: (list(range(1, SHOWN + 1)), (*row.curve, *[row.curve[-1]] * SHOWN)[:SHOWN]) for row in rows
    }
    figure = lines(
        curves,
        title="How near is the best subset after so many evaluations?",
        subtitle=f"bank, {SEEDS} seeds, 20 validation pairs: after 100 distinct evaluations "
        f"{best.name} is nearest",
        x="distinct evaluations",
        y="mean regret (percentage points)",
    )
    # Single sources, which soups try first, lie above.
    figure.update_yaxes(range=[0, 1.2], rangemode="normal")
    shot = picture(figure, "search", "Regret of each search against distinct evaluations")
    return f"""## Searches against the true optimum

`{shown("search.py")}`: {SEEDS} seeds each on the scores of all subsets of the first bank's 11 sources
(bad-3.0 on the first 20 validation pairs; regret in percentage points, mean over seeds). Only distinct
evaluations cost. The greedy soup draws nothing at random, so all its seeds are one; it evaluates the
11 sources alone first.

{shot}

{table(rows, "search")}

Ours at other population sizes, 15 generations:

{table(sizes, "population")}

The same searches on another landscape, the scores on the first 8 pairs alone, which are noisier:

{table(quick, "search")}"""


if __name__ == "__main__":
    answered(both, tables)
