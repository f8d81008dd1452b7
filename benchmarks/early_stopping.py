"""How many image passes Stage 1 could leave out without changing its path: what exact bounds allow.

    python benchmarks/early_stopping.py --store runs/early_stopping.sqlite
    python benchmarks/early_stopping.py --seeds 3 --pairs 20 --json

A score is a mean of per-image errors, none of them negative: the images seen so far bound it from below.
A candidate whose bound already loses a comparison need not be finished for it, and which comparisons will
be asked for is known early, because draws come from a seeded generator: the survivors' tournaments of a
generation (Algorithm 1, line 14) can be drawn before its offspring are scored. Searches are run in full on
the embedded bank, once; then each policy replays them from the recorded per-image errors, must come to the
same populations and the same best, and is charged for every image it looks at:

    survivors   offspring are finished only if they may survive or be the best; the others stop at the image
                that proves that they lose every tournament they were drawn for
    lazy        nobody is finished before a comparison needs it, survivors and the initial population included

Both take images as they come, or (``hard first``) in the order of their mean error in the initial population,
which makes bounds rise sooner. ``lazy`` is the least that any exact method of this kind can do.
"""

from __future__ import annotations

import argparse
import json
import math
import statistics
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import torch

from sfkit.bank import VALIDATION
from sfkit.evaluation import EvaluationStore, Evaluator
from sfkit.places import BANK, open_benchmark, open_pool
from sfkit.search import SubsetSearch, SubsetSettings
from sfkit.search.breeding import bred, initial
from sfkit.search.operators import Chromosome

Genes = frozenset[int]
Table = dict[Genes, list[float]]
"""Errors in percent, one an image, by subset."""
STREAM = 1  # of Stage 1's random numbers, as in sfkit.search.subset


def mean(errors: Iterable[float]) -> float:
    """The score, as protocols average it: a sum without rounding on the way, so that bounds never pass it."""
    values = list(errors)
    return math.fsum(values) / len(values)


@dataclass
class Watch:
    """Looks at images one by one, and only where a comparison is still open.

    Attributes:
        table: the errors there are to see.
        order: in which images are looked at.
        seen: the errors of each subset that were looked at.
    """

    table: Table
    order: Sequence[int]
    seen: dict[Genes, list[float]] = field(default_factory=dict)

    @property
    def passes(self) -> int:
        """Images looked at."""
        return sum(len(errors) for errors in self.seen.values())

    def exact(self, genes: Genes) -> bool:
        """True where every image was looked at."""
        return len(self.seen.get(genes, ())) == len(self.order)

    def bound(self, genes: Genes) -> float:
        """What the score is at least, in percent; the score itself once every image was looked at."""
        return math.fsum(self.seen.get(genes, ())) / len(self.order)

    def look(self, genes: Genes) -> None:
        """Look at one more image."""
        seen = self.seen.setdefault(genes, [])
        seen.append(self.table[genes][self.order[len(seen)]])

    def finish(self, genes: Genes) -> float:
        """Look at every image; the score in percent."""
        while not self.exact(genes):
            self.look(genes)
        return self.bound(genes)

    def best(self, members: Sequence[tuple[Genes, int]]) -> int:
        """The position of the smallest (score, number), looking at as few images as that takes."""
        while True:
            position = min(range(len(members)), key=lambda i: (self.bound(members[i][0]), members[i][1]))
            genes = members[position][0]
            if self.exact(genes):
                return position
            self.look(genes)


@dataclass(frozen=True)
class Way:
    """What a search did: its populations by candidate number, and each candidate's subset."""

    populations: tuple[tuple[int, ...], ...]
    subsets: tuple[Genes, ...]


def replay(search: SubsetSearch, watch: Watch, *, lazy: bool) -> Way:
    """Algorithm 1 with the searches' own draws, each comparison answered by bounds where they suffice."""
    settings, space = search.settings, search.space
    size = int(settings.population)
    rng = np.random.default_rng([int(settings.seed), STREAM, 0])
    chromosomes: list[Chromosome] = [draft.chromosome for draft in initial(settings, space, (), rng)]
    population = list(range(len(chromosomes)))
    populations = [tuple(population)]

    def member(number: int) -> tuple[Genes, int]:
        return frozenset(chromosomes[number]), number

    def winner(numbers: Sequence[int]) -> int:
        return numbers[watch.best([member(number) for number in numbers])]

    if not lazy:
        for number in population:
            watch.finish(member(number)[0])
    for generation in range(1, int(settings.generations) + 1):
        rng = np.random.default_rng([int(settings.seed), STREAM, generation])
        parents = [(chromosomes[n], _Lazy(n, winner)) for n in population]
        offspring = bred(parents, settings, space, rng)  # type: ignore[arg-type]
        first = len(chromosomes)
        chromosomes += [draft.chromosome for draft in offspring]
        pool = [*population, *range(first, len(chromosomes))]
        drawn = [rng.integers(len(pool), size=2) for _ in range(size - 1)]
        survived = [winner([pool[int(one)], pool[int(other)]]) for one, other in drawn]
        population = [*survived, winner(pool)]
        populations.append(tuple(population))
        if not lazy:
            for number in population:
                watch.finish(member(number)[0])
    return Way(tuple(populations), tuple(frozenset(c) for c in chromosomes))


