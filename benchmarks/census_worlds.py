"""How ``census`` ranks merges of a bank on its four worlds, beside the true error, and what trust says.

    python benchmarks/census_worlds.py --pool bank --json

Of single sources, all of them, all but one, and subsets drawn at random, bad-3.0 and both scales of census
are kept, a line a network and pair: started again it goes on where it was. The two scales stand beside each
other because guides that disagree might betray a failure without labels.
"""

from __future__ import annotations

import csv
from pathlib import Path
from typing import Any

import census_bank
import numpy as np
import torch
from numpy.typing import NDArray
from processes import call, shown
from sections.census import worlds
from stages import answered

import sfkit
from sfkit import bank
from sfkit.analysis.ranking import agreement, drawn_networks, rank_correlation, yardstick_recipes
from sfkit.analysis.tables import markdown_lines
from sfkit.analysis.trust import Trust, signs_of, stability
from sfkit.datasets import Sample
from sfkit.datasets.census import SCALES, CensusTarget
from sfkit.evaluation.metrics import bad
from sfkit.merging import Pool
from sfkit.merging.live import LiveModel

TRUE = 3.0  # pixels: bad-3.0
Table = NDArray[np.float64]


class WorldRanking:
    """The first pairs of a world, made ready: they have one size and go through a network together."""

    def __init__(self, pool: Pool, name: str, pairs: int) -> None:
        inputs = pool.architecture.inputs(pool.options)
        self.samples: list[Sample] = list(bank.benchmark(name).first(pairs).samples())
        made = [inputs.prepare(sample.left, sample.right) for sample in self.samples]
        self.left, self.right = (torch.cat([getattr(p, side) for p in made]) for side in ("left", "right"))
        self.windows = [pair.window for pair in made]
        self.targets = [
            [CensusTarget(sample.left, sample.right, scales=(scale,)) for scale in SCALES]
            for sample in self.samples
        ]

    def maps(self, live: LiveModel) -> list[NDArray[np.float32]]:
        """(H, W) in pixels, a pair each."""
        with torch.inference_mode():
            output = live.network(self.left, self.right).reshape(len(self.windows), *self.left.shape[-2:])
        return [window.crop(map_).numpy() for window, map_ in zip(self.windows, output, strict=True)]

    def scores(self, live: LiveModel) -> list[tuple[float, float, float]]:
        """Of each pair bad-3.0, and census at the fine and at the coarse scale, in percent."""
        return [
            (bad(map_, sample.disparity, TRUE), *(target.residual(map_).score for target in targets))
            for map_, sample, targets in zip(self.maps(live), self.samples, self.targets, strict=True)
        ]


def measure(pool: str, pairs: int, subsets: int, store: Path) -> list[dict[str, Any]]:
    """One row a world."""
    torch.set_num_threads(1)
    opened = sfkit.open_pool(pool)
    networks = drawn_networks(opened, max(subsets - 2 * len(opened.names) - 1, 0))
    live, worlds = LiveModel(opened), {name: WorldRanking(opened, name, pairs) for name in bank.benchmarks()}
    store.parent.mkdir(parents=True, exist_ok=True)
    with store.open("a", newline="") as stream:
        known = _kept(store)
        for name, recipe in networks.items():
            if all((world, name, n) in known for world in worlds for n in range(pairs)):
                continue
            live.apply(recipe)
            for world, ready in worlds.items():
                rows = [(world, name, n, *found) for n, found in enumerate(ready.scores(live))]
                csv.writer(stream).writerows(rows)
            stream.flush()
    known = _kept(store)
    usual = [name for name in yardstick_recipes(opened) if name != "base"]
    names = [name for name in networks if name != "base"]
    found = []
    for world, ready in worlds.items():
        table = np.array([[known[world, name, n] for n in range(pairs)] for name in names])
        best = names[int(table[..., 1:].mean(axis=(1, 2)).argmin())]
        live.apply(networks[best])
        truths = dict(zip(names, table[..., 0].mean(axis=1).tolist(), strict=True))
        single = min(opened.names, key=lambda name: truths[name])
        row = {"world": world, "uniform": truths["uniform"], "single": truths[single], "picked": truths[best]}
        few = [names.index(name) for name in usual]
        found.append(row | _told(table, few, ready, ready.maps(live), f"bad-3.0 on {world}"))
    return found


def _told(
    table: Table, usual: list[int], world: WorldRanking, maps: list[NDArray[np.float32]], metric: str
) -> dict[str, Any]:
    """Rankings and sentences, from (networks, pairs, scores)."""
    truth, fine, coarse = table.mean(axis=1).T
    census = table[..., 1:].mean(axis=2)
    agreed = agreement(census.mean(axis=1), truth, metric)
    seen = [signs_of(sample, map_) for sample, map_ in zip(world.samples, maps, strict=True)]
    texture, inside, collapsed = np.mean(seen, axis=0).tolist()
    said = [
        Trust(labels, stability(census[usual]), texture, inside, collapsed, table.shape[1]).sentence
        for labels in (None, agreed)
    ]
    return {
        "networks": len(table),
        "pairs": table.shape[1],
        "best": float(truth.min()),
        "correlation": agreed.correlation,
        "interval": agreed.interval,
        "fine": rank_correlation(fine, truth),
        "coarse": rank_correlation(coarse, truth),
        "two scales": rank_correlation(fine, coarse),
        "halves": stability(census),
        "without labels": said[0],
        "with labels": said[1],
    }


def _kept(store: Path) -> dict[tuple[str, str, int], tuple[float, ...]]:
    with store.open(newline="") as stream:
        return {(w, name, int(n)): tuple(map(float, scores)) for w, name, n, *scores in csv.reader(stream)}


OPTIONS = {"pool": "bank", "pairs": 8, "subsets": 63, "store": Path("runs/census_worlds.csv")}
"""Of the command line; a file for each pool and number of pairs."""


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


if __name__ == "__main__":
    answered(__doc__, measure, OPTIONS)
