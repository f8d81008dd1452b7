"""The application: its commands, and how errors leave it."""

from __future__ import annotations

import errno
import sys
import warnings
from collections.abc import Sequence
from typing import TextIO

import typer

from sfkit.cli import code as own_code
from sfkit.cli.commands import Commands
from sfkit.cli.options import say
from sfkit.errors import InputError, SfkitError, SfkitWarning, StoreError

app = typer.Typer(
    name="sfkit",
    cls=Commands,
    help="Merge stereo-matching networks: find which fine-tuned checkpoints to mix, and how.",
    epilog=own_code.HELP,
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)

# typer's own copy of click names this class nowhere in public: it is what BadParameter derives from.
UsageError: type[Exception] = typer.BadParameter.__mro__[1]


@app.callback(invoke_without_command=True)
def _root(
    version: bool = typer.Option(False, "--version", help="Print the version and exit."),
) -> None:
    if version:
        import sfkit

        typer.echo(f"sfkit {sfkit.__version__}")
        raise typer.Exit


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line and exit.

    The exit code is 0 for success, 1 where what was asked for failed (a notebook's cell, every network),
    2 for bad input, and 130 when interrupted.
    """
    words = list(sys.argv[1:] if arguments is None else arguments)
    with warnings.catch_warnings():
        warnings.simplefilter("default", SfkitWarning)
        warnings.showwarning = _warn
        sys.exit(_run(words))


def _run(words: list[str]) -> int:
    try:
        words, files, trusted = own_code.split(words)
        # Its -p takes two words, as papermill's does, which no parser of options knows.
        if words[:1] == ["report"]:
            from sfkit.cli.report import join_parameters

            words = join_parameters(words)
        with own_code.running(files, trusted=trusted):
            code = app(words, prog_name="sfkit", standalone_mode=False)
    except UsageError as error:
        return _refuse(getattr(error, "format_message", error.__str__)(), 2, usage=error)
    except (InputError, StoreError) as error:
        return _refuse(str(error), 2)
    except SfkitError as error:
        return _refuse(str(error), 1)
    except OSError as error:
        # No file is to blame where the disk is full.
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            return _refuse(f"{error.strerror}: make room and start again, what was evaluated is stored", 2)
        # Without a file it is no slip of the user's, and is shown whole.
        if error.filename is None:
            raise
        return _refuse(f"{error.filename}: {error.strerror}", 2)
    except MemoryError as error:
        return _refuse(f"memory does not suffice ({error}), take smaller images or fewer workers", 2)
    except (KeyboardInterrupt, typer.Abort):
        code = 130
    if code == 130:  # typer, too, makes this of Ctrl-C
        say("interrupted: what was evaluated is stored, start again to go on")
    return code if isinstance(code, int) else 0


def _refuse(message: str, code: int, usage: object = None) -> int:
    if message.startswith("Usage: "):  # a command that has sub-commands was named alone
        say(message)
        return code
    # On one line, however the library broke it.
    sentence = " ".join(message.split()).rstrip(".")
    wanted = getattr(getattr(usage, "param", None), "help", None)
    if sentence.startswith("Missing option") and wanted:  # what to give, not only that something is wanted
        sentence = f"{sentence}, expected {wanted.rstrip('.')}"
    context = getattr(usage, "ctx", None)
    if context is not None:
        sentence = f"{sentence.replace('. Did you', '; did you')} ({context.command_path} --help says more)"
    say(f"error: {sentence}")
    return code


def _warn(
    message: Warning | str,
    category: type[Warning],
    filename: str,
    lineno: int,
    file: TextIO | None = None,
    line: str | None = None,
) -> None:
    say(f"warning: {' '.join(str(message).split())}")
