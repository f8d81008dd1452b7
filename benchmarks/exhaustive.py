"""Every subset of a bank's sources, scored once: the landscape that Stage 1 searches, known in full.

The first bank's table, ``subsets-bank.csv``, lies beside this file, so that tests and benchmarks compare
searches with the true optimum and run no network. ``python benchmarks/exhaustive.py`` makes it again: 2047
merges on the first 20 of the validation benchmark's pairs, a quarter of an hour of one core; ``--bank`` names
another bank. It is resumable, since every evaluation goes to the store. ``--images`` writes the scores on
each pair alone as well: the first bank's are ``images-bank.csv``.
"""

from __future__ import annotations

import argparse
import csv
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import torch
from numpy.typing import NDArray

import sfkit.bank as bank
from sfkit.bank.plan import BANK
from sfkit.datasets.synthetic.domains import BASE, QUICK_PAIRS
from sfkit.errors import InputError
from sfkit.evaluation import EvaluationStore, Evaluator
from sfkit.evaluation.store import Evaluation, evaluation_key
from sfkit.files import writing
from sfkit.merging import Pool, Recipe, open_pool
from sfkit.merging.live import LiveModel

PAIRS = 20
DIGITS = 4
HEADER = ("subset", "pairs_20", "pairs_8")
# Pairs in one forward pass: on these small images twice as fast as one at a time, and the same bits.
BATCH = 4

CountCallback = Callable[[int, int], None]


@dataclass(frozen=True)
class SubsetScores:
    """The score of each equal-weight merge, bad-3.0 in percent on the validation benchmark.

    Attributes:
        names: the sources, in the pool's order.
        scores: by subset, on the first 20 pairs. A subset is a bit mask, bit i standing for ``names[i]``.
        quick: the same on the first 8 pairs, the quick set that ``sfkit demo`` searches on.
        images: the same on each of the 20 pairs; a table of subsets has none.
    """

    names: tuple[str, ...]
    scores: dict[int, float]
    quick: dict[int, float]
    images: dict[int, tuple[float, ...]] = field(default_factory=dict)

    def mask(self, names: Iterable[str]) -> int:
        """The bit mask of a subset."""
        return sum(1 << self.names.index(name) for name in names)

    def members(self, mask: int) -> tuple[str, ...]:
        """The names in a bit mask, in the pool's order."""
        return tuple(name for i, name in enumerate(self.names) if mask >> i & 1)


def table_path(name: str = BANK.name) -> Path:
    """A bank's table."""
    return Path(__file__).with_name(f"subsets-{name}.csv")


def subset_scores(path: Path | None = None) -> SubsetScores:
    """The first bank's table, or another that :func:`write_scores` wrote: banks share their sources' names.

    Raises:
        InputError: the file is missing or no such table.
    """
    file = path or table_path()
    names = tuple(name for name in bank.domains() if name != BASE.name)
    try:
        with file.open(encoding="utf-8", newline="") as stream:
            header, *rows = csv.reader(stream)
            table = [(int(mask), float(score), float(quick)) for mask, score, quick in rows]
    except (OSError, ValueError) as error:
        raise InputError(
            f"{file}: cannot be read as a table of subsets ({error}), make it with "
            "python benchmarks/exhaustive.py"
        ) from error
    if tuple(header) != HEADER:
        raise InputError(f"{file}: found the columns {header}, expected {list(HEADER)}")
    return SubsetScores(
        names, {mask: score for mask, score, _ in table}, {mask: quick for mask, _, quick in table}
    )


def images_path(name: str = BANK.name) -> Path:
    """A bank's table of scores on each pair."""
    return Path(__file__).with_name(f"images-{name}.csv")


def image_scores(path: Path | None = None) -> dict[int, NDArray[np.float64]]:
    """By subset the score on each of the 20 pairs, of the first bank or another that was written.

    Raises:
        InputError: the file is missing.
    """
    file = path or images_path()
    if not file.is_file():
        raise InputError(
            f"{file}: found none, expected scores by pair, make them with "
            f"python benchmarks/exhaustive.py --images {file.name}"
        )
    rows = np.loadtxt(file, delimiter=",", skiprows=1, ndmin=2)
    return {int(row[0]): row[1:] for row in rows}


