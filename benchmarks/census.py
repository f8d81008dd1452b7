"""Search without ground truth: how ``census`` ranks networks, and what both stages guided by it find.

    python benchmarks/census.py real      # base and all merges of four real AnyNet sources, five pairs
    python benchmarks/census.py guides    # both stages guided by these pairs, and by labels at equal budget
    python benchmarks/census.py worlds --pool bank-sharp     # a bank's worlds, each guided by its own pairs

The first two need SFKIT_REAL_DATA. Everything scored is kept in a store: started again each goes on where it
was.
"""

from __future__ import annotations

import itertools
import statistics
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

import real_pairs
import torch
from processes import answered, call, shown
from tabulated import numbers

import sfkit
from sfkit import bank, baselines
from sfkit.analysis.ranking import rank_networks, yardstick_recipes
from sfkit.analysis.trust import trust
from sfkit.checkpoints.spec import read_pool_spec
from sfkit.datasets import Benchmark
from sfkit.merging import Pool, Recipe

GUIDES: dict[str, tuple[str, tuple[str, ...]]] = {
    "five unlabelled": ("census", real_pairs.PAIRS),
    "one labelled": ("bad-1.0", ("eth3d",)),
    "three labelled": ("bad-1.0", ("eth3d", "cones", "motorcycle")),
}
REAL, WORLDS = "bad-1.0", "bad-3.0"
"""The true errors."""
SEEDS, PAIRS = 2, 8
"""Of ``guides``; pairs of a world that guide, and twice as many judge."""
POPULATION, GENERATIONS = 16, 6
UNLABELLED, LABELLED, OTHER = "own unlabelled", "own labelled", f"labelled {bank.VALIDATION}"
ENTROPY = baselines.baseline_named("adamerging_blocks")
Row = dict[str, Any]


def measure(
    what: Literal["real", "guides", "worlds"] = "real", pool: str = "bank", folder: Path = Path("runs/census")
) -> list[Row]:
    """One row a network; ``pool`` is the bank of ``worlds``."""
    torch.set_num_threads(1)
    folder.mkdir(parents=True, exist_ok=True)
    with sfkit.EvaluationStore(folder / f"{what}{f'-{pool}' * (what == 'worlds')}.sqlite") as store:
        return list(
            worlds(store, pool) if what == "worlds" else {"real": real, "guides": guides}[what](store)
        )


def real(store: sfkit.EvaluationStore) -> Iterator[Row]:
    """A row a pair, with the propagation stage and without: how ``census`` ranks 16 networks, its pick."""
    for spn in (True, False):
        pool = sfkit.open_pool(replace(read_pool_spec(real_pairs.POOL), options={"spn": spn}))
        names = pool.names
        subsets = (c for size in range(len(names)) for c in itertools.combinations(names, size + 1))
        recipes = {
            "base": pool.base_recipe(),
            **{"+".join(chosen): pool.equal(*chosen) for chosen in subsets},
        }
        scorers = [
            sfkit.Evaluator(pool, benchmark, store=store, also=["census"])
            for benchmark in real_pairs.benchmarks().values()
        ]
        for one in rank_networks(scorers, recipes, REAL):
            truth = dict(zip(one.networks, one.truth.tolist(), strict=True))
            found = {
                "picked": one.truth[one.picked],
                "best": one.truth[one.best],
                "uniform": truth["+".join(names)],
            }
            yield {"pair": one.benchmark, "spn": spn, "correlation": one.agreement.correlation, **found}


def guides(store: sfkit.EvaluationStore) -> Iterator[Row]:
    """A row a network: what guided it, the seed, its subset, and its true error on each pair in percent."""
    pool, benchmarks = real_pairs.opened(), real_pairs.benchmarks()

    def scorers(metric: str, names: Sequence[str]) -> list[sfkit.Evaluator]:
        return [sfkit.Evaluator(pool, benchmarks[name], store=store, metric=metric) for name in names]

    judges = dict(zip(benchmarks, scorers(REAL, tuple(benchmarks)), strict=True))

    def row(guide: str, stage: str, seed: int, recipe: Recipe) -> Row:
        scores = {name: judge([recipe])[0].score for name, judge in judges.items()}
        return {"guide": guide, "stage": stage, "seed": seed, "sources": list(recipe.sources), **scores}

    alone = {name: pool.equal(name) for name in pool.names}
    for name, recipe in {"base": pool.base_recipe(), "uniform": pool.uniform(), **alone}.items():
        yield row("", name, 0, recipe)
    seen = sfkit.CombinedScorer(scorers("census", real_pairs.PAIRS))
    yield row("entropy of five unlabelled", ENTROPY.label, 0, ENTROPY(pool, seen).recipe)
    for seed in range(SEEDS):
        for guide, (metric, names) in GUIDES.items():
            one, *more = scorers(metric, names)
            scorer = sfkit.CombinedScorer([one, *more]) if more else one
            for stage, recipe in stages(
                pool, scorer, seed, population=8, generations=3, evaluations=150
            ).items():
                yield row(guide, stage, seed, recipe)


