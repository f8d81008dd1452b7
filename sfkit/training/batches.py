"""A step's pairs, read, changed and stacked; a file that cannot be read is named, replaced and counted.

Which pairs a step sees, and every random number about them, are functions of seed, epoch and pair alone:
nothing depends on worker, process or history, so a resumed or differently parallel training sees the same.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass
from functools import lru_cache
from itertools import groupby

import numpy as np
import torch
from numpy.random import Generator
from numpy.typing import NDArray

from sfkit.architectures import InputConvention
from sfkit.datasets.pairs import Pair
from sfkit.errors import InputError
from sfkit.streams import Stream, generator
from sfkit.training.augment import Example, augment
from sfkit.training.settings import TrainingSettings


@dataclass(frozen=True)
class Read:
    """The examples of a share of one step, and what could not be read on the way: pair id -> why."""

    examples: list[Example]
    broken: dict[str, str]


@dataclass(frozen=True)
class Tensors:
    """Examples of one size: views (B, 3, h, w) as the network reads them, truth (B, h, w) px or NaN."""

    left: torch.Tensor
    right: torch.Tensor
    truth: torch.Tensor


class Batches:
    """What each step sees, for process ``rank`` of ``world``, read ahead in threads."""

    def __init__(
        self,
        pairs: Sequence[Pair],
        settings: TrainingSettings,
        multiple: int,
        *,
        rank: int = 0,
        world: int = 1,
    ) -> None:
        self.pairs, self.settings, self.multiple = pairs, settings, multiple
        self.rank, self.world = rank, world

    def steps(self, start: int, stop: int) -> Iterator[Read]:
        """What each step reads, in order."""
        workers = self.settings.workers
        if workers == 0:
            yield from (self.step(number) for number in range(start, stop))
            return
        with ThreadPoolExecutor(workers) as pool:
            ahead: list[Future[Read]] = []
            try:
                for number in range(start, stop):
                    # One more than there are workers: none waits while the network computes.
                    while len(ahead) <= workers and number + len(ahead) < stop:
                        ahead.append(pool.submit(self.step, number + len(ahead)))
                    yield ahead.pop(0).result()
            finally:
                # What was read ahead of an interrupted training is of no use to anybody.
                for future in ahead:
                    future.cancel()

    def step(self, number: int) -> Read:
        """The share of step ``number`` that falls to this process."""
        first = number * self.settings.batch
        broken: dict[str, str] = {}
        # Every world-th pair: however many processes there are, together they see the same.
        positions = range(first + self.rank, first + self.settings.batch, self.world)
        return Read([self._example(position, broken) for position in positions], broken)

    def _example(self, position: int, broken: dict[str, str]) -> Example:
        seed, count = self.settings.seed, len(self.pairs)
        epoch, index = draw(seed, position, count)
        for tried in range(1, count + 1):
            try:
                sample = self.pairs[index].load()
                rng = changes(seed, epoch, index)
                return augment(sample, self.settings.augmentation, self.multiple, rng)
            except InputError as error:
                broken[self.pairs[index].id] = str(error)
            epoch, index = successor(seed, position, count, tried)
        first = next(iter(broken.items()))
        raise InputError(f"no pair of the training set can be read, the first is {first[0]}: {first[1]}")


def stacked(
    examples: Iterable[Example], inputs: InputConvention, limit: float, size: int, device: torch.device
) -> list[Tensors]:
    """At most ``size`` examples in each, all of one shape; truth of ``limit`` and more becomes NaN."""
    # Neighbours alone are joined, so that examples keep the order their gradients are added in.
    groups = [list(group) for _, group in groupby(examples, key=lambda e: e.truth.shape)]
    parts = [group[i : i + size] for group in groups for i in range(0, len(group), size)]
    return [_tensors(part, inputs, limit, device) for part in parts]


def _tensors(
    examples: Sequence[Example], inputs: InputConvention, limit: float, device: torch.device
) -> Tensors:
    prepared = [inputs.prepare(e.left, e.right) for e in examples]
    truth = np.stack([np.where(e.truth < limit, e.truth, np.float32(np.nan)) for e in examples])
    return Tensors(
        left=torch.cat([p.left for p in prepared]).to(device),
        right=torch.cat([p.right for p in prepared]).to(device),
        truth=torch.from_numpy(truth).to(device),
    )


def draw(seed: int, position: int, pairs: int) -> tuple[int, int]:
    """(epoch, index) of the pair at ``position`` of the stream of epochs, each in an order of its own."""
    epoch, within = divmod(position, pairs)
    return epoch, int(_order(seed, epoch, pairs)[within])


def successor(seed: int, position: int, pairs: int, tried: int) -> tuple[int, int]:
    """In the place of a pair that cannot be read: the ``tried``-th next one of the epoch's order."""
    epoch, within = divmod(position, pairs)
    return epoch, int(_order(seed, epoch, pairs)[(within + tried) % pairs])


def changes(seed: int, epoch: int, index: int) -> Generator:
    """The generator of crop, colours and boxes of a pair in an epoch."""
    return generator(seed, Stream.TRAINING_CHANGES, epoch, index)


@lru_cache(maxsize=4)
def _order(seed: int, epoch: int, pairs: int) -> NDArray[np.intp]:
    return generator(seed, Stream.TRAINING_ORDER, epoch).permutation(pairs)
