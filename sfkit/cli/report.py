"""``sfkit report``: run a notebook and keep it as one offline HTML file."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from sfkit.cli.options import JsonOption, emit
from sfkit.cli.outputs import Places
from sfkit.cli.terminal import Bars
from sfkit.errors import InputError
from sfkit.outside import once


def report(
    out: Annotated[Path, typer.Option("--out", "-o", help="The HTML file to write.")],
    notebook: Annotated[
        Path, typer.Argument(help="A parameterised notebook, or the name of one that comes with sfkit.")
    ] = Path("report"),
    parameter: Annotated[
        list[str] | None,
        typer.Option(
            "--parameter", "-p", help="A parameter's name and value (JSON, or text).", metavar="NAME VALUE"
        ),
    ] = None,
    figures: Annotated[
        str | None,
        typer.Option("--figures", help="Also write every figure as svg or png; needs Chromium."),
    ] = None,
    json: JsonOption = False,
) -> None:
    """Run a notebook from top to bottom and write it as one HTML file that needs no network.

    A run that fails still leaves a report that shows the failing cell, and ends with exit code 1. Run again,
    an interrupted report computes nothing anew that is in its evaluation store.

    \b
    Example:
      sfkit report -p quick true -o report.html
      sfkit report 01_quickstart -p seed 1 -o quickstart.html --figures svg
    """
    from sfkit.reports.browsers import check_pictures
    from sfkit.reports.notebooks import notebook_path
    from sfkit.reports.parameters import read_parameters

    if figures is not None:
        check_pictures(figures)
    if not notebook.suffix and len(notebook.parts) == 1 and not notebook.exists():
        notebook = notebook_path(str(notebook))
    values = read_parameters(notebook, once("-p", map(_parameter, parameter or [])))
    places = Places()
    places.reads("NOTEBOOK", notebook)
    for name, value in values.items():
        # Any text with an ending may name a file that the notebook reads.
        if isinstance(value, str) and "\0" not in value and Path(value).suffix:
            places.reads(f"-p {name}", Path(value))
    places.file("--out", out, ".html", force=True)
    places.claim("--out", out.with_suffix(".ipynb"))
    from sfkit.reports import report as run_report  # with all of Jupyter behind it

    with Bars() as bars:
        written = run_report(notebook, values, out, progress=bars.show, figures=figures)
    document: dict[str, object] = {"report": written}
    text = f"wrote {written}"
    if figures is not None:
        folder = written.with_name(f"{written.stem}_figures")
        document["figures"] = sorted(folder.glob(f"*.{figures}"))
        text += f" and its figures in {folder}"
    emit(document, text, as_json=json)


def join_parameters(arguments: Sequence[str]) -> list[str]:
    """Papermill's ``-p NAME VALUE``, two words, as the one word ``NAME=VALUE`` that the parser takes."""
    joined: list[str] = []
    words = iter(arguments)
    for word in words:
        joined.append(word)
        if word in ("-p", "--parameter"):
            name = next(words, None)
            # NAME=VALUE is one word already.
            if name is not None:
                joined.append(name if "=" in name else f"{name}={next(words, '')}")
    return joined


def _parameter(text: str) -> tuple[str, str]:
    name, sign, value = text.partition("=")
    if not sign or not name:
        raise InputError(f"-p: found {text!r}, expected a parameter's name and its value")
    return name, value
