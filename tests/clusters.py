"""A Ray cluster of two nodes on this machine, and proof that its processes end."""

from __future__ import annotations

import os
import time
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

NODE = {
    "num_cpus": 1,
    "object_store_memory": 80 << 20,
    "node_ip_address": "127.0.0.1",
    "include_log_monitor": False,
}
HEAD = {**NODE, "include_dashboard": False, "no_monitor": True}

ENVIRONMENT = {
    "RAY_ENABLE_WINDOWS_OR_OSX_CLUSTER": "0",  # keeps 127.0.0.1 for what it is
    "RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO": "0",
    # Processes that nobody asks for: workers before there is work for them, and who would hear of metrics.
    "RAY_enable_worker_prestart": "0",
    "RAY_prestart_worker_first_driver": "0",
    "RAY_enable_metrics_collection": "0",
    # A node or worker that a busy machine keeps waiting is not dead.
    "RAY_health_check_timeout_ms": "120000",
    "RAY_worker_register_timeout_seconds": "600",
    "RAY_agent_register_timeout_ms": "600000",
}
"""What every process that takes part must have set."""

LEAVES_TO_THE_COLLECTOR = (
    pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::FutureWarning"),
    pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning"),
)
"""Marks of tests with a cluster: Ray leaves files and subprocesses to the garbage collector, and announces
coming changes."""

PATIENCE = 300  # seconds

Process = tuple[int, str]
"""A process's number, and when it started: numbers come back."""


@contextmanager
def two_nodes() -> Iterator[Any]:
    """The cluster, one CPU a node; skips where Ray is not installed."""
    with pytest.MonkeyPatch.context() as patch:
        for name, value in ENVIRONMENT.items():
            patch.setenv(name, value)
        pytest.importorskip("ray", reason="Ray is not installed: pip install sfkit[ray]")
        from ray.cluster_utils import Cluster

        before = set(descendants(os.getpid()))
        cluster = Cluster(initialize_head=True, head_node_args=HEAD)
        cluster.add_node(**NODE)
        try:
            yield cluster
        finally:
            started = set(descendants(os.getpid())) - before
            cluster.shutdown()
        assert_all_end(started)


def descendants(pid: int) -> list[Process]:
    """The processes that a process started, and those that they did."""
    children: dict[int, list[Process]] = {}
    for folder in Path("/proc").glob("[0-9]*"):
        fields = _fields(int(folder.name))
        if fields:
            children.setdefault(int(fields[1]), []).append((int(folder.name), fields[19]))
    found, waiting = [], [pid]
    while waiting:
        more = children.get(waiting.pop(), [])
        found += more
        waiting += [child for child, _ in more]
    return found


def assert_all_end(processes: Collection[Process]) -> None:
    """Wait until none of them runs."""
    deadline = time.monotonic() + PATIENCE
    while left := [pid for pid, started in processes if _runs(pid, started)]:
        assert time.monotonic() < deadline, f"{len(left)} processes still run after {PATIENCE} s: {left}"
        time.sleep(0.05)


def _runs(pid: int, started: str) -> bool:
    fields = _fields(pid)
    return bool(fields) and fields[19] == started and fields[0] not in "ZX"


def _fields(pid: int) -> list[str]:
    """A process's state, parent, ... as in proc(5) from the third field on; none where it is gone."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    except (FileNotFoundError, ProcessLookupError):
        return []
