"""Commands in processes of their own, the memory they take, and the command line of what prints rows."""

from __future__ import annotations

import argparse
import inspect
import json
import multiprocessing
import os
import shutil
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal, TypeVar, get_args, get_origin

import pandas as pd
import torch

from sfkit.evaluation.estimating import peak_memory

T = TypeVar("T")

HERE = Path(__file__).parent
RESULTS = HERE.parent / "runs" / "results"
"""Where sections keep what took them long."""
INTERVAL = 0.005  # seconds between two looks at a process's memory
FAMILY_INTERVAL = 0.1  # and at that of all its descendants, which are looked for each time


def answered(
    measure: Callable[..., Any],
    text: Callable[[Any], str] | None = None,
    arguments: Sequence[str] | None = None,
) -> None:
    """Measure what the command line asks for and print it as text, or JSON.

    Args:
        measure: its parameters are the options. What is a ``Literal`` or has no default comes bare; a tuple
            takes several values, and False is a switch.
        text: of what was measured; its rows as a table unless given.
        arguments: of the command line; the process's own unless given.
    """
    parser = argparse.ArgumentParser(
        description=sys.modules[measure.__module__].__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    for name, one in inspect.signature(measure, eval_str=True).parameters.items():
        usual, (kind, *_) = one.default, [*get_args(one.annotation), one.annotation]
        words = f"{usual} unless given"
        if get_origin(one.annotation) is Literal:
            free = {} if usual is one.empty else {"nargs": "?", "default": usual, "help": words}
            parser.add_argument(name, choices=get_args(one.annotation), **free)
        elif usual is one.empty:
            parser.add_argument(name, type=kind)
        elif usual is False:
            parser.add_argument(f"--{name}", action="store_true")
        else:
            several = {"nargs": "+"} if isinstance(usual, tuple) else {}
            parser.add_argument(f"--{name}", type=kind, default=usual, help=words, **several)
    parser.add_argument("--json", action="store_true", help="print JSON")
    given = vars(parser.parse_args(arguments))
    as_json = given.pop("json")
    found = measure(**given)
    print(json.dumps(found, indent=2, default=asdict) if as_json else (text or readable)(found))


def readable(found: Any) -> str:
    """Rows as a table, and what a record holds by name."""
    if not isinstance(found, Mapping):
        return pd.DataFrame(found).to_string(index=False, float_format="{:.4g}".format)
    parts = (
        f"{name}:\n{readable(v)}" if isinstance(v, list) else f"{name}: {v}" for name, v in found.items()
    )
    return "\n".join(parts)


def sfkit(*words: str) -> str:
    """Run ``sfkit WORDS`` as a user does and return its standard output; progress comes as it is made."""
    return _output([sys.executable, "-m", "sfkit", *words])


def shown(script: str, *arguments: str) -> str:
    """The command as one types it at the top of the checkout."""
    return " ".join(("python", f"benchmarks/{script}", *arguments))


def call(script: str, *arguments: str) -> Any:
    """The JSON document that ``python benchmarks/SCRIPT ARGUMENTS`` prints."""
    return json.loads(_output([sys.executable, str(HERE / script), *arguments]))


def _output(command: list[str]) -> str:
    return subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True).stdout


