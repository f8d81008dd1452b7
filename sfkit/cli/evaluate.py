"""``sfkit evaluate``: score recipes of a pool on one benchmark."""

from __future__ import annotations

from itertools import combinations
from pathlib import Path
from typing import Annotated

import typer

from sfkit.cli.options import (
    BenchmarkOption,
    DeviceOption,
    JsonOption,
    MetricOption,
    PairsOption,
    PoolArgument,
    ProtocolOption,
    RecipeOption,
    ResolutionOption,
    RootOption,
    StoreOption,
    SubsetOption,
    benchmark_of,
    device_of,
    emit,
    pool_of,
    recipe_of,
    store_of,
)
from sfkit.errors import InputError
from sfkit.evaluation import score_recipes
from sfkit.evaluation.table import write_table
from sfkit.merging import Pool, Recipe


def evaluate(
    pool: PoolArgument,
    benchmark: BenchmarkOption,
    root: RootOption = None,
    subset: SubsetOption = None,
    recipe: RecipeOption = None,
    uniform: Annotated[bool, typer.Option("--uniform", help="All sources with equal weights.")] = False,
    all_subsets: Annotated[
        bool, typer.Option("--all-subsets", help="The equal-weight merge of every subset of two or more.")
    ] = False,
    members: Annotated[bool, typer.Option("--members", help="The base and each source by itself.")] = False,
    protocol: ProtocolOption = None,
    metric: MetricOption = None,
    resolution: ResolutionOption = None,
    csv: PairsOption = None,
    store: StoreOption = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Also write the scores as CSV.")] = None,
    device: DeviceOption = "cpu",
    json: JsonOption = False,
) -> None:
    """Score networks merged from a pool; lower is better.

    \b
    Examples:
      sfkit evaluate pool.toml --subset a,b,c --benchmark pairs --root ~/pairs --metric bad-1.0
      sfkit evaluate pool.toml --all-subsets -b eth3d -r ~/ETH3D --protocol raft --store scores.sqlite
    """
    chosen = benchmark_of(benchmark, root, protocol, metric, resolution, csv)
    place = device_of(device)
    opened = pool_of(pool)
    recipes = _recipes(opened, subset, recipe, uniform=uniform, all_subsets=all_subsets, members=members)
    with store_of(store) as kept:
        scores = score_recipes(opened, recipes, [chosen], store=kept, device=place)
    if out is not None:
        write_table(scores, out)
    ranked = scores.dropna(subset="score").sort_values("score", kind="stable")
    lines = [f"{row.network:40s} {row.score:9.4f} {row.unit}" for row in scores.itertuples()]
    head = f"{chosen.metric} under protocol {chosen.protocol} on {chosen.name} ({chosen.coverage})"
    document = {
        "pool": opened.name,
        "benchmark": chosen.describe(),
        "scores": scores.to_dict(orient="records"),
        "best": None if ranked.empty else ranked["network"].iloc[0],
    }
    emit(document, "\n".join([head, *lines]), as_json=json)


def _recipes(
    pool: Pool,
    subset: str | None,
    recipe: Path | None,
    *,
    uniform: bool,
    all_subsets: bool,
    members: bool,
) -> dict[str, Recipe]:
    if all_subsets or members:
        if subset is not None or recipe is not None or uniform:
            raise InputError("expected --all-subsets or --members without --subset, --recipe and --uniform")
        found = {"base": pool.base_recipe(), **{n: pool.equal(n) for n in pool.names}} if members else {}
        if all_subsets:
            sizes = range(2, len(pool.names) + 1)
            found |= {"+".join(c): pool.equal(*c) for k in sizes for c in combinations(pool.names, k)}
        return found
    one = recipe_of(pool, subset, recipe, uniform=uniform)
    return {str(recipe) if recipe is not None else "+".join(one.sources): one}
