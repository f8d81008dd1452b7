"""The inside of a spawned worker process: it follows its parent, opens the plan and evaluates parts.

The parent holds the other end of standard input and writes only its import path to it: when that ends,
however it ends, the parent is gone and so is this process.
"""

from __future__ import annotations

import contextlib
import os
import select
import threading
from dataclasses import dataclass
from multiprocessing.connection import Connection

from sfkit.errors import SfkitError

STDIN = 0
LOOK_SECONDS = 10.0  # a process forked off the parent can hold standard input open for longer than it lives


@dataclass(frozen=True)
class Here:
    """The first message: imports are done, the plan can come."""


@dataclass(frozen=True)
class Ready:
    """The plan is open, parts can come."""


@dataclass(frozen=True)
class Refused:
    """The plan cannot be opened, here or in any other worker."""

    why: str


def main(descriptor: int) -> None:
    """Live as a worker whose messages pass through the socket with this descriptor."""
    threading.Thread(target=_follow, args=(os.getppid(),), daemon=True).start()
    channel: Connection = Connection(descriptor)
    with contextlib.suppress(EOFError, ConnectionError):  # the parent has closed, or is gone
        _work(channel)


def _work(channel: Connection) -> None:
    channel.send(Here())
    try:
        plan, device = channel.recv()
    except (AttributeError, ImportError) as error:  # a class that only the parent can import
        return channel.send(Refused(f"a worker cannot read what it was sent ({error}), use engine='inline'"))
    try:
        worker = plan.open(device)
    except SfkitError as error:
        return channel.send(Refused(str(error)))
    channel.send(Ready())
    while True:
        recipe, start, stop = channel.recv()
        channel.send(worker.part(recipe, start, stop))


def _follow(parent: int) -> None:
    while os.getppid() == parent:
        readable, _, _ = select.select([STDIN], [], [], LOOK_SECONDS)
        if readable and not os.read(STDIN, 1):
            break
    os._exit(0)