def apart(function: Callable[..., T], *arguments: Any, **named: Any) -> T:
    """Call a function of a module in a new process, which nothing before has warmed up or filled."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as process:
        return process.submit(function, *arguments, **named).result()


def peak_mb() -> float:
    """The most memory this process has held, in MiB."""
    return peak_memory() / (1 << 20)


@dataclass(frozen=True)
class Peak:
    """The most memory a process held, in MiB.

    Attributes:
        anonymous_mb: pages that exist in memory alone, which only swap could relieve.
        mapped_mb: pages of files, which the operating system drops and reads again as it likes.
    """

    anonymous_mb: float
    mapped_mb: float


def call_watched(script: str, *arguments: str) -> tuple[Any, Peak]:
    """As :func:`call`, and the process's peak memory, looked at every ``INTERVAL`` seconds.

    Raises:
        SystemExit: this is not Linux, the only system that tells anonymous from mapped pages.
        subprocess.CalledProcessError: the command failed.
    """
    anonymous, mapped = [0.0], [0.0]

    def look(pid: int) -> None:
        sizes = _sizes(pid)
        anonymous.append(sizes.get("RssAnon", 0.0))
        mapped.append(sizes.get("RssFile", 0.0) + sizes.get("RssShmem", 0.0))

    output = _watched([sys.executable, str(HERE / script), *arguments], look, INTERVAL)
    return json.loads(output), Peak(round(max(anonymous)), round(max(mapped)))


@dataclass(frozen=True)
class Whole:
    """What a command took with all processes it began.

    Attributes:
        seconds: on the clock, from its start to its end.
        resident_mb: the most memory that its processes held together, in MiB. Pages that two of them share
            are counted in both.
        processes: the most there were at once.
    """

    seconds: float
    resident_mb: float
    processes: int


def watched(*command: str) -> tuple[str, Whole]:
    """A command's standard output, and what it took with its children, looked for each ``FAMILY_INTERVAL``.

    Raises:
        SystemExit: this is not Linux, from whose /proc memory and children are read.
        subprocess.CalledProcessError: the command failed.
    """
    resident, count = [0.0], [0]

    def look(pid: int) -> None:
        held = [size for one in _family(pid) if (size := _sizes(one).get("VmRSS"))]
        resident.append(sum(held))
        count.append(len(held))

    began = time.perf_counter()
    output = _watched(list(command), look, FAMILY_INTERVAL)
    return output, Whole(time.perf_counter() - began, max(resident), max(count))


def _watched(command: list[str], look: Callable[[int], None], interval: float) -> str:
    """The standard output of a command at whose process ``look`` is called every ``interval`` seconds."""
    if not Path("/proc/self/status").is_file():
        raise SystemExit("memory by kind is read from /proc, which this system does not have: use Linux")
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        ended = threading.Event()

        def watch() -> None:
            while not ended.wait(interval):
                look(process.pid)

        watcher = threading.Thread(target=watch)
        watcher.start()
        try:
            output = process.communicate()[0]
        finally:
            ended.set()
            watcher.join()
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return output


def _sizes(pid: int) -> dict[str, float]:
    """What Linux says of a process's resident memory, in MiB by name; nothing where it has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines()
    except (FileNotFoundError, ProcessLookupError):
        return {}
    fields = (line.split() for line in lines if line.startswith(("Rss", "VmRSS")))
    return {name.rstrip(":"): float(size) / 1024 for name, size, *_ in fields}


def _family(pid: int) -> list[int]:
    """A process and all that descend from it; those that have ended are left out."""
    found = [pid]
    for one in found:
        try:
            for thread in Path(f"/proc/{one}/task").iterdir():
                found += map(int, (thread / "children").read_text(encoding="utf-8").split())
        except (FileNotFoundError, ProcessLookupError):
            continue
    return found


def folder_of(variable: str) -> Path:
    """The folder that a variable of the environment names.

    Raises:
        SystemExit: it is not set.
    """
    if not os.environ.get(variable):
        raise SystemExit(f"{variable}: not set, expected the folder's path")
    return Path(os.environ[variable]).expanduser()


def chromium() -> str:
    """The distribution's Chromium.

    Raises:
        SystemExit: there is none.
    """
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        raise SystemExit("no Chromium found: install the distribution's, such as apt-get install chromium")
    return found


def machine() -> dict[str, Any]:
    """Size of this machine, and the version of what does the arithmetic; nothing that names it."""
    memory = os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return {
        "cores": os.cpu_count(),
        "memory_gb": round(memory / 2**30),
        "load": os.getloadavg()[2],
        "threads": torch.get_num_threads(),
        "torch": torch.__version__,
    }
