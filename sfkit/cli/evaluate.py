"""``sfkit evaluate``: score recipes of a pool on one benchmark."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from itertools import combinations
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sfkit.cli.options import (
    ForceOption,
    JsonOption,
    PoolArgument,
    RecipeOption,
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
    recipe: RecipeOption = None,
    uniform: Annotated[bool, typer.Option("--uniform", help="All sources with equal weights.")] = False,
    all_subsets: Annotated[
        bool, typer.Option("--all-subsets", help="The equal-weight merge of every subset of two or more.")
    ] = False,
    members: Annotated[bool, typer.Option("--members", help="The base and each source by itself.")] = False,
    store: StoreOption = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Also write the scores as CSV.")] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Score networks merged from a pool; lower is better.

    Options that ask for networks add up: --members --uniform scores the base, each source, and their merge.

    \b
    Examples:
      sfkit evaluate pool.toml --subset a,b,c --benchmark pairs --root ~/pairs --metric bad-1.0
      sfkit evaluate pool.toml --members --uniform -b kitti2012 -r ~/KITTI2012 --protocol all-valid
      sfkit evaluate pool.toml --all-subsets -b eth3d -r ~/ETH3D --protocol raft --store scores.sqlite
    """
    from sfkit.evaluation import Evaluator
    from sfkit.evaluation.table import write_table

    chosen = data.open()
    places = Places(recipe=recipe, subset_from=subset_from, csv=data.csv)
    places.file("--out", out, ".csv", force=force)
    places.store(store)
    asked = choosers(subset=subset, subset_from=subset_from, recipe=recipe, uniform=uniform)
    if not (asked or members or all_subsets):
        raise InputError(
            "found nothing to score, expected --subset, --subset-from, --recipe, --uniform, --members or "
            "--all-subsets"
        )
    opened = pool_of(pool)
    recipes = _members(opened) if members else {}
    recipes |= _all_subsets(opened) if all_subsets else {}
    recipes |= {name: choose(opened) for name, choose in asked.items()}
    pools = {recipe.preparation: prepared(name, opened, recipe) for name, recipe in recipes.items()}
    evaluator = Evaluator(opened, chosen, compute=compute)
    with store_of(store) as kept, evaluator.with_store(kept) as scorer:
        say(f"engine: {scorer.engine.describe()}")
        scores = _scores(scorer, recipes, pools)
    if out is not None:
        write_table(scores, out)
    emit(_document(opened, evaluator, scores), _text(evaluator, scores), as_json=json)
    if scores["failure"].notna().all():
        raise typer.Exit(1)


def _scores(
    scorer: Evaluator, recipes: Mapping[str, Recipe], pools: Mapping[tuple[Step, ...], Pool]
) -> pd.DataFrame:
    """The table of all recipes; each preparation of task vectors has a pool and an evaluator of its own."""
    import pandas as pd

    from sfkit.evaluation.table import score_table

    groups: dict[tuple[Step, ...], dict[str, Recipe]] = {}
    for name, recipe in recipes.items():
        groups.setdefault(recipe.preparation, {})[name] = recipe
    return pd.concat(
        [
            score_table([scorer.with_pool(pools[steps])], group, progress=_progress)
            for steps, group in groups.items()
        ],
        ignore_index=True,
    )


def _members(pool: Pool) -> dict[str, Recipe]:
    return {"base": pool.base_recipe(), **{name: pool.equal(name) for name in pool.names}}


def _all_subsets(pool: Pool) -> dict[str, Recipe]:
    sizes = range(2, len(pool.names) + 1)
    return {"+".join(c): pool.equal(*c) for k in sizes for c in combinations(pool.names, k)}


def _progress(benchmark: str, done: int, total: int) -> None:
    say(f"{benchmark}: {done} of {total} networks scored")


def _document(pool: Pool, evaluator: Evaluator, scores: pd.DataFrame) -> dict[str, Any]:
    ranked = scores.dropna(subset="score").sort_values("score", kind="stable")
    return {
        "pool": pool.name,
        "benchmark": evaluator.benchmark.describe(),
        "scores": scores.to_dict(orient="records"),
        "best": None if ranked.empty else ranked["network"].iloc[0],
    }


def _text(evaluator: Evaluator, scores: pd.DataFrame) -> str:
    benchmark = evaluator.benchmark
    head = (
        f"{evaluator.metric} under protocol {benchmark.protocol} on {benchmark.name} ({benchmark.coverage})"
    )
    return "\n".join([head, *(_line(row) for row in scores.to_dict(orient="records"))])


def _line(row: Mapping[Hashable, Any]) -> str:
    if row["failure"] is not None:
        return f"{row['network']:40s}    failed: {' '.join(str(row['failure']).split())}"
    flag = f"  (not finite on {row['flagged']} of {row['images']} images)" if row["flagged"] else ""
    return f"{row['network']:40s} {row['score']:9.4f} {row['unit']}{flag}"
