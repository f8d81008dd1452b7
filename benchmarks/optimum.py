"""Evaluations until the best of all subsets: ours, the model's, and other programs', on two landscapes.

    python benchmarks/optimum.py --minutes 30         # go on with what is missing, at most so long
    python benchmarks/optimum.py grown                # a part of it
    python benchmarks/optimum.py --list               # what there is to do, and what is done
    python benchmarks/optimum.py --record             # keep what is done in the repository
    python benchmarks/results.py optimum              # write what is there into benchmarks/README.md

As ``search.py``, on the scores of all subsets of the first bank, where an evaluation is a look into a
table and only distinct ones count. Searches beside each other; the model's in batches for several workers; a
pool that gains each source of the best subset in turn; and one that gains a twelfth (``twelfth.py``). pymoo,
DEAP and Optuna take part where they are installed (``make bench``).

What is recorded rests on 200 seeds a search, but for the same search by scikit-learn's model (20), that by
BoTorch's (1, on 20 pairs; minutes a seed) and the greedy soup, which draws nothing (1). ``--record`` keeps
what another machine adds.
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from bayesian import GROWN, MOST, ExpectedImprovementSubsetSearch, grown, in_batches, newcomers, run
from exhaustive import subset_scores
from kept import RUNS, Job, KeptRuns
from landscapes import Landscape
from peers_models import MOST as MODELS_MOST
from search import Search, searches
from tabulated import markdown_lines, percent
from twelfth import NEWCOMERS, grown_scores

from sfkit.search import BayesianSubsetSettings
from sfkit.search.operators import SubsetSpace

DOCUMENT = "benchmarks/README.md"

LANDSCAPES = (20, 8)
"""Validation pairs; the table has the scores on the first 8 as quick ones."""
SEEDS, TOGETHER = 200, 10
"""Seeds of what costs little, and how many of them are one job."""
TPE_MOST, GP_MOST = {20: 200, 8: 100}, 90
"""Distinct evaluations at which Optuna's samplers end: where few seeds find the best, more cost hours."""
SOON, LATER = 60, 90
"""Evaluations within which a share of seeds found the best is told; the first is what defaults spend."""
BATCHES, BATCH_SEEDS = (1, 2, 4, 16, 64), 40
GROWN_SEEDS, TWELFTH_SEEDS = 3, 10


@dataclass(frozen=True)
class Competitor:
    """A search that competes.

    Attributes:
        search: landscape and seed -> the masks evaluated, in order.
        seeds: how many it is run from.
        together: how many of them are one job.
    """

    search: Search
    seeds: int = SEEDS
    together: int = TOGETHER


def entries(pairs: int = LANDSCAPES[0]) -> dict[str, Competitor]:
    """Everything that is compared on so many pairs, by name."""
    found = {
        "sfkit, a model of the score": Competitor(run),
        "the same search by expected improvement": Competitor(
            partial(run, chooser=ExpectedImprovementSubsetSearch)
        ),
    }
    for name, search in searches().items():
        found[name] = Competitor(search, 1 if name == "greedy soup" else SEEDS)
    if importlib.util.find_spec("optuna"):
        from peers_optuna import gp, on_subsets, tpe

        found["Optuna TPE"] = Competitor(on_subsets(tpe, TPE_MOST[pairs]))
        found["Optuna GP"] = Competitor(on_subsets(gp, GP_MOST), SEEDS, 1)
    if importlib.util.find_spec("sklearn") and importlib.util.find_spec("botorch"):
        from peers_models import botorch, scikit_learn, searched_by

        found["the same search by scikit-learn's model"] = Competitor(searched_by(scikit_learn))
        found["the same search by BoTorch's model"] = Competitor(searched_by(botorch), 5, 1)
    return found


def jobs() -> dict[str, Job]:
    """Name -> job: the first seeds of everything first."""
    found: list[tuple[int, str, Job]] = []
    for pairs in LANDSCAPES:
        for name, entry in entries(pairs).items():
            for first in range(0, entry.seeds, entry.together):
                seeds = range(first, min(first + entry.together, entry.seeds))
                job = partial(alone, name, entry.search, pairs, seeds)
                found.append((first, f"search-{pairs:02d}-{slug(name)}-{first:03d}", job))
        for batch in BATCHES:
            for first in range(0, BATCH_SEEDS, TOGETHER):
                seeds = range(first, first + TOGETHER)
                found.append(
                    (
                        first,
                        f"batch-{pairs:02d}-{batch:02d}-{first:03d}",
                        partial(batched, batch, pairs, seeds),
                    )
                )
        for seed in range(GROWN_SEEDS):
            found.append((TOGETHER * seed, f"grown-{pairs:02d}-{seed:03d}", partial(growing, pairs, seed)))
        for seed in range(TWELFTH_SEEDS):
            found.append((seed, f"twelfth-{pairs:02d}-{seed:03d}", partial(gained, pairs, seed)))
    return {name: job for _, name, job in sorted(found, key=lambda one: one[0])}


