"""``sfkit evaluate``: score recipes of a pool on one benchmark."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sfkit.cli import tables
from sfkit.cli.foreseen import roster_of
from sfkit.cli.options import (
    ForceOption,
    JsonOption,
    PoolArgument,
    StoreOption,
    SubsetFromOption,
    SubsetOption,
    choosers,
    emit,
    pool_of,
    prepared,
    say,
    store_of,
)
from sfkit.cli.outputs import Places
from sfkit.cli.panels import BenchmarkOptions, ComputeOptions
from sfkit.cli.terminal import Bars
from sfkit.errors import InputError

if TYPE_CHECKING:
    import pandas as pd

    from sfkit.evaluation import Evaluator
    from sfkit.merging import Pool, Recipe
    from sfkit.merging.steps import Step


def evaluate(
    pool: PoolArgument,
    data: BenchmarkOptions,
    compute: ComputeOptions,
    subset: SubsetOption = None,
    subset_from: SubsetFromOption = None,
    recipe: Annotated[
        list[Path] | None,
        typer.Option("--recipe", help="A recipe as JSON, or a merged network to take it from; or several."),
    ] = None,
    uniform: Annotated[bool, typer.Option("--uniform", help="All sources with equal weights.")] = False,
    all_subsets: Annotated[
        bool, typer.Option("--all-subsets", help="The equal-weight merge of every subset of two or more.")
    ] = False,
    members: Annotated[bool, typer.Option("--members", help="The base and each source by itself.")] = False,
    images: Annotated[bool, typer.Option("--images", help="Scores of every image instead of all.")] = False,
    store: StoreOption = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Also write the scores as CSV.")] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Score networks merged from a pool; lower is better.

    Options that ask for networks add up: --members --uniform scores the base, each source, and their merge.
    So do metrics: --metric bad-1.0,epe.

    \b
    Examples:
      sfkit evaluate pool.toml --subset a,b,c --benchmark pairs --root ~/pairs --metric bad-1.0
      sfkit evaluate pool.toml --members --uniform -b kitti2012 -r ~/KITTI2012 --protocol all-valid
      sfkit evaluate pool.toml --recipe a.json --recipe b.safetensors -b pairs -r ~/pairs --images
      sfkit evaluate pool.toml --all-subsets -b eth3d -r ~/ETH3D --protocol raft --store scores.sqlite
    """
    places = Places(subset_from=subset_from, csv=data.csv)
    for file in recipe or ():
        places.reads("--recipe", file)
    places.file("--out", out, ".csv", force=force)
    places.store(store)
    if subset is None and subset_from is None and not (recipe or uniform or members or all_subsets):
        raise InputError(
            "found nothing to score, expected --subset, --subset-from, --recipe, --uniform, --members or "
            "--all-subsets"
        )
    roster = roster_of(pool)
    asked = choosers(pool=roster, subset=subset, subset_from=subset_from, uniform=uniform)
    for file in recipe or ():
        asked |= choosers(pool=roster, recipe=file)
    chosen, metrics = data.open_by_several()
    from sfkit.evaluation import Evaluator
    from sfkit.evaluation.table import image_table, score_table, write_table

    opened = pool_of(pool)
    recipes = opened.alone() if members else {}
    recipes |= _all_subsets(opened) if all_subsets else {}
    recipes |= {name: choose(opened) for name, choose in asked.items()}
    # One pool for each preparation, not for each recipe: task vectors are large.
    pools = {recipe.preparation: prepared(name, opened, recipe) for name, recipe in recipes.items()}
    evaluator = Evaluator(opened, chosen, also=metrics, compute=compute)
    with store_of(store) as kept, evaluator.with_store(kept) as scorer:
        say(f"engine: {scorer.engine.describe()}")
        with Bars() as bars:

            def advance(benchmark: str, done: int, total: int) -> None:
                bars(benchmark, done, total, line=f"{benchmark}: {done} of {total} networks scored")

            counted = partial(score_table, metrics=metrics, progress=advance)
            scores = _scores(counted, scorer, recipes, pools)
        each = _scores(partial(image_table, metrics=metrics), scorer, recipes, pools) if images else None
    if out is not None:
        write_table(scores if each is None else each, out)
    document = _document(opened, evaluator, scores)
    document |= {} if each is None else {"images": each.to_dict(orient="records")}
    emit(document, _text(evaluator, scores, each), as_json=json)
    # The table tells of those that failed; where all did, the command did.
    if scores["failure"].notna().all():
        raise typer.Exit(1)