@dataclass(frozen=True)
class _Lazy:
    """A rank that is compared by asking for the winner, and unpacks into an unknown score and a number."""

    number: int
    winner: Callable[[Sequence[int]], int]

    def __le__(self, other: _Lazy) -> bool:
        return self.winner([self.number, other.number]) == self.number

    def __iter__(self) -> Any:
        return iter((float("nan"), self.number))


def measure(
    *, seeds: int, pairs: int, sources: int, population: int, generations: int, store: Path
) -> list[dict[str, Any]]:
    """One row a seed: distinct subsets, image passes in full, and the share that each policy leaves out.

    Raises:
        RuntimeError: a policy came to another population or another best.
    """
    torch.set_num_threads(1)
    pool, benchmark = open_pool(BANK), open_benchmark(f"{BANK}:{VALIDATION}", pairs=pairs)
    names, rows = pool.names[:sources], []
    store.parent.mkdir(parents=True, exist_ok=True)
    with EvaluationStore(store) as kept, Evaluator(pool, benchmark, store=kept) as evaluator:
        for seed in range(seeds):
            settings = SubsetSettings(population=population, generations=generations, seed=seed)
            search = SubsetSearch(names, pool.blocks, evaluator, settings)
            search.run()
            table = errors_of(search, evaluator)
            full = len(table) * pairs
            start = np.mean([table[genes_of(search, n)] for n in search.state.populations[0]], axis=0)
            orders = {"": range(pairs), ", hard first": [int(i) for i in np.argsort(-start, kind="stable")]}
            row: dict[str, Any] = {"seed": seed, "subsets": len(table), "passes": full}
            for policy in ("survivors", "lazy"):
                for name, order in orders.items():
                    watch = Watch(table, order)
                    check(search, replay(search, watch, lazy=policy == "lazy"))
                    row[f"{policy}{name}"] = 1 - watch.passes / full
            rows.append(row)
    return rows


def errors_of(search: SubsetSearch, evaluator: Evaluator) -> Table:
    """The errors of everything a search scored, which the store still has."""
    found: Table = {}
    for candidate in search.candidates:
        genes = genes_of(search, candidate.number)
        if genes not in found:
            (evaluation,) = evaluator.evaluate([candidate.recipe])
            found[genes] = [image.value(evaluator.metric) for image in evaluation.images]
    return found


def genes_of(search: SubsetSearch, number: int) -> Genes:
    """A candidate's subset as indices of sources."""
    return frozenset(search.sources.index(name) for name in search.candidates[number].subset)


def check(search: SubsetSearch, path: Way) -> None:
    """Compare a replay with the search.

    Raises:
        RuntimeError: another population anywhere, or another subset.
    """
    subsets = tuple(genes_of(search, candidate.number) for candidate in search.candidates)
    if path.populations != search.state.populations or path.subsets != subsets:
        raise RuntimeError(f"seed {search.settings.seed}: the replay went another way than the search")


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure and print a table, or JSON."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--seeds", type=int, default=5)
    parser.add_argument("--pairs", type=int, default=40, help="of the bank's validation benchmark")
    parser.add_argument("--sources", type=int, default=11, help="the first so many of the bank")
    parser.add_argument("--population", type=int, default=50)
    parser.add_argument("--generations", type=int, default=15)
    parser.add_argument("--store", type=Path, default=Path("runs/early_stopping.sqlite"))
    parser.add_argument("--json", action="store_true", help="print a JSON list of records")
    options = vars(parser.parse_args(arguments))
    as_json = options.pop("json")
    rows = measure(**options)
    if as_json:
        print(json.dumps(rows, indent=2))
        return
    shares = [key for key in rows[0] if key not in ("seed", "subsets", "passes")]
    print("seed  subsets  image passes  " + "  ".join(f"{name:>22}" for name in shares))
    for row in rows:
        saved = "  ".join(f"{100 * row[name]:20.1f} %" for name in shares)
        print(f"{row['seed']:4}  {row['subsets']:7}  {row['passes']:12}  {saved}")
    means = "  ".join(f"{100 * statistics.fmean(row[name] for row in rows):20.1f} %" for name in shares)
    print(f"mean  {'':7}  {'':12}  {means}")


if __name__ == "__main__":
    main()
