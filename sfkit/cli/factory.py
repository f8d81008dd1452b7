"""``sfkit factory``: from data sets to one network, in one file."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import Annotated

import typer

from sfkit.cli.options import JsonOption, emit, say
from sfkit.factory import read_factory
from sfkit.factory import run as run_factory
from sfkit.factory import status as factory_status

app = typer.Typer(
    help="From data sets to sources to one network.", no_args_is_help=True, rich_markup_mode=None
)
FactoryArgument = Annotated[Path, typer.Argument(help="A factory.toml.")]


@app.command("run")
def run(
    file: FactoryArgument,
    device: Annotated[str, typer.Option("--device", help="cpu, cuda or cuda:N.")] = "cpu",
    json: JsonOption = False,
) -> None:
    """Train what is missing, search, and score; run again after adding a source, only what is new is made.

    \b
    Example:
      sfkit factory run factory.toml
    """
    made = run_factory(read_factory(file), device=device, say=say)
    columns = list(next(iter(made.scores.values())))
    lines = [f"{'network':24s} " + " ".join(f"{c:>16s}" for c in columns)]
    lines += [
        f"{name:24s} " + " ".join(f"{row[c]:16.3f}" for c in columns) for name, row in made.scores.items()
    ]
    lines.append(
        f"trained {', '.join(made.trained) or 'nothing'}; {made.evaluated} new evaluations; "
        f"wrote {made.found.merged}"
    )
    document = {"scores": made.scores, "trained": made.trained, "evaluated": made.evaluated}
    emit({**document, "merged": made.found.merged, "pool": made.pool}, "\n".join(lines), as_json=json)


@app.command("status")
def status(file: FactoryArgument, json: JsonOption = False) -> None:
    """Say what is done, begun, stale or missing, and what the rest will cost.

    \b
    Example:
      sfkit factory status factory.toml
    """
    factory = read_factory(file)
    items = factory_status(factory)
    lines = [f"{'network':24s} {'state':8s} {'steps':>8s} {'seconds':>9s}"]
    lines += [
        f"{i.name:24s} {i.state:8s} {i.steps:8d} {'-' if i.seconds is None else f'{i.seconds:.0f}':>9s}"
        for i in items
    ]
    lines.append(f"search: at most {factory.plan.evaluations} evaluations on {factory.validation}")
    document = {"networks": [asdict(i) for i in items], "evaluations": factory.plan.evaluations}
    emit(document, "\n".join(lines), as_json=json)