def _scores(
    table: Callable[..., pd.DataFrame],
    scorer: Evaluator,
    recipes: Mapping[str, Recipe],
    pools: Mapping[tuple[Step, ...], Pool],
) -> pd.DataFrame:
    """A table of all recipes; each preparation of task vectors has a pool and an evaluator of its own."""
    import pandas as pd

    groups: dict[tuple[Step, ...], dict[str, Recipe]] = {}
    for name, recipe in recipes.items():
        groups.setdefault(recipe.preparation, {})[name] = recipe
    made = [table([scorer.with_pool(pools[steps])], group) for steps, group in groups.items()]
    # Rows stand as they were asked for, whichever group scored them.
    order = {name: place for place, name in enumerate(recipes)}
    found = pd.concat(made, ignore_index=True)
    return found.sort_values("network", key=lambda names: names.map(order), kind="stable", ignore_index=True)


def _all_subsets(pool: Pool) -> dict[str, Recipe]:
    sizes = range(2, len(pool.names) + 1)
    return {"+".join(c): pool.equal(*c) for k in sizes for c in combinations(pool.names, k)}


def _document(pool: Pool, evaluator: Evaluator, scores: pd.DataFrame) -> dict[str, Any]:
    from sfkit.datasets.metric import Metric

    first = Metric.parse(scores["metric"].iloc[0])  # scores of several are not compared with each other
    ranked = scores[scores["metric"] == first.name].dropna(subset="score")
    ranked = ranked.sort_values("score", ascending=first.lower_is_better, kind="stable")
    return {
        "pool": pool.name,
        "benchmark": evaluator.benchmark.describe(),
        "scores": scores.to_dict(orient="records"),
        "best": None if ranked.empty else ranked["network"].iloc[0],
    }


def _text(evaluator: Evaluator, scores: pd.DataFrame, images: pd.DataFrame | None) -> str:
    """A row a network, or a row an image; a column a metric."""
    benchmark = evaluator.benchmark
    units = dict(zip(scores["metric"], scores["unit"], strict=True))
    head = (
        f"{', '.join(units)} under protocol {benchmark.protocol} on {benchmark.name} ({benchmark.coverage})"
    )
    keys = ("network",) if images is None else ("network", "image")
    rows: dict[tuple[str, ...], dict[str, float]] = {}
    for row in (scores if images is None else images).to_dict(orient="records"):
        rows.setdefault(tuple(row[key] for key in keys), {})[row["metric"]] = row["score"]
    heads = {f"{metric} [{unit}]": metric for metric, unit in units.items()}
    failed = dict(zip(scores["network"], scores["failure"], strict=True))
    cells: list[list[str | float | None]] = [
        [*key, *(values[metric] for metric in heads.values())]
        for key, values in rows.items()
        if failed[key[0]] is None
    ]
    table = tables.lines((*keys, *heads), cells, digits=dict.fromkeys(heads, 3)) if cells else []
    return "\n".join([head, *table, *_notes(scores)])


def _notes(scores: pd.DataFrame) -> Iterator[str]:
    """Of networks that failed, and of those that were not finite somewhere."""
    for row in scores.drop_duplicates("network").to_dict(orient="records"):
        if row["failure"] is not None:
            yield f"{row['network']}  failed: {' '.join(str(row['failure']).split())}"
        elif row["flagged"]:
            yield f"{row['network']}: not finite on {row['flagged']} of {row['images']} images"
