"""The live model: a network whose parameters are views into the buffer that merges are written to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

import torch
from torch import nn

from sfkit.merging.device_merging import DeviceMerger
from sfkit.merging.forward import ForwardMode
from sfkit.merging.recipe import Recipe
from sfkit.merging.vectors import TaskVectors


class Mergeable(Protocol):
    """What recipes are merged from, which a :class:`~sfkit.merging.pool.Pool` is."""

    @property
    def task_vectors(self) -> TaskVectors:
        """Base and sources as flat buffers."""
        ...

    @property
    def base_tensors(self) -> Mapping[str, torch.Tensor]:
        """The base's tensors by key."""
        ...

    def build(self) -> nn.Module:
        """A network, its values not those of any member."""
        ...

    def base_recipe(self) -> Recipe:
        """The base itself."""
        ...

    def ordered(self, recipe: Recipe) -> Recipe:
        """The recipe, checked, with its sources in the order task vectors are added in."""
        ...


class LiveModel:
    """One network in evaluation mode that takes on recipe after recipe without loading a state dict.

    Attributes:
        network: the ``nn.Module``; its mergeable parameters and running statistics are views into
            ``flat``, so :meth:`apply` changes it in place.
        flat: (P,) float32 buffer on ``device``.
        recipe: the recipe the network holds now.
        mode: how its forward passes compute.
    """

    def __init__(
        self,
        pool: Mergeable,
        recipe: Recipe | None = None,
        *,
        device: str | torch.device = "cpu",
        mode: ForwardMode | None = None,
    ) -> None:
        self._vectors, self._ordered = pool.task_vectors, pool.ordered
        self.device = torch.device(device)
        self.mode = mode or ForwardMode()
        self.network = pool.build().to(self.device).eval().requires_grad_(requires_grad=False)
        self.flat = torch.empty(self._vectors.layout.size, dtype=torch.float32, device=self.device)
        _load(self.network, pool.base_tensors)
        # Views from here on: their values are those of the first merge.
        _bind(self.network, self._vectors.layout.views(self.flat))
        # On the CPU task vectors are read where they lie, mapped files too.
        on_cpu = self.device.type == "cpu"
        self._merger = self._vectors if on_cpu else DeviceMerger(self._vectors, self.device)
        self.recipe = recipe if recipe is not None else pool.base_recipe()
        self.apply(self.recipe)

    def apply(self, recipe: Recipe) -> None:
        """Turn the network into the merge that ``recipe`` describes.

        Raises:
            InputError: the recipe names sources or blocks the pool does not have.
        """
        self._merger.merge_into(self._ordered(recipe), self.flat)
        self.recipe = recipe

    @torch.inference_mode()
    def disparity(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        """Run the network on one prepared pair.

        Args:
            left: (1, 3, H, W) float32, normalised and padded as the architecture wants it.
            right: the same of the right image.

        Returns:
            (H, W) float32 disparity of the left image in pixels, on the CPU.
        """
        with self.mode.computing(self.device):
            output = self.network(*(self.mode.place(images, self.device) for images in (left, right)))
        # Under autocast the last layer may answer in bfloat16, whose steps are 0.5 px at 100 px.
        return output.reshape(output.shape[-2:]).float().cpu()  # type: ignore[no-any-return]


def _load(network: nn.Module, tensors: Mapping[str, torch.Tensor]) -> None:
    """Copy the base's tensors in; a counter the file does not have stays as the network made it."""
    for key, target in network.state_dict(keep_vars=True).items():
        if key in tensors:
            target.data.copy_(tensors[key])


def _bind(network: nn.Module, views: Mapping[str, torch.Tensor]) -> None:
    """Make parameters and running statistics views, aliases of one tensor the same view."""
    for key, tensor in network.state_dict(keep_vars=True).items():
        if key in views:
            # The Parameter objects stay, only their memory is another: what refers to them goes on working.
            tensor.data = views[key]
