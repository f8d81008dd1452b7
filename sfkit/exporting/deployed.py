"""The network as an exported file holds it: raw images in, disparity out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from sfkit.architectures.inputs import InputConvention, PreparedPair


@dataclass(frozen=True)
class Sizes:
    """Which images an exported file takes.

    Attributes:
        fixed: (height, width) of every image, padded inside; None for any size that ``multiple`` divides,
            padded by the caller.
        multiple: what height and width must be divisible by where they are not fixed.
    """

    fixed: tuple[int, int] | None
    multiple: int

    def dynamic_shapes(self) -> tuple[dict[int, Any], dict[int, Any]] | None:
        """What ``torch.export`` wants to know of both images: one height and width, in whole multiples."""
        if self.fixed is not None:
            return None
        # torch.export treats sizes of 0 and 1 as cases of their own: a range starts at 2.
        height, width = (torch.export.Dim(name, min=2, max=4096) for name in ("height", "width"))
        image = (
            {2: self.multiple * height, 3: self.multiple * width}
            if self.multiple > 1
            else {2: height, 3: width}
        )
        return image, dict(image)

    def fed(self, left: NDArray[np.uint8], right: NDArray[np.uint8], inputs: InputConvention) -> PreparedPair:
        """Two (H, W, 3) images as a file of these sizes takes them: of 0 .. 255, padded where it does not."""
        # A file of one size pads inside.
        multiple = inputs.multiple if self.fixed is None else 1
        raw = replace(inputs, scale=1.0, mean=(0.0,) * 3, std=(1.0,) * 3, multiple=multiple)
        return raw.prepare(left, right)


class DeployedNetwork(nn.Module):
    """RGB images (1, 3, H, W) of 0 .. 255, float32 -> disparity of the left one (1, H, W) in pixels.

    Scale, mean and deviation are applied here; so is the padding of images of a fixed size.
    """

    mean: torch.Tensor
    std: torch.Tensor

    def __init__(self, network: nn.Module, inputs: InputConvention, sizes: Sizes) -> None:
        super().__init__()
        self.network = network
        self.scale = inputs.scale
        self.register_buffer("mean", torch.tensor(inputs.mean)[:, None, None])
        self.register_buffer("std", torch.tensor(inputs.std)[:, None, None])
        self.window = None if sizes.fixed is None else inputs.window(*sizes.fixed)

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        """As the class says."""
        output: torch.Tensor = self.network(self._prepared(left), self._prepared(right))
        disparity = output[:, 0] if output.ndim == 4 else output
        return disparity if self.window is None else self.window[0].crop(disparity)

    def _prepared(self, image: torch.Tensor) -> torch.Tensor:
        x = (image * self.scale - self.mean) / self.std
        if self.window is None:
            return x
        window, size = self.window
        return window.pad(x, size)
