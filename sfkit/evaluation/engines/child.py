"""The inside of a spawned worker process: it follows its parent, opens a plan and evaluates parts, then
waits a while for the next plan: its imports cost more than most plans do.

The parent holds the other end of standard input and writes only its import path to it: when that ends,
however it ends, the parent is gone and so is this process.
"""

from __future__ import annotations

import contextlib
import gc
import os
import select
import threading
from dataclasses import dataclass
from multiprocessing.connection import Connection

from sfkit.errors import SfkitError

STDIN = 0
IDLE_SECONDS = 120.0  # how long a worker waits for its next plan before it ends
LOOK_SECONDS = 10.0  # a process forked off the parent can hold standard input open for longer than it lives


@dataclass(frozen=True)
class Here:
    """The first message, and again after each plan: imports are done, a plan can come."""


@dataclass(frozen=True)
class Done:
    """From the parent: the plan is over, another may follow."""


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
        while _work(channel):
            gc.collect()  # the network and the images of the plan that is over


def _work(channel: Connection) -> bool:
    """Follow one plan to its end; True where another may come."""
    channel.send(Here())
    if not channel.poll(IDLE_SECONDS):
        return False
    try:
        plan, device = channel.recv()
    except (AttributeError, ImportError) as error:  # a class that only the parent can import
        channel.send(Refused(f"a worker cannot read what it was sent ({error}), use engine='inline'"))
        return False
    try:
        worker = plan.open(device)
    except SfkitError as error:
        channel.send(Refused(str(error)))
        return False
    channel.send(Ready())
    while not isinstance(message := channel.recv(), Done):
        channel.send(worker.part(*message))
    return True


def _follow(parent: int) -> None:
    while os.getppid() == parent:
        readable, _, _ = select.select([STDIN], [], [], LOOK_SECONDS)
        # The end of the pipe that the parent holds open: it is gone.
        if readable and not os.read(STDIN, 1):
            break
    # sys.exit would end this thread alone.
    os._exit(0)