def slug(name: str) -> str:
    """A search's name as part of a file's."""
    return "".join(letter if letter.isalnum() else "_" for letter in name.lower())


def landscape(pairs: int) -> Landscape:
    """The scores on the first so many validation pairs."""
    return Landscape(subset_scores(), quick=pairs != LANDSCAPES[0])


def alone(name: str, search: Search, pairs: int, seeds: Sequence[int], _: Path) -> pd.DataFrame:
    """The rows of one search on the first bank's scores."""
    return measured(landscape(pairs), name, pairs, search, seeds)


def measured(land: Landscape, name: str, pairs: int, search: Search, seeds: Sequence[int]) -> pd.DataFrame:
    """A row a seed: distinct evaluations until the optimum, infinite without; CPU seconds an evaluation."""
    rows = []
    for seed in seeds:
        began = time.process_time()
        curve = land.regrets(search(land, seed))
        seconds = (time.process_time() - began) / len(curve)
        rows.append((name, pairs, seed, curve.index(0.0) + 1 if 0.0 in curve else np.inf, seconds))
    return pd.DataFrame(rows, columns=["search", "pairs", "seed", "needed", "seconds"])


def batched(batch: int, pairs: int, seeds: Sequence[int], _: Path) -> pd.DataFrame:
    """The model's search by as many workers as a batch has."""
    return in_batches(landscape(pairs), batch, seeds).assign(batch=batch, pairs=pairs)


def growing(pairs: int, seed: int, _: Path) -> pd.DataFrame:
    """A row a newcomer and way."""
    land = landscape(pairs)
    rows = [
        (pairs, seed, newcomer, *row) for newcomer in newcomers(land) for row in grown(land, newcomer, seed)
    ]
    return pd.DataFrame(rows, columns=["pairs", "seed", "newcomer", "way", "needed"])


def twelve(newcomer: str, pairs: int) -> Landscape:
    """The scores of all subsets of the first bank and a twelfth source."""
    return Landscape(grown_scores(newcomer), quick=pairs != LANDSCAPES[0])


def gained(pairs: int, seed: int, _: Path) -> pd.DataFrame:
    """A row a twelfth source and way."""
    rows = [
        (pairs, seed, newcomer, *row)
        for newcomer in NEWCOMERS
        for row in grown(twelve(newcomer, pairs), newcomer, seed)
    ]
    return pd.DataFrame(rows, columns=["pairs", "seed", "newcomer", "way", "needed"])


kept = KeptRuns(__doc__, jobs, RUNS / "optimum")


BATCHED = """### Batches of the model's proposals

One worker for each proposal of a batch, simulated: evaluations of one length but for a spread of 5 %, a batch
begins when the one before has ended. Time is in evaluations; speed-up and losses are against one at a time.
A batch hears the model's own mean for those before (kriging believer)."""
GROWTH = """### A pool that gains a source

Every source of the best subset is the newcomer in turn: the pool without it is searched to the end, then the
whole pool, by the model with its defaults. New evaluations are those that were not in the store. What knows
nothing is the same search whichever source is the newcomer, and counts once: one a seed."""
TWELFTH = """### A twelfth source

The bank's eleven are searched to the end, then the whole pool with a source that was fine-tuned as they were,
in a world of its own: `python benchmarks/twelfth.py` trains two such newcomers and scores all 2048 subsets
with each. A gain is what the best of all 4083 subsets is ahead of the best of the 2036 without the newcomer,
points; where it is 0 the newcomer is of no use, and a search that goes on from what is known has nothing to
find."""


def head() -> str:
    """What the section begins with, and how many evaluations every search may make."""
    names, settings = subset_scores().names, BayesianSubsetSettings()
    default = settings.proposals(SubsetSpace.free(len(names)))
    return f"""## Evaluations until the best of all subsets

`python benchmarks/optimum.py` runs the searches and goes on where it was. On the scores of all subsets of
the sources of `bank`; only distinct evaluations cost, sources scored alone as well, which win nothing.
"Never" stands for a median or a most of searches that ended without it; CPU is what the search itself takes
an evaluation. Those by our model propose at most {MOST}, after {len(names)} sources alone and
{settings.population} subsets; `sfkit search --method bayesian` ends after {default} evaluations unless told
otherwise, so that `within {SOON}` is what its defaults find. Optuna's samplers end after so many evaluations,
TPE after {TPE_MOST[20]} on 20 pairs and after {TPE_MOST[8]} on 8, GP after {GP_MOST}; searches by another
library's model after {MODELS_MOST}. Rows with fewer seeds are those whose searches cost more."""


