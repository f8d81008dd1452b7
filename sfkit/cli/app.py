"""The application: its commands, and how errors leave it."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from typing import TextIO

import typer

import sfkit
from sfkit.cli import cache, data, evaluate, merge, predict, report, search, show
from sfkit.errors import SfkitError

app = typer.Typer(
    name="sfkit",
    help="Merge stereo-matching networks: find which fine-tuned checkpoints to mix, and how.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
app.command("search")(search.search)
app.command("merge")(merge.merge)
app.command("evaluate")(evaluate.evaluate)
app.command("predict")(predict.predict)
app.command("show")(show.show)
app.command("report")(report.report)
app.add_typer(data.app, name="data")
app.add_typer(cache.app, name="cache")

# typer's own copy of click names this class nowhere in public: it is what BadParameter derives from.
UsageError: type[Exception] = typer.BadParameter.__mro__[1]


@app.callback(invoke_without_command=True)
def _root(
    version: bool = typer.Option(False, "--version", help="Print the version and exit."),
) -> None:
    if version:
        typer.echo(f"sfkit {sfkit.__version__}")
        raise typer.Exit


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit: 0 for success, 2 for bad input, 130 when interrupted."""
    warnings.showwarning = _warn
    try:
        words = list(sys.argv[1:] if arguments is None else arguments)
        words = report.join_parameters(words) if words[:1] == ["report"] else words
        code = app(words, standalone_mode=False)
    except UsageError as error:
        code = _refuse(str(getattr(error, "message", "") or error), usage=error)
    except SfkitError as error:
        code = _refuse(str(error))
    except (KeyboardInterrupt, typer.Abort):
        typer.echo("interrupted: what was evaluated is stored, start again to go on", err=True)
        code = 130
    sys.exit(code if isinstance(code, int) else 0)


def _refuse(message: str, usage: object = None) -> int:
    sentence = " ".join(message.split())
    context = getattr(usage, "ctx", None)
    if context is not None:
        sentence = f"{sentence.rstrip('.')}, see {context.command_path} --help"
    typer.echo(f"error: {sentence}", err=True)
    return 2


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    typer.echo(f"warning: {' '.join(str(message).split())}", err=True)
