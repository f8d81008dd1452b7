"""Stage 2 in several ways on the same validation pairs: the best score against evaluations.

    python benchmarks/stage2.py --minutes 60          # go on with what is missing, at most so long
    python benchmarks/stage2.py real                  # a part of it
    python benchmarks/stage2.py --list                # what there is to do, and what is done
    python benchmarks/results.py stage2               # write what is there into benchmarks/README.md

Every search is Stage 1 by its model, the same for all ways, then Stage 2 over the subset it found; the table
of all its candidates is kept as a CSV file. Each evaluation goes through a store, so that a run can be
interrupted at any moment. Optuna's samplers take part where they are installed (``make bench``), the real
pool where SFKIT_REAL_DATA says where it lies.

The goal was CMA-ES's score after 300 evaluations within 80 at the median. It is met on the first bank (38, in
twelve searches of which eight got there) and on the real pool (39, in four searches that all got there).
What was chosen by other searches, and what was not kept, is in ``sfkit/search/bayesian_routing.py``.
"""

from __future__ import annotations

import importlib.util
import os
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import islice
from pathlib import Path

import numpy as np
import pandas as pd
from kept import RUNS, Job, KeptRuns
from one_model import one_model
from stage2_worlds import (
    BANK,
    BANK_PAIRS,
    BANK_WINDOW,
    REAL,
    REAL_PAIRS,
    REAL_WINDOW,
    SearchWorld,
    store_in,
    world,
)
from tabulated import markdown_lines

import sfkit
from sfkit.search import BayesianRoutingSearch, BayesianRoutingSettings, RoutingSearch
from sfkit.search.cma_es import pycma
from sfkit.search.encoding import Encoding

DOCUMENT = "benchmarks/README.md"

SEARCHES = {BANK: 12, REAL: 4}
"""Draws of validation pairs."""
SIGMA = 0.5
BATCHES = (2, 4, 16)
"""Proposals of our model at a time, beside one."""
MODEL, CMA_ES, RANDOM, ONE_MODEL = "model", "CMA-ES", "random", "one model, no stages"
HANDED_OVER, LQ_CMA_ES = "model, then CMA-ES", "pycma lq-CMA-ES"

Way = Callable[[SearchWorld], Iterator[float]]
"""World -> the scores of its evaluations, in order, as they come."""


def model(world: SearchWorld, evaluations: int = 100, **more: object) -> Iterator[float]:
    """Our model, which knows what Stage 1 evaluated."""
    settings = BayesianRoutingSettings(evaluations=evaluations, seed=world.seed, **more)  # type: ignore[arg-type]
    search = BayesianRoutingSearch(world.subset, world.pool.blocks, world.scorer, settings, known=world.known)
    return scores_of(search)


def cma_es(world: SearchWorld, evaluations: int = 300, **more: object) -> Iterator[float]:
    """The paper's."""
    settings = sfkit.RoutingSettings(evaluations=evaluations, converge=False, seed=world.seed, **more)  # type: ignore[arg-type]
    return scores_of(RoutingSearch(world.subset, world.pool.blocks, world.scorer, settings))


def handed_over(world: SearchWorld, first: int = 60, evaluations: int = 150) -> Iterator[float]:
    """The model, and from the best it found CMA-ES at half its first step size."""
    before = BayesianRoutingSettings(evaluations=first, seed=world.seed)
    search = BayesianRoutingSearch(world.subset, world.pool.blocks, world.scorer, before, known=world.known)
    yield from scores_of(search)
    start = None if search.best is None else search.best.recipe
    after = sfkit.RoutingSettings(
        evaluations=evaluations - first + 2, sigma=SIGMA / 2, converge=False, seed=world.seed
    )
    found = scores_of(RoutingSearch(world.subset, world.pool.blocks, world.scorer, after, start=start))
    yield from islice(found, 2, None)  # it knows the first two: x = 0 and its start


