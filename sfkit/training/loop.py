"""The training loop: network, optimiser and step count are its whole state."""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import torch
import torch.distributed as dist
from torch import nn
from torch.nn.parallel import DistributedDataParallel

from sfkit.architectures import InputConvention
from sfkit.datasets.pairs import Pair
from sfkit.errors import InputError, SfkitError
from sfkit.training.batches import Batches, Tensors, stacked
from sfkit.training.objectives import Objective
from sfkit.training.recipes import Groups
from sfkit.training.settings import Precision, TrainingSettings
from sfkit.training.state import last_state, save_state

START, END = 1 / 25, 1 / 25 / 1e4
"""The first and the last learning rate as shares of the peak."""

BatchNorm = (nn.BatchNorm1d, nn.BatchNorm2d, nn.BatchNorm3d, nn.SyncBatchNorm)


@dataclass(frozen=True)
class Step:
    """One step: number (from 1), loss, gradient norm before clipping, rate of the first group."""

    number: int
    loss: float
    norm: float
    rate: float


@dataclass
class Course:
    """A training on its way: what a listener sees, and what a state file holds beside the weights."""

    steps: int
    done: int = 0
    seconds: float = 0.0
    cpu_seconds: float = 0.0
    curve: list[list[float]] = field(default_factory=list)
    scores: list[list[float]] = field(default_factory=list)
    broken: dict[str, str] = field(default_factory=dict)

    @property
    def last(self) -> Step:
        """The step taken last."""
        number, *rest = self.curve[-1]
        return Step(int(number), *rest)


Listener = Callable[[Course], None]
Score = Callable[[nn.Module], Sequence[float]]


