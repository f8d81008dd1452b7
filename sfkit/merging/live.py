"""The live model: a network whose parameters are views into the buffer that merges are written to."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import torch
from torch import nn

from sfkit.merging.recipe import Recipe

if TYPE_CHECKING:
    from sfkit.merging.pool import Pool


class LiveModel:
    """One network in evaluation mode that takes on recipe after recipe without loading a state dict.

    Attributes:
        network: the ``nn.Module``; its mergeable parameters and running statistics are views into
            ``flat``, so :meth:`apply` changes it in place.
        flat: (P,) float32 buffer on ``device``.
        recipe: the recipe the network holds now.
    """

    def __init__(
        self, pool: Pool, recipe: Recipe | None = None, *, device: str | torch.device = "cpu"
    ) -> None:
        self.pool = pool
        self.device = torch.device(device)
        self.network = pool.build().to(self.device).eval().requires_grad_(requires_grad=False)
        self.flat = torch.empty(pool.layout.size, dtype=torch.float32, device=self.device)
        _load(self.network, pool.base_tensors)
        _bind(self.network, pool.layout.views(self.flat))
        self.recipe = recipe if recipe is not None else pool.base_recipe()
        self.apply(self.recipe)

    def apply(self, recipe: Recipe) -> None:
        """Turn the network into the merge that ``recipe`` describes.

        Raises:
            InputError: the recipe names sources or blocks the pool does not have.
        """
        if self.device.type == "cpu":
            self.pool.merge_into(recipe, self.flat)
        else:
            self.flat.copy_(self.pool.merge_into(recipe, torch.empty(self.pool.layout.size)))
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
        output = self.network(left.to(self.device), right.to(self.device))
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
