"""Where and how forward passes run: one record for evaluators, experiments, commands and notebooks."""

from __future__ import annotations

import importlib.util
import os
import sys
from dataclasses import dataclass, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sfkit.errors import InputError, ensure_known
from sfkit.merging.forward import ForwardMode
from sfkit.settings import setting

if TYPE_CHECKING:
    from sfkit.merging.live import LiveModel
    from sfkit.merging.pool import Pool
    from sfkit.merging.recipe import Recipe

ENGINES = ("auto", "inline", "processes", "ray")


@dataclass(frozen=True)
class Compute:
    """Where and how networks run.

    Attributes:
        device: ``"cpu"`` or ``"cuda:0"``; its type is part of an evaluation's key, its number is not.
            ``"cuda"`` is every GPU to an engine with several workers.
        engine: ``"inline"``, ``"processes"``, ``"ray"`` or ``"auto"``. Scores are the same to the last bit
            while each worker has the same number of threads; on the CPU another number changes disparities
            by some 1e-6 of their size.
        workers: how many evaluate at a time; one a device unless given.
        precision: ``"float32"``, or ``"bfloat16"`` for autocast; part of the key.
        channels_last: whether images enter with their channels innermost; part of the key.

    Raises:
        InputError: an unknown device, engine or precision, a number of workers the engine cannot have, or an
            engine whose library is not installed. Whether the device is there shows when a network is made.
    """

    device: str = setting("cpu", help="cpu, cuda, cuda:N or mps.")
    engine: str = setting("inline", help="Where networks run: auto, inline, processes or ray.")
    workers: int | None = setting(None, help="How many run at a time; one a device unless given.")
    precision: str = setting("float32", help="float32, or bfloat16, whose scores are kept apart.")
    channels_last: bool = setting(
        False, "--channels-last", help="Images enter with their channels innermost."
    )

    def __post_init__(self) -> None:
        # Refuses an unknown precision.
        ForwardMode(self.precision, self.channels_last)
        check_device_name(self.device)
        ensure_known("engine", self.engine, ENGINES)
        if self.workers is not None and self.workers < 1:
            raise InputError(f"workers: found {self.workers}, expected at least 1")
        if self.engine == "inline" and self.workers not in (None, 1):
            raise InputError(
                f"workers: found {self.workers}, engine 'inline' has one: choose 'processes' or 'ray'"
            )
        if self.engine == "ray":
            ensure_ray()

    @property
    def kind(self) -> str:
        """The device's type, ``"cpu"``, ``"cuda"`` or ``"mps"``."""
        return self.device.partition(":")[0]

    @property
    def mode(self) -> ForwardMode:
        """Precision and memory layout of forward passes."""
        return ForwardMode(self.precision, self.channels_last)

    @property
    def passes(self) -> dict[str, Any]:
        """What :func:`sfkit.load` takes of this, for one network that no engine runs."""
        return {name: getattr(self, name) for name in PASSES}

    def model(self, pool: Pool, recipe: Recipe | None = None) -> LiveModel:
        """A network of this process under a recipe, the pool's base unless given; no engine takes part.

        Raises:
            InputError: the device is not there, or a file of the pool has changed.
        """
        from sfkit.merging.live import LiveModel

        check_device(self.device)
        pool.ensure_unchanged()
        return LiveModel(pool, recipe, device=self.device, mode=self.mode)


REACH_SECONDS = 10.0  # how long a cluster may take to answer


def check_device_name(name: str, argument: str = "device") -> None:
    """Refuse what cannot be a device's name.

    Raises:
        InputError: naming the argument, what was found and what was expected.
    """
    kind, colon, number = name.partition(":")
    if kind not in ("cpu", "cuda", "mps") or (colon and not (kind == "cuda" and number.isdecimal())):
        raise InputError(f"{argument}: found {name!r}, expected cpu, cuda, cuda:N or mps")


def check_device(name: str, argument: str = "device") -> None:
    """Refuse a device that this machine does not have.

    Raises:
        InputError: as :func:`check_device_name`, or it is not there.
    """
    check_device_name(name, argument)
    kind, _, number = name.partition(":")
    if kind == "cpu":
        return
    if kind == "cuda" and int(number or 0) >= (count := _cuda_devices()):
        raise InputError(f"{argument}: {name} is not there, found {count} CUDA devices; use cpu")
    if kind == "mps" and not _has_metal():
        raise InputError(
            f"{argument}: mps is not there, expected a Mac with Metal and a PyTorch for it; use cpu"
        )


def _cuda_devices() -> int:
    """How many there are; where no driver is installed, torch need not be imported to tell."""
    rocm = Path("/dev/kfd")  # which its devices are reached through
    if sys.platform == "linux" and "torch" not in sys.modules and not rocm.exists():
        try:
            import ctypes

            ctypes.CDLL("libcuda.so.1")
        except OSError:
            return 0
    import torch

    return torch.cuda.device_count()


def _has_metal() -> bool:
    if sys.platform != "darwin" and "torch" not in sys.modules:
        return False
    import torch

    return torch.backends.mps.is_available()


def ensure_ray() -> None:
    """Refuse where Ray, or the cluster that RAY_ADDRESS names, is missing.

    Raises:
        InputError: it is not installed, or its cluster does not answer.
    """
    # Found without being imported, which would take long.
    if importlib.util.find_spec("ray") is None:
        raise InputError(
            "engine 'ray': Ray is not installed, install it with pip install 'sfkit[ray]', or choose "
            "'processes'"
        )
    address = os.environ.get("RAY_ADDRESS", "")
    host, colon, port = address.removeprefix("ray://").rpartition(":")
    if colon and port.isdecimal():
        import socket

        try:
            socket.create_connection((host.strip("[]"), int(port)), REACH_SECONDS).close()
        except (OSError, OverflowError) as error:
            raise InputError(
                f"engine 'ray': nobody answers at RAY_ADDRESS {address} ({error}), start it or unset this"
            ) from error


HERE = Compute()
"""One process on the CPU."""
FIELDS = tuple(field.name for field in fields(Compute))
PASSES = ("device", "precision", "channels_last")
"""The fields that matter to a network that no engine runs."""
PARAMETERS = ("device", "engine", "workers", "precision")
"""The fields that every notebook has as parameters."""
