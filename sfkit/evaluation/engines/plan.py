"""What a worker elsewhere needs to become one: where pool and benchmark come from, and how to compute."""

from __future__ import annotations

import importlib
import importlib.util
import sys
import warnings
from collections.abc import Iterable
from dataclasses import dataclass
from importlib.metadata import version
from typing import Any

import torch

from sfkit.architectures.code import Code
from sfkit.architectures.registry import named, run_text
from sfkit.checkpoints.spec import PoolSpec
from sfkit.datasets.benchmark_record import Benchmark
from sfkit.errors import InputError, SfkitWarning
from sfkit.evaluation.engines.worker import Worker
from sfkit.evaluation.metrics import Quantities
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging.dtypes import written_as
from sfkit.merging.forward import ForwardMode
from sfkit.merging.live import LiveModel
from sfkit.merging.opening import open_pool
from sfkit.merging.pool import Pool
from sfkit.merging.prepare import prepare
from sfkit.merging.steps import FisherMean, Step

_NOT_IMPORTABLE = (None, "__main__", "__mp_main__")
_ADAPTERS = "sfkit.architectures.adapters."

SYSTEM = sys.platform


@dataclass(frozen=True)
class Numerics:
    """The process-wide settings of torch that change what it computes."""

    matmul: str
    deterministic: bool
    cudnn_tf32: bool
    cudnn_benchmark: bool
    cudnn_deterministic: bool

    @classmethod
    def here(cls) -> Numerics:
        """The settings of this process."""
        own = torch.get_float32_matmul_precision(), torch.are_deterministic_algorithms_enabled()
        cudnn = torch.backends.cudnn
        return cls(*own, cudnn.allow_tf32, cudnn.benchmark, cudnn.deterministic)

    def apply(self) -> None:
        """Make them this process's settings."""
        torch.set_float32_matmul_precision(self.matmul)
        torch.use_deterministic_algorithms(self.deterministic)
        torch.backends.cudnn.allow_tf32 = self.cudnn_tf32
        torch.backends.cudnn.benchmark = self.cudnn_benchmark
        torch.backends.cudnn.deterministic = self.cudnn_deterministic


@dataclass(frozen=True)
class WorkerPlan:
    """Everything a worker is made from, but for the device it runs on; plain values that travel.

    Attributes:
        spec: the pool's files; a worker opens them, which cached task vectors make cheap.
        preparation: what is done to the task vectors then.
        dtype: what merged networks are rounded to, see :func:`~sfkit.merging.dtypes.written_as`.
        module: the module whose import registers the architecture.
        code: the user's file that registers it, as it was run here.
        benchmark: its record; pairs in memory travel with it.
        quantities: what is counted of every image.
        mode: how forward passes compute.
        numerics: torch's settings in the process that made the plan.
        threads: of torch in the worker.
        identity: what the worker must find, see :func:`identity`.
    """

    spec: PoolSpec
    preparation: tuple[Step, ...]
    dtype: str | None
    module: str
    code: Code | None
    benchmark: Benchmark
    quantities: Quantities
    mode: ForwardMode
    numerics: Numerics
    threads: int
    identity: dict[str, Any]

    @classmethod
    def of(
        cls,
        pool: Pool,
        benchmark: Benchmark,
        quantities: Quantities,
        *,
        mode: ForwardMode,
        threads: int,
    ) -> WorkerPlan:
        """The plan for workers that do what a worker of this process would do.

        Raises:
            InputError: a worker could not import the architecture, a class of the benchmark's pairs, or a
                metric.
        """
        module = module_of(pool)
        ensure_importable({type(pair).__module__ for pair in benchmark.pairs}, "a pair's class")
        for metric in quantities.own:
            ensure_importable([getattr(metric.recorder, "__module__", None)], f"metric {metric.name!r}")
        # Files and names, no tensors: a worker opens the pool itself, and no gigabytes go through a pipe.
        made = (pool.spec, pool.preparation, pool.dtype, module, pool.architecture.code)
        how = (mode, Numerics.here(), threads)
        return cls(*made, benchmark, quantities, *how, identity(pool, benchmark))

    def open(self, device: str, pool: Pool | None = None) -> Worker:
        """Become a worker in this process: open pool and benchmark, check them, build the network.

        Args:
            device: where the network runs.
            pool: the pool, where it is here already.

        Raises:
            InputError: the architecture is not registered by its module, files cannot be read, or what
                was found is not what the plan was made from.
        """
        torch.set_num_threads(self.threads)
        self.numerics.apply()
        self.register()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", SfkitWarning)  # the process that made the plan has warned
            opened = pool or written_as(prepare(open_pool(self.spec), *self.preparation), self.dtype)
        # Files may have changed since, or be others on another machine.
        self._check(identity(opened, self.benchmark))
        inputs = opened.architecture.inputs(opened.options)
        prepared = PreparedBenchmark(self.benchmark, inputs, self.quantities)
        return Worker(LiveModel(opened, device=device, mode=self.mode), prepared)

    @property
    def leaves_no_trace(self) -> bool:
        """Whether a process that followed it holds no code but sfkit's, and can follow any other plan."""
        modules = {self.module, *(type(pair).__module__ for pair in self.benchmark.pairs)}
        ours = all(module.partition(".")[0] == "sfkit" for module in modules)
        ours = ours and not self.module.startswith(_ADAPTERS)  # what they build is others' code
        return ours and self.code is None and not self.quantities.own

    def register(self) -> None:
        """Import, or run, what registers the architecture.

        Raises:
            InputError: it cannot be imported.
        """
        if self.code is not None:
            return run_text(self.code)
        try:
            importlib.import_module(self.module)
        except ImportError as error:
            raise InputError(
                f"architecture {self.spec.architecture!r}: a worker cannot import {self.module}, which "
                f"registers it ({error}), put that module where Python finds it or use engine='inline'"
            ) from error

    def _check(self, found: dict[str, Any]) -> None:
        for what, expected in self.identity.items():
            if found[what] != expected:
                raise InputError(
                    f"{what}: a worker found {found[what]}, expected {expected} as here: open pool and "
                    "benchmark again (files have changed, or another sfkit is installed where it runs)"
                )