def stages(
    pool: Pool,
    scorer: sfkit.Evaluator | sfkit.CombinedScorer,
    seed: int,
    *,
    population: int,
    generations: int,
    evaluations: int,
) -> dict[str, Recipe]:
    """What Stage 1 finds, and Stage 2 over its subset."""
    which = sfkit.SubsetSettings(population=population, generations=generations, seed=seed)
    first = sfkit.SubsetSearch(pool.names, pool.blocks, scorer, which).run()
    how = sfkit.RoutingSettings(evaluations=evaluations, converge=False, seed=seed)
    second = sfkit.RoutingSearch(first.subset, pool.blocks, scorer, how).run()
    return {"Stage 1": first.recipe, "Stage 1+2": second.recipe}


def worlds(store: sfkit.EvaluationStore, bank_name: str) -> Iterator[Row]:
    """A row a network and world: what guided it, its true error in percent, and what trust says."""
    pool = sfkit.open_pool(bank_name)

    def scorer(benchmark: Benchmark, metric: str) -> sfkit.Evaluator:
        return sfkit.Evaluator(pool, benchmark, store=store, metric=metric, also=[WORLDS, "census"])

    validation = scorer(bank.benchmark(bank.VALIDATION).first(PAIRS), WORLDS)
    for world in bank.benchmarks():
        whole = bank.benchmark(world)
        unlabelled, labelled = (scorer(whole.first(PAIRS), metric) for metric in ("census", WORLDS))
        judge = scorer(whole.select(whole.ids[PAIRS : 3 * PAIRS]), WORLDS)
        found = {("", "base"): pool.base_recipe(), ("", "uniform"): pool.uniform()}
        for guide, by in {UNLABELLED: unlabelled, LABELLED: labelled, OTHER: validation}.items():
            both = stages(pool, by, 0, population=POPULATION, generations=GENERATIONS, evaluations=80)
            found[guide, "Stage 1+2"] = both["Stage 1+2"]
        found[f"{UNLABELLED}, entropy", "AdaMerging per block"] = ENTROPY(pool, unlabelled).recipe
        for (guide, stage), recipe in found.items():
            score = judge([recipe])[0].score
            yield {"world": world, "guide": guide, "stage": stage, "score": score}
        usual = list(yardstick_recipes(pool).values())
        for stage, labels in (("without labels", None), ("with labels", labelled)):
            yield {
                "world": world,
                "stage": stage,
                "sentence": trust(unlabelled, usual, labelled=labels).sentence,
            }


def section() -> str:
    """The three tables."""

    def told(what: str, text: str, table: Callable[[list[Row]], str]) -> str:
        command = ("census.py", what, "--json")
        return text.format(command=shown(*command)) + "\n\n" + table(call(*command))

    return "\n\n".join(
        [told("real", HEAD, _real), told("guides", GUIDED, _guides), told("worlds", BANK, _worlds)]
    )


HEAD = """## Search without ground truth

`{command}`: base and all 15 merges of the four real AnyNet sources, each pair alone, with the
propagation stage and without. `census` sees the two images and the prediction; the true error is bad-1.0
over all pixels with ground truth, which it never sees. The KITTI 2012 pair belongs to the sources'
training images. VirtualKITTI2's frames, which lie beside these pairs, are left out here and where
sources' frames are ranked. They are images only: without depth there is no true error to compare with."""
GUIDED = """### Both stages guided without labels

`{command}`: bad-1.0 in percent on each pair, over all pixels with ground truth. The unlabelled
guide sees the images of all five pairs; of a labelled guide's own pairs the columns are validation
scores. Stage 1 with M = 8, T = 3, Stage 2 with 150 evaluations for every guide, two seeds. AdaMerging, 100
steps of gradient descent on the entropy of the matching, is the other guide without labels."""
BANK = f"""### The first bank's worlds, each guided by its own pairs

`{{command}}`: eight pairs of a world guide both stages (M = {POPULATION},
T = {GENERATIONS}, 80 evaluations) without their labels or with them, eight labelled ones of
{bank.VALIDATION} do instead, and AdaMerging descends on their entropy. bad-3.0 in percent on 16 further
pairs of that world, one seed."""


def _real(rows: list[Row]) -> str:
    heads = ("pair", "stage", "rank correlation", "its pick", "best", "uniform")
    keys = ("correlation", "picked", "best", "uniform")
    stage = {True: "with propagation", False: "without"}
    return numbers(heads, ((r["pair"], stage[r["spn"]], *(f"{r[key]:.2f}" for key in keys)) for r in rows), 2)


def _guides(rows: list[Row]) -> str:
    lines = []
    for row in rows:
        errors = [row[pair] for pair in real_pairs.PAIRS]
        cells = (f"{error:.2f}" for error in (*errors, statistics.fmean(errors)))
        lines.append((row["guide"], row["stage"], row["seed"] if row["guide"] else "", *cells))
    return numbers(("guide", "network", "seed", *real_pairs.PAIRS, "mean"), lines, 2)


def _worlds(rows: list[Row]) -> str:
    """A column a world, then what is said of trust."""
    places = list(dict.fromkeys(row["world"] for row in rows))
    found: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if "score" in row:
            found.setdefault((row["guide"], row["stage"]), []).append(f"{row['score']:.2f}")
    table = numbers(("guide", "network", *places), [(*who, *scores) for who, scores in found.items()], 2)
    said = [f"- {row['world']}, {row['stage']}: {row['sentence']}" for row in rows if "sentence" in row]
    return "\n".join([table, "", "What the trust sentence says of each world:", "", *said])


if __name__ == "__main__":
    answered(measure)
