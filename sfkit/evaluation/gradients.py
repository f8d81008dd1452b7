"""Gradients of a loss with respect to the merged parameters, pair by pair, in the pool's flat layout.

For methods that look at more than scores: Fisher merging (squared gradients of the loss on labelled pairs)
and AdaMerging (entropy of the matching distribution, without labels). The network stays in evaluation mode.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import torch
import torch.nn.functional as F

from sfkit.architectures import PreparedPair
from sfkit.errors import InputError
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging.live import LiveModel
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe

Loss = Callable[[torch.nn.Module, PreparedPair, torch.Tensor], torch.Tensor]
"""A scalar from a network, its input, and the ground truth (H, W) in pixels, NaN where it does not count."""


class GradientModel:
    """One network whose gradients are read as one flat vector.

    Args:
        pool: whose recipes it takes on.
        benchmark: the pairs, prepared for the pool's architecture.
        loss: what is differentiated.
        device: where it runs.
    """

    def __init__(self, pool: Pool, benchmark: PreparedBenchmark, loss: Loss, *, device: str = "cpu") -> None:
        self.benchmark, self.loss = benchmark, loss
        self._live = LiveModel(pool, device=device)
        self._layout = pool.layout
        self._parameters = dict(self._live.network.named_parameters())
        # A live model's parameters want none.
        for parameter in self._parameters.values():
            parameter.requires_grad = True

    @property
    def flat(self) -> torch.Tensor:
        """The network's merged parameters (P,)."""
        return self._live.flat

    def take(self, recipe: Recipe) -> None:
        """Become the network a recipe describes."""
        # Written in place into leaves that want gradients, which autograd allows only unrecorded.
        with torch.no_grad():
            self._live.apply(recipe)

    def gradient(self, number: int) -> tuple[float, torch.Tensor]:
        """The loss on one pair, and its gradient (P,) on the CPU; 0 for running statistics.

        Raises:
            InputError: there is no gradient, or it or the loss is not finite.
        """
        pair, name = self.benchmark.pair(number), self.benchmark.benchmark.ids[number]
        for parameter in self._parameters.values():
            # Not zeroed but taken away: else backward() would add to the pair before.
            parameter.grad = None
        device = self._live.device
        placed = PreparedPair(pair.left.to(device), pair.right.to(device), pair.window)
        truth = torch.from_numpy(self.benchmark.truth(number)).to(device)
        value = self.loss(self._live.network, placed, truth)
        if not value.requires_grad:
            raise InputError(
                f"pair {name!r}: the network's output has no gradient, expected one with respect to its "
                "parameters: its forward pass leaves torch somewhere"
            )
        value.backward()  # type: ignore[no-untyped-call]  # untyped in torch
        # On the CPU, where the task vectors lie.
        flat = torch.zeros(self._layout.size)
        views = self._layout.views(flat)
        for key, parameter in self._parameters.items():
            if key in views and parameter.grad is not None:
                views[key].add_(parameter.grad.cpu())
        found = float(value.detach())
        if not (math.isfinite(found) and bool(torch.isfinite(flat).all())):
            raise InputError(
                f"pair {name!r}: the loss or its gradient is not finite, expected numbers: this network "
                "cannot be differentiated there"
            )
        return found, flat


def fisher_information(
    pool: Pool, recipe: Recipe, benchmarks: Sequence[PreparedBenchmark], *, device: str = "cpu"
) -> torch.Tensor:
    """Diagonal empirical Fisher information (P,) of one network: the mean squared gradient over pairs.

    The loss is training's: smooth L1 of the disparity over valid pixels, in pixels.
    """
    total, pairs = torch.zeros(pool.layout.size), 0
    for benchmark in benchmarks:
        model = GradientModel(pool, benchmark, disparity_loss, device=device)
        model.take(recipe)
        for number in range(len(benchmark)):
            _, gradient = model.gradient(number)
            # Pair by pair: the square of a mean gradient is not the mean of squares.
            total.addcmul_(gradient, gradient)
            pairs += 1
    return total.div_(pairs)


def disparity_loss(network: torch.nn.Module, pair: PreparedPair, truth: torch.Tensor) -> torch.Tensor:
    """Smooth L1 of the disparity over the pixels that count."""
    output = network(pair.left, pair.right)
    found = pair.window.crop(output.reshape(output.shape[-2:]))
    valid = torch.isfinite(truth)
    # By index: NaN times a mask of 0 is NaN, in the gradient too.
    return F.smooth_l1_loss(found[valid], truth[valid])


def matching_entropy(pool: Pool) -> Loss:
    """Entropy of the network's matching distributions, each divided by that of even odds: 0 to 1.

    The mean over pixels, and over the stages of a network that matches more than once.

    Raises:
        InputError: the architecture offers no matching distribution.
    """
    matching = pool.architecture.matching
    if matching is None:
        raise InputError(
            f"architecture {pool.architecture.name!r}: offers no matching distribution over disparities, "
            "expected one to take the entropy of: register it with matching=, or leave AdaMerging out"
        )

    def loss(network: torch.nn.Module, pair: PreparedPair, truth: torch.Tensor) -> torch.Tensor:
        stages = [
            # In parts of the largest there is, so that stages of other ranges weigh alike.
            torch.special.entr(odds).sum(dim=1).mean() / math.log(odds.shape[1])
            for odds in matching(network, pair.left, pair.right)
        ]
        return torch.stack(stages).mean()

    return loss
