"""``--import FILE`` and ``--trust-code``, which every command takes: the user's own architectures."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import typer

from sfkit.architectures import code
from sfkit.errors import InputError

HELP = (
    "Every command also takes --import FILE, Python code that registers your own architecture, and "
    "--trust-code, to run the code that a pool.toml names without being asked."
)


def split(words: Sequence[str]) -> tuple[list[str], list[Path], bool]:
    """A command line without the two options, the files they name, and whether code is trusted.

    Raises:
        InputError: ``--import`` is followed by no file.
    """
    rest: list[str] = []
    files: list[Path] = []
    trusted, waiting = False, iter(words)
    for word in waiting:
        if word == "--trust-code":
            trusted = True
        elif word == "--import" or word.startswith("--import="):
            name = word.partition("=")[2] or next(waiting, "")
            if not name:
                raise InputError(
                    "--import: found no file, expected Python code that registers an architecture"
                )
            files.append(Path(name))
        else:
            rest.append(word)
        # What follows are no options.
        if word == "--":
            return [*rest, *waiting], files, trusted
    return rest, files, trusted


@contextmanager
def running(files: Sequence[Path], *, trusted: bool) -> Iterator[None]:
    """Run the named files, and let a user at a terminal answer for those that a pool names.

    What child processes must know is in the environment, and taken back after.
    """
    before = {name: os.environ.get(name) for name in (code.TRUST, code.IMPORT)}
    # A script has nobody to answer: what is not trusted is refused there.
    code.ask_with(_ask if sys.stdin.isatty() and sys.stderr.isatty() else None)
    try:
        if trusted:
            code.trust_all()
        # Processes that are started from here run the same files.
        os.environ[code.IMPORT] = os.pathsep.join(str(path.absolute()) for path in files)
        for path in files:
            from sfkit.architectures.registry import run

            run(path, trusted=True)
        yield
    finally:
        code.ask_with(None)
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _ask(path: Path) -> bool:
    return typer.confirm(
        f"{path} is code that this pool wants to run. Have you read it, and trust it?", err=True
    )
