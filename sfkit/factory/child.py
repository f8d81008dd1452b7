"""Trains one network of a factory in a process of its own, which ends with the one that started it."""

from __future__ import annotations

import os
import sys
import threading

from sfkit.errors import SfkitError
from sfkit.factory.file import read_factory
from sfkit.factory.training import train_one


def _end_with_parent() -> None:
    """The parent holds the other end of standard input, and never writes: it ends when the parent does."""
    os.read(sys.stdin.fileno(), 1)
    os._exit(1)


def main() -> int:
    """Train ``FILE NAME DEVICE`` from the command line."""
    file, name, device = sys.argv[1:]
    threading.Thread(target=_end_with_parent, daemon=True).start()
    try:
        # The parent passes each line on as it comes.
        train_one(read_factory(file), name, device, lambda line: print(line, flush=True))
    except SfkitError as error:
        print(error, flush=True)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
