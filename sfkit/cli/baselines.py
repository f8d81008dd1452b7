"""``sfkit baselines``: the methods one compares with, all tuned on one benchmark."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import typer

from sfkit.baselines import BaselineResult, BaselineRun, baseline_named, baseline_table, run_baselines
from sfkit.cli.options import (
    BenchmarkOption,
    CodingOption,
    DeviceOption,
    EngineOption,
    EveryOption,
    ForceOption,
    JsonOption,
    MetricOption,
    PairsOption,
    PoolArgument,
    ProtocolOption,
    ResolutionOption,
    RootOption,
    StoreOption,
    WorkersOption,
    benchmark_of,
    device_of,
    emit,
    names,
    pool_of,
    say,
)
from sfkit.cli.outputs import check_file, check_store
from sfkit.cli.validation import (
    AlsoOption,
    CombineOption,
    GenerationsOption,
    PopulationOption,
    SeedOption,
    described,
    guides_of,
    scoring,
)
from sfkit.errors import InputError
from sfkit.evaluation import Compute, Evaluator
from sfkit.evaluation.changes import LABEL
from sfkit.evaluation.table import write_table
from sfkit.search import RoutingSettings, SubsetSettings


def baselines(
    pool: PoolArgument,
    benchmark: BenchmarkOption,
    root: RootOption = None,
    methods: Annotated[
        str | None,
        typer.Option("--names", help="Methods to run: uniform,ties,dare. All that suit unless given."),
    ] = None,
    also: AlsoOption = None,
    combine: CombineOption = "mean",
    seed: SeedOption = 0,
    population: PopulationOption = 50,
    generations: GenerationsOption = 15,
    evaluations: Annotated[int, typer.Option(help="Stage 2: evaluations.")] = 300,
    protocol: ProtocolOption = None,
    metric: MetricOption = None,
    resolution: ResolutionOption = None,
    csv: PairsOption = None,
    coding: CodingOption = None,
    every: EveryOption = None,
    store: StoreOption = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Also write the table as CSV.")] = None,
    force: ForceOption = False,
    device: DeviceOption = "cpu",
    engine: EngineOption = "auto",
    workers: WorkersOption = None,
    json: JsonOption = False,
) -> None:
    """Run the baselines on a validation benchmark: what each chose, scores there, and cost.

    Lower scores are better. Every method is tuned on this benchmark, so compare on others: with --json each
    method gives its recipe, which sfkit evaluate and sfkit merge read from a file.

    \b
    Examples:
      sfkit baselines pool.toml -b eth3d -r ~/ETH3D --store scores.sqlite
      sfkit baselines bank --benchmark bank:courtyard --names uniform,task_arithmetic,ties --seed 1
      sfkit baselines pool.toml -b pairs -r ~/pairs --names dare,stage1 --population 20 --json
      sfkit baselines pool.toml -b eth3d -r ~/ETH3D --also kitti2012,root=~/KITTI --combine worst
    """
    SubsetSettings(population=population, generations=generations, seed=seed)
    RoutingSettings(evaluations=evaluations, seed=seed)
    named = None if methods is None else _methods(methods)
    compute = Compute(device_of(device), engine, workers)
    chosen = benchmark_of(benchmark, root, protocol, metric, resolution, csv, coding, every)
    guides = guides_of(chosen, also, combine)
    if out is not None:
        check_file("--out", out, ".csv", force=force)
    if store is not None:
        check_store(store)
    opened = pool_of(pool)
    with scoring(opened, guides, combine, store, compute) as (evaluators, scorer):
        run = run_baselines(
            opened,
            scorer,
            named,
            seed=seed,
            population=population,
            generations=generations,
            evaluations=evaluations,
            progress=_progress,
        )
    if out is not None:
        write_table(baseline_table(run), out)
    document = {
        "pool": opened.name,
        "benchmark": chosen.describe(),
        **described(guides, combine),
        "metric": str(evaluators[0].metric),
        "unit": evaluators[0].metric.unit,
        "seed": seed,
        "baselines": [_entry(result) for result in run.results.values()],
        "skipped": run.skipped,
    }
    emit(document, _text(evaluators, combine, run), as_json=json)


def _methods(text: str) -> tuple[str, ...]:
    """The methods that are asked for, refused before any of them runs."""
    found = tuple(dict.fromkeys(names(text)))
    if not found:
        raise InputError("--names is empty, expected methods such as uniform,task_arithmetic,ties")
    for name in found:
        if baseline_named(name).oracle:
            raise InputError(
                f"--names: {name!r} looks at the benchmarks one reports on, and this command has none but "
                "validation: leave it out, or use sfkit report"
            )
    return found


def _progress(label: str, done: int, total: int) -> None:
    say(f"{done} of {total} methods done" + (f", now {label}" if label else ""))


def _entry(result: BaselineResult) -> dict[str, Any]:
    return {
        "name": result.name,
        "label": result.label,
        "score": result.score,
        "settings": dict(result.settings),
        "evaluations": result.evaluations,
        "image_passes": result.image_passes,
        "seconds": result.seconds,
        "note": result.note,
        "recipe": result.pool.signed(result.recipe).as_dict(),
    }


def _text(evaluators: Sequence[Evaluator], combine: str, run: BaselineRun) -> str:
    unlike = len({one.metric.needs_truth for one in evaluators}) > 1
    unit = "" if unlike else evaluators[0].metric.unit
    guides = [f"{one.benchmark.name} (protocol {one.benchmark.protocol})" for one in evaluators]
    rule = f", the {combine} of them" if len(guides) > 1 else ""
    head = f"{LABEL if unlike else evaluators[0].metric} on {', '.join(guides)}{rule}: what tunes them"
    lines = [
        f"{label:24s} {row['validation']:9.4f} {unit}  {row['evaluations']:5d} evaluations"
        f" {row['seconds']:8.1f} s  {', '.join(filter(None, (row['chosen'], row['note'])))}".rstrip()
        for label, row in baseline_table(run).iterrows()
    ]
    skipped = [f"{baseline_named(name).label:24s} skipped: {why}" for name, why in run.skipped.items()]
    return "\n".join([head, *lines, *skipped])
