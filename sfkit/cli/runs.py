"""``sfkit runs``: searches on disk, and the evaluations they leave."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sfkit.cli.groups import sub_commands
from sfkit.cli.options import ForceOption, JsonOption, emit, say
from sfkit.cli.outputs import Places
from sfkit.errors import DamagedStoreError, InputError

if TYPE_CHECKING:
    from sfkit.evaluation.store import EvaluationStore

app = sub_commands()

Folder = Annotated[Path, typer.Argument(help="A search's folder.", show_default=False)]
Store = Annotated[Path, typer.Argument(help="An evaluation store.", show_default=False)]


@app.command("list")
def list_runs(
    root: Annotated[Path, typer.Argument(help="Where to look.")] = Path("runs"), json: JsonOption = False
) -> None:
    """List searches with benchmark, state, best score, evaluations, wall and CPU seconds, the latest first.

    \b
    Example:
      sfkit runs list runs
    """
    from sfkit.cli import tables
    from sfkit.search.runs import find_runs, recorded_benchmarks, recorded_metrics, run_rows

    runs = find_runs(root)
    from sfkit.datasets.metric import with_unit

    metrics = {str(run.folder): recorded_metrics(run.folder, with_unit) for run in runs}
    benchmarks = {str(run.folder): recorded_benchmarks(run.folder) for run in runs}
    rows = [
        {**record, "metric": metrics[record["run"]], "benchmark": benchmarks[record["run"]]}
        for record in run_rows(runs)
    ]
    heads = ("run", "stage", "state", "benchmark", "metric", "best", "scored", "seconds", "CPU s")
    keys = {"scored": "evaluations", "CPU s": "cpu_seconds"}
    # Under its head the number says it: eighty columns are few.
    values = [[_brief(head, row[keys.get(head, head)]) for head in heads] for row in rows]
    text = "\n".join(tables.lines(heads, values, digits={"best": 2, "seconds": 0, "CPU s": 0}))
    text = text if rows else f"{root}: no search has left a journal here"
    emit({"root": root, "runs": rows}, text, as_json=json)


def _brief(head: str, value: Any) -> Any:
    return value.removeprefix("Stage ") if head == "stage" else value


@app.command("page")
def page(
    root: Annotated[Path, typer.Argument(help="Where to look.")] = Path("runs"),
    out: Annotated[Path, typer.Option("--out", "-o", help="The HTML file to write.")] = Path("runs.html"),
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Write all searches as one offline page: a sortable table, and what each owes to which source.

    \b
    Example:
      sfkit runs page runs -o runs.html
    """
    from sfkit.files import write_text
    from sfkit.search.runs import find_runs

    Places().file("--out", out, ".html", force=force)
    runs = find_runs(root)
    if not runs:
        raise InputError(f"{root}: no search has left a journal here, expected the folders of searches in it")
    from sfkit.analysis.run_overview import overviews
    from sfkit.figures.run_page import run_page

    searches, metrics = overviews(runs)
    write_text(out, run_page(searches, metrics, f"Searches in {root}"))
    emit({"page": out, "runs": len(runs)}, f"wrote {out}", as_json=json)


@app.command("show")
def show(folder: Folder, json: JsonOption = False) -> None:
    """Say what one search did: states, counts, settings, the best recipe.

    \b
    Example:
      sfkit runs show runs/garage
    """
    from sfkit.cli.inspection import recipe_lines
    from sfkit.merging.recipe import Recipe
    from sfkit.search.runs import read_run

    run = read_run(folder)
    lines = [f"{run.folder}"]
    for stage in run.stages:
        best = "nothing yet" if stage.score is None else f"{stage.score:.2f} ({', '.join(stage.subset)})"
        lines.append(
            f"{stage.stage}: {stage.state.value}{f' ({stage.reason})' if stage.reason else ''}, best {best}"
        )
        counts = ", ".join(
            f"{name} {'unknown' if value is None else f'{value:g}'}" for name, value in stage.counts.items()
        )
        lines.append(f"  {counts}")
        lines += recipe_lines(Recipe.from_dict(stage.recipe)) if stage.recipe else []
    stages = [
        {**vars(stage), "started": str(stage.started), "written": str(stage.written)} for stage in run.stages
    ]
    emit({"folder": run.folder, "stages": stages}, "\n".join(lines), as_json=json)


@app.command("diff")
def diff(first: Folder, second: Folder, json: JsonOption = False) -> None:
    """Set two searches side by side: results, and the settings in which they differ.

    \b
    Example:
      sfkit runs diff runs/garage runs/garage-2
    """
    from sfkit.cli import tables
    from sfkit.search.runs import read_run, run_differences

    heads, rows = run_differences(read_run(first), read_run(second))
    values = [list(map(_short, row)) for row in rows]
    text = "\n".join(tables.lines(heads, values, digits={}))
    emit({"differences": [dict(zip(heads, row, strict=True)) for row in rows]}, text, as_json=json)


@app.command("export")
def export(
    store: Store,
    out: Annotated[Path, typer.Option("--out", "-o", help="A .csv or .parquet file.")],
    json: JsonOption = False,
) -> None:
    """Write every stored evaluation, image by image, as a table.

    \b
    Example:
      sfkit runs export runs/garage/evaluations.sqlite -o evaluations.csv
    """
    places = Places()
    places.reads("STORE", store)
    places.file("--out", out, ".csv", ".parquet", force=False)
    _ensure_file(store)
    from sfkit.evaluation.exchange import export_evaluations

    with _existing(store) as opened:
        written, count = export_evaluations(opened, out), len(opened)
    emit({"file": written, "evaluations": count}, f"wrote {count} evaluations to {written}", as_json=json)


@app.command("import")
def import_(
    source: Store,
    into: Annotated[Path, typer.Option("--into", help="The store to extend; made if need be.")],
    json: JsonOption = False,
) -> None:
    """Copy evaluations from one store into another, such as from another machine, or out of a damaged one.

    \b
    Example:
      sfkit runs import cluster.sqlite --into runs/garage/evaluations.sqlite
    """
    places = Places()
    places.reads("SOURCE", source)
    places.store(into, "--into")
    _ensure_file(source)
    from sfkit.evaluation.exchange import import_evaluations
    from sfkit.evaluation.rescue import rescue
    from sfkit.evaluation.store import EvaluationStore

    lost: tuple[int, ...] = ()
    try:
        with _existing(source) as opened, EvaluationStore(into) as target:
            copied, held = import_evaluations(opened, target)
    # Row by row: what is whole in a damaged file is copied.
    except DamagedStoreError:
        with EvaluationStore(into) as target:
            found = rescue(source, target)
        copied, held, lost = found.copied, found.held, found.lost
        say(f"{source}: is damaged, {len(lost)} of its evaluations cannot be read; the others were")
    document = {"copied": copied, "already_there": held, "lost": len(lost)}
    emit(document, f"copied {copied}, {held} were there", as_json=json)


def _short(text: str | bool) -> str:
    """A number's text with as many digits as one reads."""
    if isinstance(text, bool):
        return "yes" if text else "no"
    try:
        return f"{float(text):.6g}"
    except ValueError:
        return text


def _ensure_file(path: Path) -> None:
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected an evaluation store")


def _existing(path: Path) -> EvaluationStore:
    from sfkit.evaluation.store import EvaluationStore

    _ensure_file(path)
    return EvaluationStore(path, read_only=True)
