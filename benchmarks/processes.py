"""Commands in processes of their own, and the memory they take."""

from __future__ import annotations

import json
import multiprocessing
import os
import shutil
import subprocess
import sys
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import torch

from sfkit.evaluation.estimating import peak_memory

T = TypeVar("T")

HERE = Path(__file__).parent
INTERVAL = 0.005  # seconds between two looks at a process's memory


@dataclass(frozen=True)
class Peak:
    """The most memory a process held, in MiB.

    Attributes:
        anonymous_mb: pages that exist in memory alone, which only swap could relieve.
        mapped_mb: pages of files, which the operating system drops and reads again as it likes.
    """

    anonymous_mb: float
    mapped_mb: float


def chromium() -> str:
    """The distribution's Chromium.

    Raises:
        SystemExit: there is none.
    """
    found = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if found is None:
        raise SystemExit("no Chromium found: install the distribution's, such as apt-get install chromium")
    return found


def shown(script: str, *arguments: str) -> str:
    """The command as one types it at the top of the checkout."""
    return " ".join(("python", f"benchmarks/{script}", *arguments))


def call(script: str, *arguments: str) -> Any:
    """The JSON document that ``python benchmarks/SCRIPT ARGUMENTS`` prints."""
    command = [sys.executable, str(HERE / script), *arguments]
    finished = subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True)
    return json.loads(finished.stdout)


def apart(function: Callable[..., T], *arguments: Any, **named: Any) -> T:
    """Call a function of a module in a new process, which nothing before has warmed up or filled."""
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context("spawn")) as process:
        return process.submit(function, *arguments, **named).result()


def peak_mb() -> float:
    """The most memory this process has held, in MiB."""
    return peak_memory() / (1 << 20)


def call_watched(script: str, *arguments: str) -> tuple[Any, Peak]:
    """The same, and the process's peak memory, looked at every ``INTERVAL`` seconds.

    Raises:
        SystemExit: this is not Linux, the only system that tells anonymous from mapped pages.
        subprocess.CalledProcessError: the command failed.
    """
    if not Path("/proc/self/status").is_file():
        raise SystemExit("memory by kind is read from /proc, which this system does not have: use Linux")
    command = [sys.executable, str(HERE / script), *arguments]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        ended = threading.Event()
        found: list[Peak] = []
        watcher = threading.Thread(target=lambda: found.append(_watch(process.pid, ended)))
        watcher.start()
        try:
            output = process.communicate()[0]
        finally:
            ended.set()
            watcher.join()
    if process.returncode:
        raise subprocess.CalledProcessError(process.returncode, command)
    return json.loads(output), found[0]


def _watch(pid: int, ended: threading.Event) -> Peak:
    anonymous = mapped = 0.0
    while not ended.wait(INTERVAL):
        sizes = _resident(pid)
        anonymous = max(anonymous, sizes.get("RssAnon", 0.0))
        mapped = max(mapped, sizes.get("RssFile", 0.0) + sizes.get("RssShmem", 0.0))
    return Peak(round(anonymous), round(mapped))


def _resident(pid: int) -> dict[str, float]:
    """Resident memory of a process by kind, MiB; empty once it has ended."""
    try:
        lines = Path(f"/proc/{pid}/status").read_text(encoding="utf-8").splitlines()
    except (FileNotFoundError, ProcessLookupError):
        return {}
    fields = (line.split() for line in lines if line.startswith("Rss"))
    return {name.rstrip(":"): float(size) / 1024 for name, size, *_ in fields}


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