def identity(pool: Pool, benchmark: Benchmark) -> dict[str, Any]:
    """What decides scores, in content: equal in two processes that may work for each other."""
    return {
        "sfkit": version("sfkit"),
        "architecture": pool.describe(),
        "partition": pool.partition.fingerprint(),
        "base": pool.base.fingerprint,
        "sources": pool.identity,
        "benchmark": benchmark.fingerprint(),
    }


def module_of(pool: Pool) -> str:
    """The module whose import registers a pool's architecture.

    Raises:
        InputError: it was registered where no other process can import it from.
    """
    if pool.architecture.code is not None:
        return "sfkit"
    module = getattr(named(pool.architecture.build), "__module__", None)
    ensure_importable([module], f"architecture {pool.architecture.name!r}")
    return str(module)


def ensure_processes() -> None:
    """Refuse a system whose processes do not inherit pipes by number, as worker processes talk.

    Raises:
        InputError: it is Windows.
    """
    if SYSTEM == "win32":
        raise InputError("engine 'processes': does not run on Windows yet, use engine='inline' or 'ray'")


def ensure_rebuildable(pool: Pool) -> None:
    """Refuse a pool whose task vectors a worker could not prepare from its files.

    Raises:
        InputError: they were weighted by information that came from images.
    """
    if any(isinstance(step, FisherMean) for step in pool.preparation):
        raise InputError(
            f"pool {pool.name!r}: its task vectors were weighted by Fisher information, which workers cannot "
            "rebuild from its files, use engine='inline' or 'ray'"
        )


def ensure_importable(modules: Iterable[str | None], what: str) -> None:
    """Refuse what is defined in a notebook cell or in the script that runs.

    Raises:
        InputError: a module is one that other processes cannot import.
    """
    for module in modules:
        if module in _NOT_IMPORTABLE or importlib.util.find_spec(str(module)) is None:
            raise InputError(
                f"{what}: found it defined in a notebook cell or the running script, expected a module that "
                "workers can import; move it to a .py file and import that, or use engine='inline'"
            )


def fair_threads(workers: int) -> int:
    """Threads for each of ``workers`` on the CPU: this process's threads, shared out, at least one."""
    return max(1, torch.get_num_threads() // workers)
