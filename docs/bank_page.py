"""``docs/bank.md``: the bank that demo and notebooks open, beside the first one, made by a command.

Run ``python docs/bank_page.py`` in a checkout, after ``docs/bank_first_page.py``, whose recorded table is
what was before; ``--store`` keeps what is evaluated, so that a second call scores nothing again.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from bank_first_page import (
    benchmark_section,
    conclusions,
    domain_sections,
    markdown,
    training_table,
    with_mean,
)
from bank_pictures import Picture, beside, write_picture
from bank_scores import UNIFORM, BankScores, bank_scores
from bank_stability import SUBSETS, rank_stability

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))

from tabulated import markdown_lines

import sfkit.bank as bank
from sfkit.bank.plan import BANK, SHARP
from sfkit.bank.sharp import BASE, JOINT
from sfkit.checkpoints.spec import Member, read_pool_spec
from sfkit.datasets import Sample
from sfkit.evaluation import EvaluationStore
from sfkit.merging import Pool, open_pool

PAGE, FORMER_PAGE = "bank.md", "bank_first.md"
MAPS = Path("images") / "bank" / "before_and_after.jpg"
SHOWN = 3
"""The pair of each benchmark whose maps are shown: chosen before any was looked at."""

INTRODUCTION = """\
# The embedded bank

The [first bank](bank_first.md) shows the method on networks that were trained for minutes: its base
leaves 31 to 38 % bad pixels, no source harms, and scores of two sets of 8 pairs rank subsets with a
correlation of 0.26. `sfkit.open_pool("bank-sharp")` is its successor. Its worlds, seeds and trainings stand
in `sfkit/bank/sharp.py` and were fixed before the first training ran; none was changed for what a source
turned out to do, and those that harm are kept. This page is made by `python docs/bank_page.py`.

{difference}

Scores are bad-3.0 in percent over all pixels with ground truth, mean over images; lower is better.
"""

DIFFERENCE = {
    "network": (
        "AnyNet, 34,629 parameters",
        "`anynet-wide`: features four to eight times as wide from half the size on, the last map raised by "
        "convex combination; 73,942 parameters, 0.3 MB",
    ),
    "base": (
        "2,000 steps of 6 on 300 scenes",
        "20,000 steps of 4 random windows of 128 x 256 px on 3,000 scenes",
    ),
    "base's world": (
        "textured things before a textured backdrop",
        "also bare surfaces, stripes, thin things, tilts, walls and grounds; twice as many things",
    ),
    "sources": (
        "400 steps, up to 960 where the bar asked for it",
        "10 epochs on 400 scenes in batches of 8 such windows by `sfkit.finetune`, batch norm frozen, alike "
        "for all",
    ),
    "worlds": (
        "softened until no source harmed",
        "the same worlds, sharp: 6 of 11 differ more from the base's than before",
    ),
    "joint network": ("none", "one on all sources' scenes together, the same epochs"),
}

DEMO_BEFORE = {
    "base": (31.45, 35.76, 38.50, 35.51, 36.59),
    "single best (open-ground)": (26.09, 37.37, 27.43, 34.91, 33.24),
    "uniform": (28.49, 31.54, 34.95, 27.68, 31.39),
    "Stage 1": (25.76, 31.35, 25.58, 30.51, 29.15),
    "Stage 1+2": (24.42, 31.81, 25.43, 30.85, 29.36),
}
"""`sfkit demo` on the first bank (2026-11-27): 8 generations and 100 evaluations, 40 test pairs a world."""

BUILD = """\
## Every subset

All 2,047 equal-weight merges were scored on 20 pairs of the validation world
(`benchmarks/subsets-bank-sharp.csv`; `benchmarks/README.md` says what searches need there). It is another
landscape than the first bank's: of two sources or more the best merge, uneven-exposure with scanned-street,
has 11.05 % and scanned-street alone 11.00; half of all merges are above 17.10, the worst has 29.86. Equal
weights alone gain nothing on these 20 pairs.

## What is left

- Demo, report and notebooks open this bank; many recorded results are of `bank`, as they say.
- Comparisons of Stage 2 on it (`evidence-sharp`) are of windows and of few draws yet.
- A pair costs this network about 1.3 times what it costs the first bank's.

## How to build it

    sfkit bank build bank-sharp            # into runs/bank-sharp: base, sources, joint network