def scores_of(search: RoutingSearch) -> Iterator[float]:
    """The scores of a search's candidates."""
    for generation in search:
        yield from (candidate.score for candidate in generation.candidates)


def lq_cma_es(world: SearchWorld, evaluations: int = 150) -> Iterator[float]:
    """CMA-ES with pycma's linear and quadratic models of the score (Hansen, GECCO 2019), after x = 0."""
    encoding = Encoding(world.subset, world.pool.blocks)
    scores: list[float] = []

    def objective(x: np.ndarray) -> float:
        scores.append(world.scorer([encoding.decode(np.asarray(x))])[0].score)
        return scores[-1]

    zeros = np.zeros(encoding.dimension)
    objective(zeros)
    # A seed of 0 is the clock's.
    options = {"seed": world.seed + 1, "maxfevals": evaluations - 1, "verbose": -9}
    pycma().fmin_lq_surr2(objective, zeros, SIGMA, options)
    return iter(scores[:evaluations])


def random_search(world: SearchWorld, evaluations: int = 100) -> Iterator[float]:
    """Zeros, then draws from the distribution CMA-ES begins with."""
    encoding = Encoding(world.subset, world.pool.blocks)
    rng = np.random.default_rng([world.seed, 3])
    draws = [np.zeros(encoding.dimension)]
    draws += [SIGMA * rng.standard_normal(encoding.dimension) for _ in range(evaluations - 1)]
    for x in draws:
        yield world.scorer([encoding.decode(x)])[0].score


def ways() -> dict[str, Way]:
    """Everything that is compared, by name."""
    found: dict[str, Way] = {
        MODEL: model,
        CMA_ES: cma_es,
        HANDED_OVER: handed_over,
        ONE_MODEL: one_model,
        LQ_CMA_ES: lq_cma_es,
    }
    if importlib.util.find_spec("optuna"):
        from peers_optuna import cma_sampler, gp_sampler

        found |= {"Optuna GP": gp_sampler, "Optuna CMA-ES": cma_sampler}
    found |= {f"{MODEL}, batches of {batch}": partial(model, batch=batch) for batch in BATCHES}
    return {**found, RANDOM: random_search}


def jobs() -> dict[str, Job]:
    """Name -> job: our two ways of all searches first."""
    kinds = {
        kind: range(count)
        for kind, count in SEARCHES.items()
        if kind == BANK or "SFKIT_REAL_DATA" in os.environ
    }
    named = [
        (name, way, kind, seed)
        for name, way in ways().items()
        for kind, seeds in kinds.items()
        for seed in seeds
    ]
    order = sorted(named, key=lambda job: job[0] not in (MODEL, CMA_ES))
    return {
        f"{kind}-{slug(name)}-{seed:02d}": partial(searched, kind, seed, name, way)
        for name, way, kind, seed in order
    }


def slug(name: str) -> str:
    """A way's name as part of a file's."""
    return name.lower().replace(",", "").replace(" ", "_")


def searched(kind: str, seed: int, name: str, way: Way, folder: Path) -> pd.DataFrame:
    """One search by one way: a row an evaluation, CPU seconds so far beside it."""
    with store_in(folder) as store:
        place = world(kind, seed, store)
        began = time.process_time()
        rows = [(score, time.process_time() - began) for score in way(place)]
    table = pd.DataFrame(rows, columns=["score", "seconds"])
    table.insert(0, "evaluation", range(1, len(table) + 1))
    for column, value in reversed({"world": kind, "seed": seed, "way": name}.items()):
        table.insert(0, column, value)
    return table.assign(
        subset="+".join(place.subset),
        stage1=place.stage1.counts.distinct,
        dimension=len(place.subset) + len(place.pool.blocks),
    )


kept = KeptRuns(__doc__, jobs, RUNS / "stage2")


