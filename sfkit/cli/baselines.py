"""``sfkit baselines``: the methods one compares with, all tuned on one benchmark."""

from __future__ import annotations

import ast
import math
import sys
from collections.abc import Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sfkit.architectures.code import imported_files
from sfkit.cli.foreseen import roster_of
from sfkit.cli.groups import names
from sfkit.cli.options import ForceOption, JsonOption, PoolArgument, StoreOption, emit, pool_of
from sfkit.cli.outputs import Places
from sfkit.cli.panels import BenchmarkOptions, ComputeOptions, GuidanceOptions, Stage1Settings, Stage2Settings
from sfkit.cli.terminal import Bars
from sfkit.cli.validation import described, guide_of, guides_of, scoring, trust_entry, trust_lines
from sfkit.errors import InputError, ensure_known
from sfkit.files import PACKAGE

if TYPE_CHECKING:
    from sfkit.baselines import BaselineResult, BaselineRun
    from sfkit.evaluation import Evaluator

ORACLES = ("single_best_oracle",)
"""Those of sfkit's own that see the benchmarks one reports on; a test holds them to the registry."""


@cache
def methods() -> tuple[str, ...]:
    """What comes with sfkit, as tables list it: read where that stands, since importing it takes torch."""
    text = (PACKAGE / "baselines" / "__init__.py").read_text(encoding="utf-8")
    calls = (node for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Call))
    (arranged,) = (call for call in calls if getattr(call.func, "id", "") == "arrange")
    return tuple(entry.id for entry in arranged.args if isinstance(entry, ast.Name))


def baselines(
    pool: PoolArgument,
    data: BenchmarkOptions,
    guidance: GuidanceOptions,
    stage1: Stage1Settings,
    stage2: Stage2Settings,
    compute: ComputeOptions,
    methods: Annotated[
        str | None,
        typer.Option("--names", help="Methods to run: uniform,ties,dare. All that suit unless given."),
    ] = None,
    store: StoreOption = None,
    out: Annotated[Path | None, typer.Option("--out", "-o", help="Also write the table as CSV.")] = None,
    force: ForceOption = False,
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
      sfkit baselines pool.toml -b pairs -r ~/pairs --names stage1,stage1_2 --mutation 0.5 --sigma 0.25
      sfkit baselines pool.toml -b eth3d -r ~/ETH3D --also kitti2012,root=~/KITTI --combine worst
      sfkit baselines pool.toml -b unlabelled -r ~/drive --every 20 --names uniform,adamerging,stage1
    """
    named = None if methods is None else _methods(methods)
    roster_of(pool)
    places = Places(csv=data.csv)
    places.file("--out", out, ".csv", force=force)
    places.store(store)
    guides, combine = guides_of(data, guidance), guidance.combine
    from sfkit.analysis.trust import trust_of
    from sfkit.baselines import baseline_table, run_baselines
    from sfkit.evaluation.table import write_table

    both = {"which": stage1, "how": stage2}
    opened = pool_of(pool)
    guide = guide_of(opened, guides, combine, compute)
    with scoring(opened, guide, store) as (evaluators, scorer), Bars() as bars:

        def advance(label: str, done: int, total: int) -> None:
            line = f"{done} of {total} methods done" + (f", now {label}" if label else "")
            bars("methods", done, total, f"now {label}" if label else "", line=line)

        for evaluator in evaluators:
            evaluator.listen = lambda _done, total: bars.within(0, total)  # time goes on within a method
        run = run_baselines(
            opened,
            scorer,
            named,
            seed=stage1.seed,
            population=stage1.population,
            generations=stage1.generations,
            evaluations=stage2.evaluations,
            settings={"stage1": {"which": stage1}, "stage1_2": both, "averaged": both},
            progress=advance,
        )
        best = min(run.results.values(), key=lambda one: one.score, default=None)
        found = (None, None) if best is None else (best.recipe, best.pool)
        trusted = trust_of(opened, evaluators, found[0], found_in=found[1])
    if out is not None:
        write_table(baseline_table(run), out)
    document = {
        "pool": opened.name,
        "benchmark": guides[0].describe(),
        **described(guides, combine),
        "metric": str(evaluators[0].metric),
        "unit": evaluators[0].metric.unit,
        "seed": stage1.seed,
        "stage1": asdict(stage1),
        "stage2": asdict(stage2),
        "baselines": [_entry(result) for result in run.results.values()],
        "skipped": run.skipped,
    }
    text = _text(evaluators, combine, run)
    if trusted is not None:
        document |= trust_entry(trusted)
        text = "\n".join([text, *trust_lines(trusted)])
    emit(document, text, as_json=json)


def _methods(text: str) -> tuple[str, ...]:
    """The methods that are asked for, refused before any of them runs."""
    # Each once, in the order that was asked for.
    found = tuple(dict.fromkeys(names(text)))
    if not found:
        raise InputError("--names is empty, expected methods such as uniform,task_arithmetic,ties")
    for name in found:
        if _is_oracle(name):
            raise InputError(
                f"--names: {name!r} looks at the benchmarks one reports on, and this command has none but "
                "validation: leave it out, or use sfkit report"
            )
    return found


def _is_oracle(name: str) -> bool:
    """Whether a method sees what one reports on; of sfkit's own without torch, which others may need."""
    if not any(imported_files()) and "sfkit.baselines.registry" not in sys.modules:
        ensure_known("baseline", name, methods())
        return name in ORACLES
    from sfkit.baselines import baseline_named

    return baseline_named(name).oracle


def _entry(result: BaselineResult) -> dict[str, Any]:
    return {
        "name": result.name,
        "label": result.label,
        "score": result.score,
        "settings": dict(result.settings),
        "evaluations": result.evaluations,
        "image_passes": result.image_passes,
        "seconds": result.seconds,
        "cpu_seconds": result.cpu_seconds,
        "note": result.note,
        "recipe": result.pool.bound(result.recipe).document(),
    }


def _text(evaluators: Sequence[Evaluator], combine: str, run: BaselineRun) -> str:
    from sfkit.baselines import baseline_named, baseline_table
    from sfkit.evaluation.combining import LABEL

    # Metrics of unlike kinds are compared as changes, which have no unit.
    unlike = len({one.metric.needs_truth for one in evaluators}) > 1
    unit = "" if unlike else evaluators[0].metric.unit
    guides = [f"{one.benchmark.name} (protocol {one.benchmark.protocol})" for one in evaluators]
    rule = f", the {combine} of them" if len(guides) > 1 else ""
    head = f"{LABEL if unlike else evaluators[0].metric} on {', '.join(guides)}{rule}: what tunes them"
    lines = [
        f"{label:24s} {row['validation']:9.3f} {unit}  {row['evaluations']:5d} evaluations"
        f" {row['wall seconds']:8.1f} s ({_seconds(row['CPU seconds'])} of CPU)"
        f"  {', '.join(filter(None, (row['chosen'], row['note'])))}".rstrip()
        for label, row in baseline_table(run).iterrows()
    ]
    skipped = [f"{baseline_named(name).label:24s} skipped: {why}" for name, why in run.skipped.items()]
    return "\n".join([head, *lines, *skipped])


def _seconds(value: float) -> str:
    return "unknown" if math.isnan(value) else f"{value:.1f} s"