It calls `sfkit.finetune` for each network, as `sfkit finetune` and `sfkit factory` do; in a `factory.toml` a
source of it is `data = "bank-sharp:haze"`, with the settings of `sfkit/bank/sharp.py` as `[training]`.
Stopped at any moment it goes on where it was: states lie in `NAME.training`, every 100 steps, rendered pairs
in `rendered` (6 GB in all). `pool.toml` is written when base and sources are there; called again it adds
the joint network. The results depend on the code that trains: keep one copy of it for the whole bank.
"""


def write_page(
    docs: Path, *, pool_file: Path | None = None, store: Path | None = None, pairs: int | None = None
) -> Path:
    """Score every network of the bank, and write the page with its picture; return the page's path.

    ``pool_file`` is the shipped bank's unless given, and the joint network is shown where it lies beside it;
    ``pairs`` scores only the first so many pairs of everything, for a quick look.
    """
    file = pool_file or bank.pool_path(SHARP.name)
    former = open_pool(BANK.name)
    pool = open_pool(file)
    with EvaluationStore(store or ":memory:") as kept:
        joined = with_joint(file)
        scores = bank_scores(joined, file.parent, store=kept, pairs=pairs, of=SHARP.name)
        ranks = rank_stability(pool, of=SHARP.name, store=kept, pairs=pairs)
    write_picture(docs / MAPS, maps(former, pool))
    page = docs / PAGE
    before = recorded_benchmarks((Path(__file__).parent / FORMER_PAGE).read_text(encoding="utf-8"))
    page.write_text("\n".join([introduction(), *_sections(scores, before, ranks), BUILD]), encoding="utf-8")
    return page


def introduction() -> str:
    """What the bank is, and how it differs from the first one."""
    rows = [[what, *both] for what, both in DIFFERENCE.items()]
    table = markdown_lines(["", "`bank`", "`bank-sharp`"], rows, [False] * 3)
    return INTRODUCTION.format(difference=table)


def with_joint(file: Path) -> Pool:
    """The pool, and the joint network as one more source where it lies beside it."""
    spec = read_pool_spec(file)
    joint = file.with_name(f"{JOINT}.safetensors")
    if joint.exists():
        spec = replace(spec, sources=(*spec.sources, Member(JOINT, joint, spec.base.licence)))
    return open_pool(spec)


def recorded_benchmarks(page: str) -> pd.DataFrame:
    """The first bank's networks by benchmarks, bad-3.0 in percent, as its page shows them."""
    section = page.split("## Benchmarks, bad-3.0 in percent")[1].split("\n## ")[0]
    return _table(section)[list(bank.benchmarks())]


def _table(section: str) -> pd.DataFrame:
    """The first table of a section, its first column the index."""
    lines = [line.strip("|").split("|") for line in section.splitlines() if line.startswith("|")]
    head, _, *rows = [[cell.strip(" *") for cell in line] for line in lines]
    values = {name: [float(cell) for cell in numbers] for name, *numbers in rows}
    return pd.DataFrame.from_dict(values, orient="index", columns=head[1:])


def demo_before_and_after(results: str) -> pd.DataFrame:
    """What ``sfkit demo`` found on the first bank, and what docs/results.md says it finds on this one."""
    after = _table(results.split("<!-- begin demo -->")[1].split("<!-- end demo -->")[0])
    after.columns = pd.Index([column.partition(" ")[0] for column in after.columns])
    rows = {}
    for (first, values), (name, row) in zip(DEMO_BEFORE.items(), after.iterrows(), strict=True):
        rows[f"{first}, before"] = dict(zip(after.columns, values, strict=True))
        rows[f"{name}, after"] = row.to_dict()
    return pd.DataFrame.from_dict(rows, orient="index").rename(columns={"mean": "mean of the unseen"})


def maps(former: Pool, pool: Pool) -> Picture:
    """A row a benchmark: left view, truth, then the first bank's base and this one's, each with its error."""
    rows = []
    for name in bank.benchmarks():
        sample = bank.benchmark(name).pairs[SHOWN].load()
        rows.append(beside(sample, [_base_map(former, sample), _base_map(pool, sample)]))
    return np.vstack(rows)