def write_images(images: Mapping[int, Sequence[float]], path: Path) -> None:
    """Write scores by pair as CSV, a row a subset, ascending by bit mask, percent with four decimals."""
    with writing(path) as fresh, fresh.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(("subset", *(f"pair_{n + 1}" for n in range(PAIRS))))
        writer.writerows((mask, *(f"{s:.{DIGITS}f}" for s in images[mask])) for mask in sorted(images))


def score_subsets(
    pool: Pool,
    masks: Sequence[int],
    store: EvaluationStore | None = None,
    progress: CountCallback = lambda *_: None,
) -> SubsetScores:
    """Score the equal-weight merges of subsets on the first 20 pairs of the validation benchmark.

    Args:
        pool: a bank's.
        masks: subsets as bit masks over ``pool.names``.
        store: where the evaluations are kept; those it holds are not computed.
        progress: hears how many are done, of how many.
    """
    scorer = Evaluator(pool, bank.benchmark(bank.VALIDATION).first(PAIRS), store=store)
    live = LiveModel(pool)
    found = SubsetScores(pool.names, {}, {})
    for number, mask in enumerate(masks):
        images = evaluated(scorer, live, pool.equal(*found.members(mask))).images
        found.scores[mask] = scorer.score(images)
        found.quick[mask] = scorer.score(images[:QUICK_PAIRS])
        found.images[mask] = tuple(scorer.score([image]) for image in images)
        progress(number + 1, len(masks))
    return found


def evaluated(scorer: Evaluator, live: LiveModel, recipe: Recipe) -> Evaluation:
    """What the evaluator itself would find and store, computed several pairs at a time.

    Of a benchmark whose pairs have one size.
    """
    description = scorer.describe(recipe)
    key = evaluation_key(description)
    if (held := scorer.store.get(key)) is not None:
        return held
    started = time.perf_counter()
    live.apply(recipe)
    prepared = scorer.prepared
    maps = enumerate(_disparities(scorer, live))
    images = tuple(prepared.errors(number, disparity) for number, disparity in maps)
    fresh = Evaluation(key, description, images, None, time.perf_counter() - started)
    return scorer.store.put(fresh)


def _disparities(scorer: Evaluator, live: LiveModel) -> Iterator[NDArray[np.float32]]:
    """(H, W) maps in pixels, a pair each; all pairs of a bank have one size."""
    pairs = [scorer.prepared.pair(n) for n in range(len(scorer.prepared))]
    for first in range(0, len(pairs), BATCH):
        part = pairs[first : first + BATCH]
        left, right = (torch.cat([getattr(pair, side) for pair in part]) for side in ("left", "right"))
        with torch.inference_mode():
            output = live.network(left, right).reshape(len(part), *left.shape[-2:])
        for pair, disparity in zip(part, output, strict=True):
            yield pair.window.crop(disparity).numpy()


def write_scores(scores: SubsetScores, path: Path) -> None:
    """Write the table as CSV, a row a subset, ascending by bit mask, percent with four decimals."""
    with writing(path) as fresh, fresh.open("w", encoding="utf-8", newline="") as stream:
        writer = csv.writer(stream, lineterminator="\n")
        writer.writerow(HEADER)
        for mask in sorted(scores.scores):
            row = (scores.scores[mask], scores.quick[mask])
            writer.writerow((mask, *(f"{score:.{DIGITS}f}" for score in row)))


def main(arguments: Sequence[str] | None = None) -> None:
    """Score all 11 sources and all 2036 subsets of two or more, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--store", type=Path, default=Path("runs/exhaustive.sqlite"))
    parser.add_argument("--out", type=Path, help="of the table; beside this file unless given")
    parser.add_argument("--images", type=Path, help="where to write the scores on each pair, if anywhere")
    parser.add_argument("--bank", default=BANK.name, choices=bank.banks())
    options = parser.parse_args(arguments)
    out = options.out or table_path(options.bank)
    pool = open_pool(bank.pool_path(options.bank))

    def say(done: int, total: int) -> None:
        if done % 50 == 0 or done == total:
            print(f"{done} of {total} subsets", file=sys.stderr, flush=True)

    with EvaluationStore(options.store) as store:
        found = score_subsets(pool, range(1, 1 << len(pool.names)), store, say)
    write_scores(found, out)
    print(out)
    if options.images is not None:
        write_images(found.images, options.images)
        print(options.images)


if __name__ == "__main__":
    main()