def section() -> str:
    """Tables of whatever ``benchmarks/optimum.py`` has finished.

    Raises:
        SystemExit: that is nothing.
    """
    if not kept.finished():
        raise SystemExit("nothing is finished yet: run python benchmarks/optimum.py first")
    parts = [head()]
    for text, table in (
        ("", searches_table),
        (BATCHED, batches_table),
        (GROWTH, growth_table),
        (TWELFTH, twelfth_table),
    ):
        tables = [(pairs, table(pairs)) for pairs in LANDSCAPES]
        made = [f"On the first {pairs} validation pairs:\n\n{found}" for pairs, found in tables if found]
        parts += [part for part in (text, *made) if part] if made else []
    return "\n\n".join(parts)


def searches_table(pairs: int) -> str:
    """A row a search; nothing where none is finished."""
    frame = kept.results(f"search-{pairs:02d}-")
    return "" if frame.empty else compared(frame)


def compared(frame: pd.DataFrame) -> str:
    """A row a search, from rows of one seed each."""
    rows = [
        (name, len(part), *share_within(part["needed"]), f"{1000 * part['seconds'].mean():.1f}")
        for name, part in sorted(frame.groupby("search"), key=lambda item: item[1]["needed"].median())
    ]
    heads = ("search", "seeds", *FOUND, "CPU, ms")
    return markdown_lines(heads, rows)


FOUND = ("found it", "median", "most", f"within {SOON}", f"within {LATER}")


def share_within(needed: pd.Series) -> tuple[str, ...]:
    """Share of seeds that found it, median, most, and shares that did so soon: columns ``FOUND``."""
    shares = [(needed < float("inf")).mean(), (needed <= SOON).mean(), (needed <= LATER).mean()]
    found, soon, later = map(percent, shares)
    return found, number(needed.median()), number(needed.max()), soon, later


def number(value: float) -> str:
    """A count; one that is infinite was never reached."""
    return "never" if value == float("inf") else f"{value:.0f}"


def batches_table(pairs: int) -> str:
    """A row a size of batch; nothing where none is finished."""
    frame = kept.results(f"batch-{pairs:02d}-")
    if frame.empty or 1 not in set(frame["batch"]):
        return ""
    one = frame[frame["batch"] == 1]
    rows = []
    for batch, part in frame.groupby("batch"):
        found, median, most, sixty, ninety = share_within(part["needed"])
        lost = part["needed"].median() - one["needed"].median()
        gained = one["wall"].median() / part["wall"].median()
        share = f"{100 * gained / batch:.0f} %"
        busy = f"{100 * part['busy'].mean():.0f} %"
        cost = f"{1000 * part['seconds'].mean():.1f}"
        rows.append(
            (
                batch,
                len(part),
                found,
                median,
                most,
                sixty,
                ninety,
                number(lost),
                number(part["rounds"].median()),
                f"{part['wall'].median():.1f}",
                f"{gained:.1f}",
                share,
                busy,
                cost,
            )
        )
    heads = (
        "batch",
        "seeds",
        *FOUND,
        "lost to batching",
        "rounds",
        "time",
        "speed-up",
        "efficiency",
        "workers busy",
        "CPU, ms",
    )
    return markdown_lines(heads, rows)


def growth_table(pairs: int) -> str:
    """A row a way; nothing where none is finished."""
    frame = kept.results(f"grown-{pairs:02d}-")
    if frame.empty:
        return ""
    heads = ("search of the grown pool", "searches", "found it", "median new evaluations", "most")
    return markdown_lines(heads, list(by_way(frame)))


def twelfth_table(pairs: int) -> str:
    """A row a newcomer and way; nothing where none is finished."""
    frame = kept.results(f"twelfth-{pairs:02d}-")
    if frame.empty:
        return ""
    rows = []
    for newcomer, part in frame.groupby("newcomer"):
        gain = landscape(pairs).best - twelve(str(newcomer), pairs).best
        rows += [(newcomer, f"{gain:.2f}", *row) for row in by_way(part)]
    heads = (
        "newcomer",
        "gain",
        "search of the grown pool",
        "searches",
        "found it",
        "median new evaluations",
        "most",
    )
    return markdown_lines(heads, rows)


def by_way(frame: pd.DataFrame) -> Iterator[tuple[object, ...]]:
    """Of each way to search a grown pool: searches, share that found the best, median and most."""
    for way in GROWN:
        part = frame[frame["way"] == way]
        if "nothing known" in way:
            part = part.drop_duplicates("seed")
        found, median, most, *_ = share_within(part["needed"])
        yield way, len(part), found, median, most


if __name__ == "__main__":
    kept.main()