def _sections(scores: BankScores, before: pd.DataFrame, ranks: pd.DataFrame) -> Iterator[str]:
    alone = replace(
        scores,
        **{
            name: getattr(scores, name).drop(index=JOINT, errors="ignore")
            for name in ("benchmarks", "domains", "errors")
        },
        trainings={name: record for name, record in scores.trainings.items() if name != JOINT},
    )
    yield "## What a reader should conclude\n"
    yield from (f"- {sentence}" for sentence in conclusions(alone))
    if JOINT in scores.benchmarks.index:
        yield f"- {joint_sentence(scores)}"
    yield "\n## Before and after\n"
    yield "The same pairs of the same worlds, in percent; single networks are sources alone.\n"
    yield markdown(before_and_after(before, scores.benchmarks))
    yield f"\nPair {SHOWN} of each benchmark: left view, truth, then the base's map and its error (white from"
    yield "6 px on), the first bank's and this one's.\n"
    yield f"![Maps of both banks' bases]({MAPS.as_posix()})"
    yield "\n## What the demo finds\n"
    yield "Both stages guided by 8 pairs of courtyard, bad-3.0 in percent. Before, they had 8 generations and"
    yield "100 evaluations and were tested on 40 pairs of each other world, now 6 and 80 and the first 20.\n"
    results = (Path(__file__).parent / "results.md").read_text(encoding="utf-8")
    yield markdown(demo_before_and_after(results), digits=2)
    yield from benchmark_section(scores)
    yield "\n## How alike two halves of the pairs rank subsets\n"
    yield f"Mean Spearman correlation over 50 random halves of the first n pairs, of {SUBSETS} random subsets"
    yield f"merged equally; the benchmarks have {SHARP.pairs} pairs (`python docs/bank_stability.py`).\n"
    yield markdown(ranks.rename(columns=lambda n: f"{n} pairs"), digits=2).replace("network", "benchmark", 1)
    yield from domain_sections(scores)
    yield "\n## Trainings\n"
    yield "Measured on held-out pairs of the own domain, the joint network on those of all sources. Seconds"
    yield "are on the clock of a machine that other work shared; a quiet one needs the CPU seconds.\n"
    yield training_table(scores.trainings)
    yield ""


def before_and_after(before: pd.DataFrame, after: pd.DataFrame) -> pd.DataFrame:
    """Base, best, mean and worst single source, equal mixture and joint network of both banks."""
    rows = {}
    tables = {"before": before, "after": after}
    for when, table in tables.items():
        alone = table.drop(index=[BASE.name, UNIFORM, JOINT], errors="ignore")
        order = alone.drop(columns=bank.VALIDATION).mean(axis=1).sort_values().index
        rows[f"base, {when}"] = table.loc[BASE.name]
        rows[f"best single ({order[0]}), {when}"] = table.loc[order[0]]
        rows[f"mean of single, {when}"] = alone.mean()
        rows[f"worst single ({order[-1]}), {when}"] = table.loc[order[-1]]
        rows[f"uniform, {when}"] = table.loc[UNIFORM]
        if JOINT in table.index:
            rows[f"joint, {when}"] = table.loc[JOINT]
    half = list(rows)[:5]
    ordered = [name for pair in zip(half, list(rows)[5:10], strict=True) for name in pair] + list(rows)[10:]
    return with_mean(pd.DataFrame(rows).T.loc[ordered])


def joint_sentence(scores: BankScores) -> str:
    """The joint network beside base, uniform and the best source, on the mean of the unseen."""
    unseen = scores.unseen
    sources = unseen.drop([BASE.name, UNIFORM, JOINT])
    return (
        f"The joint network, {scores.trainings[JOINT]['cpu_seconds'] / 60:.0f} CPU minutes on all sources' "
        f"scenes, has {unseen[JOINT]:.1f} % there; base {unseen[BASE.name]:.1f} %, all merged equally "
        f"{unseen[UNIFORM]:.1f} %, the best source ({sources.idxmin()}) {sources.min():.1f} %."
    )


def _base_map(pool: Pool, sample: Sample) -> np.ndarray:
    prepared = pool.architecture.inputs(pool.options).prepare(sample.left, sample.right)
    live = pool.merge(pool.base_recipe())
    return prepared.window.crop(live.disparity(prepared.left, prepared.right)).numpy()


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--pool", type=Path, help="a pool.toml that is no part of the package yet")
    parser.add_argument("--store", type=Path, default=Path("runs/bank_sharp.sqlite"))
    parser.add_argument("--docs", type=Path, default=Path(__file__).parent)
    options = parser.parse_args()
    print(write_page(options.docs, pool_file=options.pool, store=options.store))
