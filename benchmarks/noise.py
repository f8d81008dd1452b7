"""Noise over images: what a model gains from knowing it, and what racing saves.

    python benchmarks/noise.py --minutes 10           # go on with what is missing, at most so long
    python benchmarks/noise.py racing                 # a part of it
    python benchmarks/noise.py --pool bank-sharp      # on another bank whose subsets are all scored
    python benchmarks/results.py noise noise-sharp    # write what is there into docs/results.md

Noise: Stage 1's evaluations (of the first bank ``stage2.py``'s store has them) teach two
models on all windows but one and foretell the scores on that one. Both have the same length scales; one takes
the noise to be equal everywhere, the other as large as the spread over images of the difference to the best,
for each merge. Racing: on the scores of all subsets a search scores 8 pairs of 20, and finishes the 12 others
of its most promising subsets alone; racing during the search, and more searches on all pairs, are in
``sections/racing.py``.
"""

from __future__ import annotations

import argparse
from functools import partial
from pathlib import Path

import numpy as np
import pandas as pd
from bayesian import search_of
from exhaustive import subset_scores, table_path
from kept import RUNS, Job, KeptRuns
from landscapes import Landscape
from stage2_worlds import BANK, Together, bank_pairs, store_in
from tabulated import markdown_lines

import sfkit
from sfkit.evaluation import Evaluator
from sfkit.search.gaussian_process import NOISES, Array, GaussianProcess, distances, fit, matern
from sfkit.search.surrogate import recipe_features

WORLDS, SEEDS = 10, 10
PASSES = (24, 32, 40)
"""Passes over all 20 pairs that a search may cost."""
FINISHED = (0, 4, 8, 16)
NONE = "none, the scores themselves"
QUICK = 8 / 20
"""What the first 8 pairs cost of an evaluation on all."""


def jobs(bank: str = BANK) -> dict[str, Job]:
    """Name -> job."""
    found: dict[str, Job] = {f"racing-{seed:02d}": partial(racing, bank, seed) for seed in range(SEEDS)}
    return found | {f"images-{seed:02d}": partial(images, bank, seed) for seed in range(WORLDS)}


def racing(bank: str, seed: int, _: Path) -> pd.DataFrame:
    """A row a cost and number of subsets that are finished: the regret on 20 pairs of what is returned.

    With ``finished`` 0 every subset is scored on all 20 pairs.
    """
    table = subset_scores(table_path(bank))
    whole, quick = Landscape(table), Landscape(table, quick=True)
    orders = {land: evaluated(land, seed) for land in (whole, quick)}
    rows = []
    for passes in PASSES:
        for finished in FINISHED:
            if finished:
                # Rounded: 8 pairs of 20 are no binary fraction, and truncation would lose one.
                met = orders[quick][: round((passes - (1 - QUICK) * finished) / QUICK)]
                met = sorted(met, key=lambda mask: quick.scores[mask])[:finished]
            else:
                met = orders[whole][:passes]
            several = [mask for mask in met if mask.bit_count() >= 2]
            regret = min(whole.scores[mask] for mask in several) - whole.best
            rows.append((seed, passes, finished, regret))
    return pd.DataFrame(rows, columns=["seed", "passes", "finished", "regret"])


def evaluated(land: Landscape, seed: int) -> list[int]:
    """The masks that the model evaluates, in order; sources alone cost and win nothing."""
    search = search_of(land, seed)
    while not search.done and len(search.candidates) < max(PASSES) / QUICK:
        search.step()
    return [sum(1 << search.sources.index(source) for source in c.subset) for c in search.candidates]


def images(bank: str, seed: int, folder: Path) -> pd.DataFrame:
    """A row a window left out: how far both models' means are from its scores.

    ``correlation`` is over the merges, ``regret`` of the merge with the smallest mean, in points.
    """
    pool, settings = sfkit.open_pool(bank), sfkit.BayesianSubsetSettings(seed=seed)
    with store_in(RUNS / "stage2" if bank == BANK else folder) as store:
        evaluator = sfkit.Evaluator(pool, bank_pairs(seed), store=store)
        search = sfkit.BayesianSubsetSearch(pool.names, pool.blocks, Together(evaluator), settings)
        search.run()
        alone = [c for c in search.candidates if not c.repeated]
        table = np.array([scores(evaluator, c.outcome.key) for c in alone])  # (merges, windows)
    points = recipe_features((c.recipe for c in alone), pool.names, pool.blocks)[:1]
    rows = []
    for out in range(table.shape[1]):
        means = by_noise(points, np.delete(table, out, axis=1))
        rows += [(seed, out, name, *told(mean, table[:, out])) for name, mean in means.items()]
    return pd.DataFrame(rows, columns=["seed", "window", "noise", "correlation", "regret"])


def by_noise(points: tuple[Array, ...], seen: Array) -> dict[str, Array]:
    """Both models' means of merges by their scores on images, (merges, images), and the mean score itself."""
    values = seen.mean(axis=1)
    apart = seen - seen[np.argmin(values)]
    spread = apart.var(axis=1, ddof=1) / seen.shape[1]
    process = fit(points, values)
    shares = {"equal": np.ones(len(values)), "by merge": spread / spread.mean()}
    found = {
        name: posterior_mean(process, points, values, np.maximum(share, 0.05))
        for name, share in shares.items()
    }
    return {**found, NONE: values}