MARKS = (10, 20, 40, 60, 80, 100, 150, 300)
KEY = ["world", "seed"]
TITLES = {
    BANK: f"On the first bank, {BANK_PAIRS} windows of {' x '.join(map(str, BANK_WINDOW))} px",
    REAL: f"On the real AnyNet pool, {REAL_PAIRS} windows of "
    f"{' x '.join(map(str, REAL_WINDOW))} px of as many data sets",
}
HEAD = """## Stage 2: the best score against evaluations

`python benchmarks/stage2.py` runs the searches and goes on where it was. A search is Stage 1 by its model,
then Stage 2 over the subset it found, on windows of a few validation pairs drawn by the seed. Numbers are
points behind (above 0) or ahead (below 0) of what CMA-ES has after 300 evaluations of the same search:
median and quartiles. Evaluations are those of Stage 2; what has no stages gets those of Stage 1 besides.
`needs` is how many it takes for CMA-ES's score after 300, median over searches, beside how many got there.
`model, then CMA-ES` hands over after 60; in batches a proposal hears the model's own mean for those before;
`one model, no stages` proposes as `model` does, but knows all sources, and an equal merge nobody has scored
where that promises more. `pycma lq-CMA-ES` is CMA-ES with linear and quadratic models of the score, after
x = 0. Weights are tied; for weights of its own for every block see the section `blockwise`, below."""


def section() -> str:
    """Tables of whatever ``benchmarks/stage2.py`` has finished.

    Raises:
        SystemExit: that is nothing, or no search by CMA-ES.
    """
    frame = kept.results("")
    if frame.empty or CMA_ES not in set(frame["way"]):
        raise SystemExit("nothing is finished yet: run python benchmarks/stage2.py first (hours)")
    behind = curves(frame)
    parts = [HEAD]
    for kind, title in TITLES.items():
        part = behind[behind["world"] == kind]
        if not part.empty:
            parts += [f"{title}:", table(part)]
    return "\n\n".join(parts)


def curves(frame: pd.DataFrame) -> pd.DataFrame:
    """A row a search and way: points behind CMA-ES's last after each evaluation, as one array ``behind``.

    Searches that CMA-ES has not finished are left out.
    """
    aim = frame[frame["way"] == CMA_ES].groupby(KEY)["score"].min()
    rows = []
    for (kind, seed, way), part in frame.groupby([*KEY, "way"], sort=False):
        if (kind, seed) in aim.index:
            best = part.sort_values("evaluation")["score"].cummin().to_numpy()
            if way == ONE_MODEL:
                best = best[int(part["stage1"].iloc[0]) :]
            rows.append((kind, seed, way, part["dimension"].iloc[0], best - aim[kind, seed]))
    return pd.DataFrame(rows, columns=[*KEY, "way", "dimension", "behind"])


def table(behind: pd.DataFrame) -> str:
    """A row a way: median and quartiles at each mark it reached, and evaluations it needs."""
    rows = []
    for way, part in behind.groupby("way", sort=False):
        every = list(part["behind"])
        cells = [
            spread([one[mark - 1] for one in every]) if all(len(one) >= mark for one in every) else ""
            for mark in MARKS
        ]
        reached = [int(np.argmax(one <= 0.0)) + 1 if (one <= 0.0).any() else np.inf for one in every]
        needs = np.median(reached)
        there = f"{sum(map(np.isfinite, reached))} of {len(every)}"
        rows.append(
            (
                way,
                f"{part['dimension'].median():.0f}",
                *cells,
                f"{needs:.0f}" if np.isfinite(needs) else "more",
                there,
            )
        )
    return markdown_lines(
        ("Stage 2", "entries of x", *(f"after {mark}" for mark in MARKS), "needs", "reached"), rows
    )


def spread(values: list[float]) -> str:
    """Median, and quartiles in brackets, points."""
    low, middle, high = np.quantile(values, (0.25, 0.5, 0.75))
    return f"{middle:+.2f} ({low:+.2f} to {high:+.2f})"


if __name__ == "__main__":
    kept.main()
