"""The paper's whole life cycle by one command: training data, sources, one network, and the costs."""

from __future__ import annotations

import json

import pandas as pd
from kept import RUNS
from processes import sfkit as command
from tabulated import markdown

from sfkit import bank
from sfkit.bank.sharp import JOINT, SOURCE_SETTINGS
from sfkit.datasets.synthetic.domains import BASE
from sfkit.factory import write_example

FOLDER = RUNS / "factory"
POOL = "bank-sharp"
DOMAINS = [name for name in bank.domains() if name != BASE.name]
PAIRS, WORLD_PAIRS = 100, 20
SEARCH = {"population": 20, "generations": 8, "evaluations": 100}
# As the bank's own sources were trained, on a quarter of their scenes.
TRAINING = {"rate": SOURCE_SETTINGS.rate, "augmentation": vars(SOURCE_SETTINGS.augmentation), "workers": 0}


def measure() -> tuple[pd.DataFrame, pd.DataFrame]:
    """Run the factory, or what is left of it: its costs and its scores.

    Trainings that were killed go on where they were, so that hours can be spread over sittings.
    """
    FOLDER.mkdir(parents=True, exist_ok=True)
    file = write_example(
        FOLDER / "factory.toml",
        DOMAINS,
        pairs=PAIRS,
        training=TRAINING,
        validation_pairs=WORLD_PAIRS,
        search=SEARCH,
        joint=True,
        of=POOL,
    )
    command("factory", "run", str(file))
    costs = pd.read_csv(FOLDER / "costs.csv", index_col="part")
    scores = pd.DataFrame(json.loads((FOLDER / "scores.json").read_text(encoding="utf-8"))).T
    return costs, scores.rename_axis("network").sort_values(list(scores.columns)[-1])


def section() -> str:
    """What it wrote."""
    costs, scores = measure()
    overhead = read_overhead(costs)
    return f"""## A whole factory

`sfkit factory run factory.toml` on {len(DOMAINS)} domains of `{POOL}` from nothing but its base:
{PAIRS} scenes each, a quarter of those that the sources shipped with `{POOL}` learned from, so that neither
these seconds nor these scores are that bank's, for ten epochs in batches of eight windows of 128 x 256 px, a
joint network on all of them for the same epochs, then both stages (M = {SEARCH["population"]},
T = {SEARCH["generations"]}, {SEARCH["evaluations"]} evaluations of Stage 2)
on {WORLD_PAIRS} pairs of the validation world.

{markdown(costs.rename(columns={"seconds": "wall seconds", "cpu_seconds": "CPU seconds"}), digits=0)}

`passes` are pairs: shown forward and backward by a training, forward alone by the search. {overhead}

bad-3.0 in percent, lower is better; the first column guided the search:

{markdown(scores)}"""


def read_overhead(costs: pd.DataFrame) -> str:
    """The paper's overhead, in a sentence: the search's seconds in percent of the trainings'."""
    seconds = costs["seconds"]
    search, joint = seconds["search"], seconds[JOINT]
    sources = seconds.drop(["search", JOINT]).sum()
    return (
        f"The search takes {search:,.0f} s of wall time: {search / joint:.0%} of what the joint network's "
        f"training takes, {search / sources:.0%} of the sources'."
    )
