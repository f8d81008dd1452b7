"""``sfkit factory``: from data sets to one network, in one file."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sfkit.cli.groups import PanelCommand, grouped, sub_commands
from sfkit.cli.options import JsonOption, emit
from sfkit.cli.outputs import Places
from sfkit.cli.panels import ComputeOptions
from sfkit.cli.terminal import Bars
from sfkit.cli.validation import trust_entry, trust_lines
from sfkit.outside import read_toml

if TYPE_CHECKING:
    from sfkit.factory import FactoryResult, SearchItem

app = sub_commands()


def _ensure_file(path: Path) -> Path:
    """Refuse a file that is no TOML before anything is imported that could use it."""
    read_toml(path)
    return path


FactoryArgument = Annotated[Path, typer.Argument(help="A factory.toml.", callback=_ensure_file)]


@app.command("run", cls=PanelCommand)
@grouped
def run(
    file: FactoryArgument,
    compute: ComputeOptions,
    devices: Annotated[
        list[str] | None,
        typer.Option(
            "--train-on", help="A device to train on; several train side by side. --device unless given."
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option("--report", help="Also write the report, an HTML file.")
    ] = None,
    json: JsonOption = False,
) -> None:
    """Train what is missing, search, and score; run again after adding a source, only what is new is made.

    With --engine ray the trainings are spread over the cluster, and the search's evaluations too.

    \b
    Examples:
      sfkit factory run factory.toml
      sfkit factory run factory.toml --train-on cuda:0 --train-on cuda:1 --device cuda --report garage.html
    """
    from sfkit.factory.file import JOINT, read_factory

    factory = read_factory(file)
    from sfkit.factory import report_values
    from sfkit.factory import run as run_factory
    from sfkit.factory.outputs import COSTS, POOL, RECORD, SCORES, SEARCH, STORE, ensure_own
    from sfkit.search.run_folder import LOCK, OUTPUTS
    from sfkit.search.run_folder import SEARCH as SEARCH_RECORD

    places = Places()
    places.reads("FILE", file)
    places.reads(f"base in {file}", factory.base)
    places.folder(f"out in {file}", factory.out, (POOL, SCORES, COSTS, RECORD))
    places.folder(f"out in {file}", factory.out / SEARCH, (*OUTPUTS, SEARCH_RECORD, LOCK))
    places.store(factory.out / STORE, f"out in {file}")
    if report is not None:
        report_values(factory)  # refused now rather than after the trainings
        places.file("--report", report, ".html", force=True)
        # The notebook that was run stays beside its page.
        places.claim("--report", report.with_suffix(".ipynb"))
    # Before hours of training.
    ensure_own(factory)
    training = devices or (compute.device,)
    with Bars(side_by_side=len(training) > 1) as bars:
        made = run_factory(factory, devices=training, compute=compute, say=bars.show)
    columns = list(next(iter(made.scores.values())))
    lines = [f"{'network':24s} " + " ".join(f"{c:>16s}" for c in columns)]
    lines += [
        f"{name:24s} " + " ".join(f"{row[c]:16.3f}" for c in columns) for name, row in made.scores.items()
    ]
    measured = (*factory.validation, *factory.tests)
    lines.append(f"scores: {', '.join(f'{one.metric} on {one.name}' for one in measured)}")
    lines.append(
        f"trained {', '.join(made.trained) or 'nothing'}; {made.evaluated} new evaluations; "
        f"wrote {made.found.merged}"
    )
    parts = ", ".join(
        f"{cost.part} {cost.seconds:.0f} s"
        + ("" if cost.cpu_seconds is None else f" ({cost.cpu_seconds:.0f} s of CPU)")
        for cost in made.costs
    )
    lines.append(f"cost: {parts}")
    names = {"sources": "the sources", JOINT: "the joint network"}
    for part, share in made.overhead().items():
        lines.append(f"the search took {share:.1f} % of the training of {names[part]}")
    document = {"scores": made.scores, "trained": made.trained, "evaluated": made.evaluated}
    document |= {"costs": [asdict(cost) for cost in made.costs], "overhead": made.overhead()}
    if made.trust is not None:
        document |= trust_entry(made.trust)
        lines += trust_lines(made.trust)
    if report is not None:
        from sfkit.reports import notebook_path  # with all of Jupyter behind it
        from sfkit.reports import report as write_report

        values = {**report_values(factory), **_training_seconds(made), "out": factory.out / "report"}
        with Bars() as bars:
            written = write_report(notebook_path("report"), values, report, progress=bars.show)
        lines.append(f"wrote {written}")
        document["report"] = report
    emit({**document, "merged": made.found.merged, "pool": made.pool}, "\n".join(lines), as_json=json)


def _training_seconds(made: FactoryResult) -> dict[str, Any]:
    """What the report compares the search's cost with."""
    from sfkit.factory.file import JOINT

    trained = [c for c in made.costs if c.part not in (JOINT, "search")]
    worked = {c.part: c.cpu_seconds for c in trained if c.cpu_seconds is not None}
    return {"training_seconds": {c.part: c.seconds for c in trained}, "training_cpu_seconds": worked}


