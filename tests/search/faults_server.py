"""A process that has sfkit imported and forks searches, so that a search that will be killed starts at once.

Run in a folder; reads one JSON request a line and answers each with one JSON line:

    {"warm": [...]}                     runs ``sfkit WORDS`` here: forks find all modules loaded; answers {}
    {"words": [...], "name": "x", ...}  forks ``sfkit WORDS``; answers {"pid": ...}
    {"wait": pid}                       answers {"code": exit code, or minus the signal that ended it}

What a fork prints goes to ``NAME.out`` and ``NAME.err``. A request can hold ``file_limit``, the largest file
in bytes the fork may write, ``clock``, offsets in seconds that its wall clock takes on in turn, and
``environment``, variables to set.
"""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import os
import resource
import sys
import time
from collections.abc import Mapping, Sequence
from datetime import datetime, tzinfo
from pathlib import Path

import faults_network  # noqa: F401 (registers the architecture)
import torch

from sfkit.cli import main
from sfkit.search import journal


def serve() -> None:
    """Answer requests until standard input ends."""
    for line in sys.stdin:
        request = json.loads(line)
        answer = {}
        if "warm" in request:
            with contextlib.redirect_stdout(io.StringIO()), contextlib.suppress(SystemExit):
                main(request["warm"])
        elif "wait" in request:
            answer["code"] = os.waitstatus_to_exitcode(os.waitpid(request["wait"], 0)[1])
        else:
            answer["pid"] = forked(**request)
        print(json.dumps(answer), flush=True)


def forked(
    words: Sequence[str],
    name: str,
    *,
    file_limit: int | None = None,
    clock: Sequence[float] = (),
    environment: Mapping[str, str] | None = None,
) -> int:
    """Run the command line in a child; returns its process number."""
    child = os.fork()
    if child:
        return child
    code = 1
    try:
        for stream, ending in ((sys.stdout, "out"), (sys.stderr, "err")):
            with Path(f"{name}.{ending}").open("w", encoding="utf-8") as file:
                os.dup2(file.fileno(), stream.fileno())
        if file_limit is not None:  # Python ignores the signal: writing fails, as on a full disk
            resource.setrlimit(resource.RLIMIT_FSIZE, (file_limit, file_limit))
        os.environ.update(environment or {})
        if clock:
            turn_clock(clock)
        main(list(words))
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else 1
    finally:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)


def turn_clock(offsets: Sequence[float]) -> None:
    """From now on every look at the wall clock sees it moved by the next of these offsets, in a circle."""
    turns, true = itertools.cycle(offsets), time.time

    class Turned(datetime):
        @classmethod
        def now(cls, tz: tzinfo | None = None) -> datetime:
            return datetime.fromtimestamp(time.time(), tz)

    time.time = lambda: true() + next(turns)
    journal.datetime = Turned


if __name__ == "__main__":
    torch.set_num_threads(1)
    serve()
