"""``sfkit search``: which sources to merge, and how."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from sfkit.cli.options import (
    BenchmarkOption,
    CodingOption,
    DeviceOption,
    EngineOption,
    JsonOption,
    MetricOption,
    PairsOption,
    PoolArgument,
    ProtocolOption,
    ResolutionOption,
    RootOption,
    StoreOption,
    SubsetFromOption,
    SubsetOption,
    WorkersOption,
    benchmark_of,
    device_of,
    emit,
    names,
    pool_of,
    say,
    source_names,
)
from sfkit.cli.outputs import check_folder, check_store
from sfkit.errors import InputError
from sfkit.evaluation import EvaluationStore, Evaluator
from sfkit.evaluation.engines import check_engine
from sfkit.inspection import recipe_lines
from sfkit.merging.saving import read_recipe
from sfkit.search import Constraints, RoutingSettings, SubsetSettings, subset_of
from sfkit.search.pipeline import Found, Plan, cost, search_pool, summary
from sfkit.search.records import Generation


def search(
    pool: PoolArgument,
    benchmark: BenchmarkOption,
    root: RootOption = None,
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write to.")] = Path("runs/search"),
    protocol: ProtocolOption = None,
    metric: MetricOption = None,
    resolution: ResolutionOption = None,
    csv: PairsOption = None,
    coding: CodingOption = None,
    seed: Annotated[int, typer.Option(help="Governs every draw.")] = 0,
    population: Annotated[int, typer.Option(help="Stage 1: subsets in a population.")] = 50,
    generations: Annotated[int, typer.Option(help="Stage 1: generations.")] = 15,
    evaluations: Annotated[int, typer.Option(help="Stage 2: evaluations; 0 leaves Stage 2 out.")] = 300,
    subset: SubsetOption = None,
    subset_from: SubsetFromOption = None,
    block_specific: Annotated[
        bool, typer.Option("--block-specific", help="Stage 2: routing weights of their own for every block.")
    ] = False,
    entropy: Annotated[float, typer.Option(help="Stage 2: weight of the entropy penalty.")] = 0.0,
    include: Annotated[str | None, typer.Option(help="Sources that must take part: a,b.")] = None,
    exclude: Annotated[str | None, typer.Option(help="Sources that must not take part: a,b.")] = None,
    largest: Annotated[int | None, typer.Option(help="The most sources a subset may have.")] = None,
    frozen: Annotated[str | None, typer.Option(help="Blocks whose scale stays 1: a,b.")] = None,
    start: Annotated[
        Path | None, typer.Option(help="Stage 2: a recipe to start from as well; needs --subset.")
    ] = None,
    store: StoreOption = None,
    device: DeviceOption = "cpu",
    engine: EngineOption = "auto",
    workers: WorkersOption = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Do not ask before a long search.")] = False,
    json: JsonOption = False,
) -> None:
    """Search Stage 1 (which sources) and Stage 2 (how), and write the merged network.

    Interrupted, it goes on where it was when it is started again with the same folder.

    \b
    Examples:
      sfkit search pool.toml -b eth3d -r ~/ETH3D -o runs/garage
      sfkit search pool.toml -b pairs -r ~/pairs --subset a,b --evaluations 200
    """
    plan = Plan(
        subset=_subset(subset, subset_from),
        stage1=SubsetSettings(population=population, generations=generations, seed=seed),
        stage2=None
        if evaluations == 0
        else RoutingSettings(evaluations=evaluations, seed=seed, tied=not block_specific, entropy=entropy),
        constraints=Constraints(names(include or ""), names(exclude or ""), largest, names(frozen or "")),
        start=read_recipe(start) if start is not None else None,
    )
    place = device_of(device)
    check_engine(engine, workers)
    chosen = benchmark_of(benchmark, root, protocol, metric, resolution, csv, coding)
    kept_in = store or out / "evaluations.sqlite"
    _check_outputs(out, kept_in)
    opened = pool_of(pool)
    plan.check(opened)
    prepared = Evaluator(opened, chosen, device=place, engine=engine, workers=workers)
    with EvaluationStore(kept_in) as kept, prepared.with_store(kept) as evaluator:
        say(f"{opened!r}")
        say(f"validation: {chosen.name} ({chosen.coverage}), {evaluator.metric}, protocol {chosen.protocol}")
        say(f"engine: {evaluator.engine.describe()}")
        say(f"cost: {cost(opened, [evaluator], plan)}")
        if sys.stdin.isatty() and not yes and not typer.confirm("Start?", default=True, err=True):
            raise typer.Abort
        found = search_pool(opened, evaluator, plan, out, progress=_progress)
    counts, metric_name = vars(evaluator.counts), str(evaluator.metric)
    document = {**summary(opened, found), "folder": out, "evaluations": counts, "metric": metric_name}
    emit(document, _text(found, evaluator), as_json=json)


def _check_outputs(out: Path, store: Path) -> None:
    check_folder("--out", out)
    check_store(store)
    merged = out / "merged.safetensors"
    if merged.exists() and not (out / "journal.jsonl").exists():
        raise InputError(f"--out: {merged} exists and no search wrote it, choose another folder")


def _subset(text: str | None, file: Path | None) -> tuple[str, ...] | None:
    if text is not None and file is not None:
        raise InputError("found --subset and --subset-from, expected one of the two")
    if file is not None:
        return subset_of(read_recipe(file))
    return None if text is None else source_names("--subset", text)


def _progress(stage: str, generation: Generation[Any]) -> None:
    best = generation.best
    score = "none yet" if best is None else f"{best.score:.4f} ({', '.join(best.subset)})"
    counts = generation.counts
    done = f"{counts.distinct} scored, {counts.cached} of them cached"
    say(f"{stage}, generation {generation.number}: best {score}; {done}")


def _text(found: Found, evaluator: Evaluator) -> str:
    unit = evaluator.metric.unit
    lines = [f"best {evaluator.metric}: {found.score:.4f} {unit}"]
    for stage, best in (("Stage 1", found.stage1), ("Stage 2", found.stage2)):
        if best is not None:
            lines.append(f"  {stage}: {best.score:.4f} {unit}  {', '.join(best.subset)}")
    return "\n".join([*lines, *recipe_lines(found.recipe), f"wrote {found.merged}"])