@app.command("train")
def train(
    file: FactoryArgument,
    name: Annotated[str, typer.Argument(help="A source, or joint.")],
    device: Annotated[str, typer.Option("--device", help="cpu, cuda or cuda:N.")] = "cpu",
    json: JsonOption = False,
) -> None:
    """Train one network of a factory, for schedulers that give each source a machine.

    \b
    Example:
      sfkit factory train factory.toml streets --device cuda
    """
    from sfkit.factory.file import read_factory

    factory = read_factory(file)
    from sfkit.factory import train_one

    with Bars() as bars:
        written = train_one(factory, name, device, bars.show)
    emit({"file": written}, f"wrote {written}", as_json=json)


@app.command("status")
def status(
    file: FactoryArgument,
    measure: Annotated[
        bool,
        typer.Option(
            "--measure",
            help="Time three steps of each kind of training, and an evaluation, where none is known.",
        ),
    ] = False,
    device: Annotated[
        str, typer.Option("--device", help="Where they are timed: cpu, cuda or cuda:N.")
    ] = "cpu",
    json: JsonOption = False,
) -> None:
    """Say what is done, running, interrupted, stale or missing, and what the rest will cost.

    \b
    Examples:
      sfkit factory status factory.toml
      sfkit factory status factory.toml --measure
    """
    from sfkit.factory.file import read_factory

    factory = read_factory(file)
    from sfkit.factory import search_status, time_evaluation, time_steps
    from sfkit.factory import status as factory_status

    items = factory_status(factory, time_steps(factory, device) if measure else None)
    files = {item.name: item.file for item in items}
    search = search_status(factory, files)
    if measure and search.each is None:
        search = search_status(factory, files, time_evaluation(factory, device))
    lines = [f"{'network':24s} {'state':11s} {'steps':>8s} {'done':>8s} {'seconds':>9s} {'left':>9s}"]
    lines += [
        f"{i.name:24s} {i.state:11s} {i.steps:8d} {i.done:8d} {_whole(i.seconds):>9s} {_whole(i.left):>9s}"
        for i in items
    ]
    guides = ", ".join(guide.name for guide in factory.validation)
    lines.append(
        f"search: {search.state}, at most {search.evaluations} evaluations on {guides}; {_cost(search)}"
    )
    if any(i.left is None for i in items) or search.seconds is None:
        lines.append(
            "what is unknown is known once a training, or the search, has taken its first steps; --measure "
            "times a few now"
        )
    document = {"networks": [asdict(i) for i in items], "search": asdict(search)}
    emit(document, "\n".join(lines), as_json=json)


def _whole(seconds: float | None) -> str:
    return "unknown" if seconds is None else f"{seconds:.0f}"


def _cost(search: SearchItem) -> str:
    if search.seconds is None:
        return "its seconds are unknown"
    if search.state == "done":
        return f"it took {search.seconds:.0f} s"
    return f"{search.seconds:.0f} s at most, {search.each:.2f} s each"