def scores(evaluator: Evaluator, key: str) -> list[float]:
    """The score on each image alone."""
    held = evaluator.store.get(key)
    assert held is not None
    return [evaluator.score([image]) for image in held.images]


def told(mean: Array, unseen: Array) -> tuple[float, float]:
    """Rank correlation with the unseen scores, and the regret of the smallest mean."""
    ranks = np.corrcoef(mean.argsort().argsort(), unseen.argsort().argsort())[0, 1]
    return float(ranks), float(unseen[np.argmin(mean)] - unseen.min())


def posterior_mean(
    process: GaussianProcess, points: tuple[Array, ...], values: Array, shares: Array
) -> Array:
    """At the points themselves, noise in proportion to ``shares``, its size of the highest evidence."""
    kernel = matern(distances(points, points), process.lengths)
    found = []
    for noise in (*NOISES, 0.3, 1.0):
        factor = np.linalg.cholesky(kernel + np.diag(noise * shares + 1e-8))
        ones, along = np.linalg.solve(factor, np.stack([np.ones(len(values)), values], axis=1)).T
        mean = ones @ along / (ones @ ones)
        rest = along - mean * ones
        evidence = -0.5 * len(values) * np.log(rest @ rest) - np.log(np.diag(factor)).sum()
        found.append((evidence, mean + kernel @ np.linalg.solve(factor.T, rest)))
    return np.asarray(max(found, key=lambda one: one[0])[1])


def kept_of(bank: str = BANK) -> KeptRuns:
    """The runs on a bank, those of another than the first in a folder of their own."""
    return KeptRuns(__doc__, partial(jobs, bank), RUNS / ("noise" if bank == BANK else f"noise-{bank}"))


kept = kept_of()


HEAD = """## Does a model gain from knowing how noisy scores are?

`python benchmarks/noise.py` goes on where it was. No network runs: what is taken apart was scored before.
The defaults of `--method bayesian` are what follows from it: one noise for all merges, whole evaluations."""
IMAGES = """### Noise by the spread over images

Stage 1's evaluations in {searches} searches on `{pool}`, {windows} windows each: on all but one a model
learns the score, with noise that is equal everywhere or, by merge, the spread over images of its difference
to the best. Rank correlation of its mean with the scores on the window left out, and how far the merge it
prefers is from the best there, points; means over searches and windows."""
RACING = """### Racing

The table of all subsets of `{pool}`, {seeds} seeds: a search scores 8 pairs of 20, which costs 0.4 of an
evaluation, and finishes the 12 others of its best subsets alone. Regret on 20 pairs of what is returned, at
the mean in points, and in brackets in how many seeds it is the optimum, by what the search costs in
evaluations on 20 pairs."""


def section() -> str:
    """Tables of whatever ``benchmarks/noise.py`` has finished.

    Raises:
        SystemExit: that is nothing.
    """
    return written(kept, HEAD, BANK)


def written(kept: KeptRuns, head: str, pool: str) -> str:
    """The tables of finished runs on a pool, below what their section begins with.

    Raises:
        SystemExit: nothing is finished.
    """
    parts = [images_table(kept.results("images-"), pool), racing_table(kept.results("racing-"), pool)]
    if not any(parts):
        raise SystemExit("nothing is finished yet: run python benchmarks/noise.py first")
    return "\n\n".join([head, *filter(None, parts)])


def images_table(frame: pd.DataFrame, pool: str) -> str:
    """A row a kind of noise; nothing where none is finished."""
    if frame.empty:
        return ""
    means = frame.groupby("noise", sort=False)[["correlation", "regret"]].mean()
    rows = [(name, f"{row.correlation:.3f}", f"{row.regret:.2f}") for name, row in means.iterrows()]
    text = IMAGES.format(searches=frame["seed"].nunique(), windows=frame["window"].nunique(), pool=pool)
    return f"{text}\n\n{markdown_lines(('noise', 'rank correlation', 'regret'), rows)}"


def racing_table(frame: pd.DataFrame, pool: str) -> str:
    """A row a number of subsets that are finished; nothing where none is finished."""
    if frame.empty:
        return ""
    costs = sorted(frame["passes"].unique())
    rows = []
    for finished, part in frame.groupby("finished"):
        regrets = [part.loc[part["passes"] == cost, "regret"] for cost in costs]
        cells = [f"{one.mean():.3f} ({(one == 0.0).sum()} of {len(one)})" for one in regrets]
        rows.append((f"best {finished} finished" if finished else "no racing", *cells))
    text = RACING.format(seeds=frame["seed"].nunique(), pool=pool)
    return f"{text}\n\n{markdown_lines(('search', *(f'after {cost}' for cost in costs)), rows)}"


if __name__ == "__main__":
    asked = argparse.ArgumentParser(add_help=False)
    asked.add_argument("--pool", default=BANK)
    options, rest = asked.parse_known_args()
    kept_of(options.pool).main(rest)
