"""``sfkit demo``: the whole method on networks that come with sfkit."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from sfkit.cli.options import ForceOption, JsonOption, emit
from sfkit.cli.outputs import Places
from sfkit.cli.panels import NotebookComputeOptions
from sfkit.cli.terminal import Bars
from sfkit.search.run_folder import LOCK, OUTPUTS, SEARCH, STORE

if TYPE_CHECKING:
    from sfkit.bank.demo import Demo


def demo(
    compute: NotebookComputeOptions,
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write to.")] = Path("runs/demo"),
    seed: Annotated[int, typer.Option(min=0, help="Governs every draw.")] = 0,
    report: Annotated[bool, typer.Option("--report/--no-report", help="Also write report.html.")] = True,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Search the embedded bank of 12 small trained networks, and test what was found.

    Everything is computed on this machine, in about two minutes on two cores.

    \b
    Example:
      sfkit demo
    """
    Places().folder(
        "--out", out, (*OUTPUTS, SEARCH, LOCK, STORE, "scores.csv", "report.html", "report.ipynb")
    )
    from sfkit.bank.demo import demo as run_demo  # with all of Jupyter behind it, too slow for other commands

    with Bars() as bars:

        def advance(step: str, done: int, of: int, note: str) -> None:
            bars(step, done, of, note, line=f"{step}: {done} of {of}{f', {note}' if note else ''}")

        found = run_demo(out, seed=seed, compute=compute, with_report=report, progress=advance, force=force)
    document = {
        "verdict": found.verdict.as_dict(),
        "table": found.table.to_dict(orient="index"),
        "subset": found.subset,
        "evaluations": found.evaluations,
        "forward_passes": found.forward_passes,
        "seconds": found.seconds,
        "cpu_seconds": found.cpu_seconds,
        "merged": found.merged,
        "report": found.report,
        "scores": found.scores,
    }
    emit(document, _text(found), as_json=json)


def _text(found: Demo) -> str:
    table = found.table.to_string(float_format=lambda value: f"{value:.2f}")
    return "\n".join(
        [
            "",
            found.verdict.verdict.sentence,
            "",
            table,
            "",
            "* guided the search; the others are unseen. Lower is better.",
            f"Stage 1 chose {', '.join(found.subset)}.",
            f"{found.evaluations} evaluations, {found.forward_passes} forward passes, {found.seconds:.0f} s "
            f"({found.cpu_seconds:.0f} s of CPU).",
            f"The paper's search, of at most {found.proposed['paper']} evaluations here; by a model "
            f"at most {found.proposed['bayesian']} (sfkit search --method bayesian).",
            f"network: {found.merged}",
            f"table:   {found.scores}",
            *([f"report:  {found.report}"] if found.report else []),
        ]
    )
