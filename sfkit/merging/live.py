"""The live model: a network whose parameters are views into the buffer that merges are written to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import torch
from torch import nn

from sfkit.merging.forward import ForwardMode
from sfkit.merging.recipe import Recipe
from sfkit.merging.residency import DeviceMerger

if TYPE_CHECKING:
    from sfkit.merging.pool import Pool


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
        pool: Pool,
        recipe: Recipe | None = None,
        *,
        device: str | torch.device = "cpu",
        mode: ForwardMode | None = None,
    ) -> None:
        self.pool = pool
        self.device = torch.device(device)
        self.mode = mode or ForwardMode()
        self.network = pool.build().to(self.device).eval().requires_grad_(requires_grad=False)
        self.flat = torch.empty(pool.layout.size, dtype=torch.float32, device=self.device)
        _load(self.network, pool.base_tensors)
        _bind(self.network, pool.layout.views(self.flat))
        self._merger = None if self.device.type == "cpu" else DeviceMerger(pool, self.device)
        self.recipe = recipe if recipe is not None else pool.base_recipe()
        self.apply(self.recipe)

    def apply(self, recipe: Recipe) -> None:
        """Turn the network into the merge that ``recipe`` describes.

        Raises:
            InputError: the recipe names sources or blocks the pool does not have.
        """
        (self._merger or self.pool).merge_into(recipe, self.flat)
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
            tensor.data = views[key]
