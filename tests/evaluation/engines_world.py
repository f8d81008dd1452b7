"""A network with traps: forward passes that kill, block or raise, set from outside by files in a folder.

Its level is 1, 2, 4, ... in the sources a, b, c, ..., so that a trap for one level meets one candidate.
"""

from __future__ import annotations

import os
import signal
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from safetensors.torch import save_file
from torch import nn

from sfkit.architectures import register_architecture
from sfkit.checkpoints.spec import Member, PoolSpec
from sfkit.datasets.benchmark import Benchmark, memory_benchmark
from sfkit.datasets.pairs import Sample
from sfkit.evaluation import Evaluator
from sfkit.merging import Pool, Recipe, open_pool

SIZE = (48, 96)


@register_architecture("trapped", blocks={"level": ["level"]}, version="1")
class Trapped(nn.Module):
    """Disparity = level + a tenth of the left image, in pixels, unless a trap for that level is set."""

    def __init__(self, *, traps: str = "") -> None:
        super().__init__()
        self.traps = Path(traps)
        self.level = nn.Parameter(torch.zeros(1))

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        level = f"{self.level.item():g}"
        if (self.traps / f"kill-{level}").exists():
            os.kill(os.getpid(), signal.SIGKILL)
        if (self.traps / f"exit-{level}").exists():
            os._exit(7)
        if (self.traps / f"raise-{level}").exists():
            raise RuntimeError(f"level {level} is not to be")
        wait_once(self.traps / f"wait-{level}")
        return self.level + left.mean(1) / 10


def wait_once(trap: Path) -> None:
    """Tell the pipe ``trap`` this process's number and wait to be killed; the next to come passes."""
    if not trap.exists():
        return
    taken = trap.with_suffix(".taken")
    trap.rename(taken)
    with taken.open("w") as pipe:  # blocks until someone reads
        pipe.write(str(os.getpid()))
    signal.pause()


def set_wait(traps: Path, level: str) -> Path:
    """Set the trap in which one worker waits to be killed; returns the pipe that tells its number."""
    trap = traps / f"wait-{level}"
    os.mkfifo(trap)
    os.link(trap, trap.with_suffix(".pipe"))  # the same pipe, whichever of its names is there
    return trap.with_suffix(".pipe")


def trapped_spec(folder: Path, sources: int = 4) -> PoolSpec:
    """A pool of trapped networks whose traps are files in ``folder / "traps"``."""
    (folder / "traps").mkdir(parents=True)
    names = [chr(ord("a") + n) for n in range(sources)]
    for number, name in enumerate(["base", *names]):
        level = 0.0 if name == "base" else 2.0 ** (number - 1)
        save_file({"level": torch.tensor([level])}, folder / f"{name}.safetensors")
    base, *members = (Member(name, folder / f"{name}.safetensors") for name in ("base", *names))
    return PoolSpec("trapped", "trapped", base, tuple(members), {"traps": str(folder / "traps")})


def trapped_pool(folder: Path, sources: int = 4) -> Pool:
    return open_pool(trapped_spec(folder, sources))


def alone(pool: Pool) -> list[Recipe]:
    """Each source by itself, and all of them merged."""
    return [*(pool.equal(name) for name in pool.names), pool.uniform()]


def noise(pairs: int = 3) -> Benchmark:
    """Pairs of noise in memory, with a true disparity of 3 px."""
    rng = np.random.default_rng(5)
    truth = np.full(SIZE, 3.0, np.float32)
    images = rng.integers(0, 256, (pairs, 2, *SIZE, 3), dtype=np.uint8)
    samples = [Sample(f"pair{n}", left, right, truth) for n, (left, right) in enumerate(images)]
    return memory_benchmark("noise", samples)


def heard(evaluator: Evaluator, recipes: Sequence[Recipe]) -> list[dict[str, Any]]:
    """What an evaluator says of recipes, without what the clock decides; every sum to its last bit."""
    return [
        {"key": e.key, "images": [image.to_dict() for image in e.images], "failure": e.failure}
        for e in evaluator.evaluate(recipes)
    ]
