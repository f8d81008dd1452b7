"""A twelfth source of the first bank, twice: pools that grow, known in full.

    python benchmarks/twelfth.py                   # train two newcomers, score all subsets with each
    python benchmarks/twelfth.py dusk              # one of them
    python benchmarks/optimum.py twelfth           # search the grown pools

A newcomer is fine-tuned from the bank's base by the bank's own plan, in a world that differs from the base's
along an axis that no source has. The worlds were written down before any training (a third, of curved things,
was left out for time). All 2048 subsets with a newcomer are scored as ``exhaustive.py`` scores those without,
into ``subsets-bank-twelfth.csv`` beside this file: twenty minutes of one core each. A run that was stopped
goes on.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import pandas as pd
from exhaustive import DIGITS, HEADER, SubsetScores, score_subsets, subset_scores
from kept import RUNS
from safetensors.torch import load_file, save_file

import sfkit.bank as bank
from sfkit.bank.measure import errors, held_out_pairs
from sfkit.bank.plan import BANK, TrainingPlan
from sfkit.bank.training import new_network, train
from sfkit.checkpoints.spec import Member, read_pool_spec
from sfkit.datasets.synthetic import Domain
from sfkit.evaluation import EvaluationStore
from sfkit.files import write_text, writing
from sfkit.merging import Pool, open_pool

TABLE = Path(__file__).with_name("subsets-bank-twelfth.csv")
FOLDER = RUNS / "twelfth"
PLAN = BANK.source
assert isinstance(PLAN, TrainingPlan), "the first bank's own"

NEWCOMERS = {
    world.name: world
    for world in (
        Domain("close-by", "large disparities only, over 18 pixels", disparity=(18.0, 44.0), objects=(5, 9)),
        Domain("dusk", "half the light, in both views alike", brightness=(0.3, 0.6), contrast=(0.5, 0.9)),
    )
}


def trained(world: Domain) -> Path:
    """The newcomer's checkpoint, trained unless it lies there; says what it gained in its own world."""
    path = FOLDER / f"{world.name}.safetensors"
    if path.exists():
        return path
    FOLDER.mkdir(parents=True, exist_ok=True)
    base = load_file(read_pool_spec(bank.pool_path(BANK.name)).base.path)
    weights = dict(train(world, PLAN, base, FOLDER / f"{world.name}.state").weights)
    network, pairs = new_network(PLAN.seed), held_out_pairs(world)
    for name, state in (("base", base), (world.name, weights)):
        network.load_state_dict(state)
        found = errors(network, pairs)
        print(f"{name} in its world: EPE {found['epe']:.3f} px, bad-3.0 {found['bad3']:.2f} %", flush=True)
    with writing(path) as fresh:
        save_file(weights, fresh)
    return path


def grown_pool(world: Domain) -> Pool:
    """The bank with its twelfth source, which is the last."""
    spec = read_pool_spec(bank.pool_path(BANK.name))
    return open_pool(replace(spec, sources=(*spec.sources, Member(world.name, trained(world)))))


def with_newcomer(names: Sequence[str]) -> range:
    """The masks of all subsets that the last of the names is in."""
    return range(1 << len(names) - 1, 1 << len(names))


def score(world: Domain) -> pd.DataFrame:
    """A row a subset with the newcomer, ascending by bit mask."""

    def say(done: int, total: int) -> None:
        if done % 50 == 0 or done == total:
            print(f"{world.name}: {done} of {total} subsets", file=sys.stderr, flush=True)

    pool = grown_pool(world)
    with EvaluationStore(FOLDER / f"{world.name}.sqlite") as store:
        found = score_subsets(pool, with_newcomer(pool.names), store, say)
    rows = [(world.name, mask, found.scores[mask], found.quick[mask]) for mask in found.scores]
    return pd.DataFrame(rows, columns=["newcomer", *HEADER])


def grown_scores(newcomer: str, path: Path = TABLE) -> SubsetScores:
    """The scores of all subsets of twelve sources: the first bank's, and those with the newcomer."""
    eleven, frame = subset_scores(), pd.read_csv(path)
    rows = frame[frame["newcomer"] == newcomer]
    tables = (eleven.scores, eleven.quick)
    scores, quick = (
        {**table, **dict(zip(rows["subset"], rows[column], strict=True))}
        for table, column in zip(tables, HEADER[1:], strict=True)
    )
    return SubsetScores((*eleven.names, newcomer), scores, quick)


def main(arguments: Sequence[str] | None = None) -> None:
    """Train and score what is asked for, and write the table of all newcomers that are scored."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("newcomers", nargs="*", help="all unless named")
    options = parser.parse_args(arguments)
    for name in options.newcomers or NEWCOMERS:
        write_text(FOLDER / f"{name}.csv", score(NEWCOMERS[name]).to_csv(index=False))
    frames = list(_scored())
    if len(frames) == len(NEWCOMERS):
        text = pd.concat(frames).to_csv(index=False, float_format=f"%.{DIGITS}f", lineterminator="\n")
        write_text(TABLE, text)
        print(TABLE)


def _scored() -> Iterator[pd.DataFrame]:
    for name in NEWCOMERS:
        if (path := FOLDER / f"{name}.csv").exists():
            yield pd.read_csv(path)


if __name__ == "__main__":
    main()