class _Terms(nn.Module):
    """Network and objective as one module, because DDP wraps a forward call."""

    def __init__(self, network: nn.Module, objective: Objective) -> None:
        super().__init__()
        self.network, self.objective = network, objective

    def forward(self, left: torch.Tensor, right: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
        return self.objective.sums(self.network, left, right, truth)


@dataclass(frozen=True)
class TrainingTask:
    """All that a training is made of; ``identity`` names it in its state files.

    ``steady`` says that every pass uses the same parameters, which spares several processes from looking for
    unused ones at each.
    """

    network: nn.Module
    inputs: InputConvention
    objective: Objective
    groups: Groups
    limit: float
    pairs: Sequence[Pair]
    settings: TrainingSettings
    folder: Path
    identity: str
    steady: bool = False
    device: torch.device = field(default_factory=lambda: torch.device("cpu"))


def train(task: TrainingTask, listen: Listener | None = None, score: Score | None = None) -> Course:
    """Run a training to its end, from its last saved state if there is one; the network is trained in place.

    ``listen`` is called after every step, ``score`` at every saved state, both on the first process alone.
    Under torchrun every process calls this with the same task.

    Raises:
        InputError: the state is another training's, or too many pairs cannot be read.
        SfkitError: the loss is no longer finite.
    """
    return _Training(task, listen, score).run()


class _Training:
    def __init__(self, task: TrainingTask, listen: Listener | None, score: Score | None) -> None:
        self.task, self.listen, self.score = task, listen, score
        self.rank, self.world = (dist.get_rank(), dist.get_world_size()) if dist.is_initialized() else (0, 1)
        settings = task.settings
        # Unequal shares would weigh pairs by the process that happens to read them.
        if settings.batch % self.world:
            raise InputError(f"batch is {settings.batch}, expected a multiple of the {self.world} processes")
        self.network = task.network.to(task.device)
        self.optimiser = torch.optim.AdamW(task.groups)
        self.peaks = [group["lr"] for group in task.groups]
        self.course = Course(settings.steps(len(task.pairs)))
        # Before DDP wraps the network and sends its weights to all processes.
        self._resume()
        self.terms: nn.Module = _Terms(self.network, task.objective)
        self.batches = Batches(task.pairs, settings, task.inputs.multiple, rank=self.rank, world=self.world)

    def run(self) -> Course:
        course, settings = self.course, self.task.settings
        self._train_mode()
        wall, cpu = time.perf_counter(), time.process_time()
        for read in self.batches.steps(course.done, course.steps):
            self._count_broken(read.broken)
            loss, norm = self._step(read.examples)
            rate = self.optimiser.param_groups[0]["lr"]
            course.done += 1
            course.curve.append([course.done, loss, norm, rate])
            now, now_cpu = time.perf_counter(), time.process_time()
            course.seconds, wall = course.seconds + now - wall, now
            course.cpu_seconds, cpu = course.cpu_seconds + now_cpu - cpu, now_cpu
            if course.done % settings.save_every == 0 or course.done == course.steps:
                self._score_and_save()
                # Scoring and saving are no time of training.
                wall, cpu = time.perf_counter(), time.process_time()
            if self.listen is not None and self.rank == 0:
                self.listen(course)
        self.network.eval()
        return course

    def _step(self, examples: Sequence[Any]) -> tuple[float, float]:
        task, settings = self.task, self.task.settings
        for group, peak in zip(self.optimiser.param_groups, self.peaks, strict=True):
            group["lr"] = one_cycle(self.course.done, self.course.steps, peak, settings.warm_up)
        size = settings.micro_batch or len(examples)
        parts = stacked(examples, task.inputs, task.limit, size, task.device)
        # Counted before any pass: each part's sum is then divided by what the whole step has, on all
        # processes.
        counts = torch.stack([task.objective.counts(part.truth) for part in parts]).sum(dim=0)
        if self.world > 1:
            dist.all_reduce(counts)
        if self.world > 1 and not isinstance(self.terms, DistributedDataParallel):
            # What a network decides in its forward pass, it may decide otherwise later.
            unused = not task.steady or self._has_unused(parts[0], counts)
            self.terms = DistributedDataParallel(self.terms, find_unused_parameters=unused)
        self.optimiser.zero_grad()
        # In double: a sum of micro batches should not depend on their size.
        total = torch.zeros((), dtype=torch.float64, device=task.device)
        for number, part in enumerate(parts, start=1):
            with self._unsynchronised(last=number == len(parts)):
                total += self._backward(part, counts)
        if self.world > 1:
            dist.all_reduce(total)
        loss = float(total)
        # Without a limit nothing is clipped, and the norm is told all the same.
        moved = [p for group in self.optimiser.param_groups for p in group["params"]]
        norm = nn.utils.clip_grad_norm_(moved, settings.clip or math.inf)
        if not (math.isfinite(loss) and bool(torch.isfinite(norm))):
            raise SfkitError(
                f"step {self.course.done + 1}: the loss is {loss} and its gradient's norm {float(norm)}, the "
                "training has left the rails; begin anew with a lower rate"
            )
        self.optimiser.step()
        return loss, float(norm)

    def _backward(self, part: Tensors, counts: torch.Tensor) -> torch.Tensor:
        """Add a part's gradient; DDP averages over processes, so what is summed is multiplied first."""
        low = self.task.settings.precision is Precision.BFLOAT16
        with torch.autocast(self.task.device.type, torch.bfloat16, enabled=low):
            sums = self.terms(part.left, part.right, part.truth)
        # At least 1: a term without a pixel adds 0, not NaN.
        loss = (sums / counts.clamp(min=1).to(sums.dtype)).sum()
        (loss * self.world).backward()
        return cast(torch.Tensor, loss.detach()).double()

    def _has_unused(self, part: Tensors, counts: torch.Tensor) -> bool:
        """Whether some parameter gets no gradient on any process, by one pass that leaves no trace.

        DDP waits for every gradient unless it is told, and where it is told without need it complains.
        """
        before = [(buffer, buffer.clone()) for buffer in self.network.buffers()]
        devices = [self.task.device] if self.task.device.type == "cuda" else []
        with torch.random.fork_rng(devices=devices):
            self._backward(part, counts)
        idle = [p for p in self.network.parameters() if p.requires_grad and p.grad is None]
        for buffer, value in before:
            buffer.copy_(value)
        found = torch.tensor(float(bool(idle)), device=self.task.device)
        dist.all_reduce(found, op=dist.ReduceOp.MAX)
        return bool(found)

    def _unsynchronised(self, *, last: bool) -> contextlib.AbstractContextManager[None]:
        if isinstance(self.terms, DistributedDataParallel) and not last:
            # Gradients of micro batches are exchanged once, with the last of them.
            return self.terms.no_sync()
        return contextlib.nullcontext()

    def _train_mode(self) -> None:
        self.network.train()
        if self.task.settings.freeze_batch_norm:
            for module in self.network.modules():
                # Frozen by evaluation mode: then neither micro batches nor processes change what is computed.
                if isinstance(module, BatchNorm):
                    module.eval()

    def _count_broken(self, broken: Mapping[str, str]) -> None:
        if self.world > 1:
            gathered: list[Mapping[str, str]] = [{} for _ in range(self.world)]
            dist.all_gather_object(gathered, broken)
            broken = {name: why for each in gathered for name, why in each.items()}
        self.course.broken.update(broken)
        bad, of = len(self.course.broken), len(self.task.pairs)
        if bad > self.task.settings.broken_share * of:
            name, why = next(iter(self.course.broken.items()))
            raise InputError(
                f"{bad} of {of} pairs cannot be read, more than the share {self.task.settings.broken_share} "
                f"that may be broken; the first is {name}: {why}"
            )

    def _score_and_save(self) -> None:
        if self.rank == 0:
            if self.score is not None:
                self.network.eval()
                self.course.scores.append([self.course.done, *self.score(self.network)])
                self._train_mode()
            course = self.course
            values = {
                "network": self.network.state_dict(),
                "optimiser": self.optimiser.state_dict(),
                "course": {
                    "seconds": course.seconds,
                    "cpu_seconds": course.cpu_seconds,
                    "curve": course.curve,
                    "scores": course.scores,
                    "broken": course.broken,
                },
            }
            save_state(self.task.folder, course.done, self.task.identity, values)
        if self.world > 1:
            # Nobody goes on before the state is there: a kill now would leave processes at two steps.
            dist.barrier()

    def _resume(self) -> None:
        state = last_state(self.task.folder, self.task.identity)
        if state is None:
            return
        self.network.load_state_dict(state["network"])
        self.optimiser.load_state_dict(state["optimiser"])
        # How many steps there are is the task's; the state says how far it came.
        self.course = Course(self.course.steps, int(state["step"]), **state["course"])


def one_cycle(step: int, steps: int, peak: float, warm_up: float) -> float:
    """The rate of ``step`` (from 0) of ``steps``: up to ``peak`` after the share ``warm_up``, then down.

    Smith and Topin, "Super-convergence" (2018), in the two-phase cosine form of PyTorch's ``OneCycleLR``, but
    with a peak for each parameter group: given one number, ``OneCycleLR`` raises every group to it. It is a
    function of the step: nothing is carried along.
    """
    # As OneCycleLR counts: the first phase ends at step warm_up * steps - 1.
    top, last = warm_up * steps - 1, steps - 1
    if step <= top:
        return _between(peak * START, peak, step / top if top > 0 else 1.0)
    return _between(peak, peak * END, (step - max(top, 0)) / max(last - max(top, 0), 1e-9))


def _between(start: float, end: float, share: float) -> float:
    # Half a cosine wave, from start to end.
    return end + (start - end) * (1 + math.cos(math.pi * min(share, 1.0))) / 2
