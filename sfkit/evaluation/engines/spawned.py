"""The outside of a spawned worker process: a fresh interpreter that never imports ``__main__``.

``multiprocessing``'s own spawning imports the parent's main script again in every child, which a
notebook does not have and a script without a guard does not survive. Workers need nothing from there.
"""

from __future__ import annotations

import contextlib
import json
import os
import pickle
import signal
import subprocess
import sys
from collections.abc import Iterable
from multiprocessing.connection import Connection, Pipe
from pathlib import Path
from typing import Any

from sfkit.files import PACKAGE

# Ctrl-C reaches every process of a terminal: the parent alone decides what becomes of its workers.
_BOOT = (
    "import json, signal, sys; signal.signal(signal.SIGINT, signal.SIG_IGN); "
    "first, *rest = json.loads(sys.stdin.readline()); "
    "at = [n for n, p in enumerate(sys.path) if p.endswith('-packages')]; "
    "sys.path.insert(at[0] if at else len(sys.path), first); "
    "sys.path += [p for p in rest if p not in sys.path]; "
    "from sfkit.evaluation.engines.child import main; main(int(sys.argv[1]))"
)
ISOLATED = "-P"
"""For Python: the working folder is no place to import from, where a ``json.py`` would be run."""
SAFE_PATH = {"PYTHONSAFEPATH": "1"}
"""The same for Pythons that are started by others."""
STDERR = 2
PATIENCE = 10.0  # seconds that a process may take to end once it has been told to


class Spawned:
    """One worker process.

    Args:
        threads: of every library that computes in it.
        folder: its working directory.

    Attributes:
        channel: messages to and from it.
        pid: its process number.
        owner: the process that started it.
    """

    def __init__(self, threads: int, folder: Path) -> None:
        self.channel: Connection[Any, Any]
        self.channel, theirs = Pipe()
        reading, self._lifeline = os.pipe()
        try:
            self._process = subprocess.Popen(
                [sys.executable, ISOLATED, "-c", _BOOT, str(theirs.fileno())],
                stdin=reading,
                stdout=STDERR,  # what a network prints must not run into what a command prints
                pass_fds=[theirs.fileno()],
                cwd=folder,
                # In its environment: libraries read this once, when they are imported.
                env={**os.environ, "OMP_NUM_THREADS": str(threads)},
            )
        finally:
            theirs.close()
            os.close(reading)
        self.pid, self.owner = self._process.pid, os.getpid()
        # sfkit itself is the parent's; what else the parent can import comes after what Python brings.
        path = [str(PACKAGE.parent), *(str(Path(entry).absolute()) for entry in sys.path)]
        with contextlib.suppress(ConnectionError):  # it has ended already: that shows on the channel
            os.write(self._lifeline, json.dumps(path).encode() + b"\n")

    @property
    def running(self) -> bool:
        """False once the process has ended."""
        return self._process.poll() is None

    def send(self, message: object) -> None:
        """Send a message; one to a process that is gone is lost, its end shows on the channel."""
        self.send_pickled(pickle.dumps(message))

    def send_pickled(self, message: bytes) -> None:
        """The same for a message that was made ready before."""
        with contextlib.suppress(ConnectionError):
            self.channel.send_bytes(message)

    def ended(self) -> str:
        """Wait for the end and say what it was, as the last part of a sentence."""
        try:
            code = self._process.wait(PATIENCE)
        except subprocess.TimeoutExpired:
            self.kill()
            return "stopped answering"
        # A signal comes as a negative code.
        if code < 0:
            return f"was killed by signal {-code} ({signal.strsignal(-code)})"
        return f"exited with code {code}"

    def terminate(self) -> None:
        """Ask the process to end."""
        self._process.terminate()

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.wait()

    def release(self) -> None:
        """Let go of the pipes."""
        self.channel.close()
        os.close(self._lifeline)


def stop(processes: Iterable[Spawned]) -> None:
    """End processes, whatever they are at: they keep nothing that could be lost."""
    here = [process for process in processes if process.owner == os.getpid()]  # a fork owns none of them
    for process in here:
        # All are told before any is waited for: they end at the same time.
        process.release()
        process.terminate()
    for process in here:
        process.ended()
