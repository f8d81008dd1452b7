"""How an image pair becomes a network's input, and its output a disparity map again.

Range, normalisation and padding are habits of an architecture (DESIGN, Evaluation), never of an
evaluation protocol, so they live here and belong to the key of every evaluation.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, TypeVar

import numpy as np
import torch
import torch.nn.functional as F
from numpy.typing import NDArray

from sfkit.errors import InputError, member_of

Map = TypeVar("Map", torch.Tensor, NDArray[np.float32])

IMAGENET_MEAN = (0.485, 0.456, 0.406)
IMAGENET_STD = (0.229, 0.224, 0.225)


class PadSides(StrEnum):
    """Where the extra rows and columns go."""

    BOTTOM_RIGHT = "bottom-right"
    TOP_RIGHT = "top-right"
    CENTRE = "centre"  # half on each side, the odd one at the bottom and on the right


@dataclass(frozen=True)
class Window:
    """The image's place in the padded input: rows top..top+height, columns left..left+width, in pixels."""

    top: int
    left: int
    height: int
    width: int

    def crop(self, map_: Map) -> Map:
        """Cut the window out of a map of shape (..., H_padded, W_padded)."""
        found: Map = map_[..., self.top : self.top + self.height, self.left : self.left + self.width]
        return found

    def pad(self, map_: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
        """A map (B, C, height, width) with its edges repeated until it has ``size``, (H_padded, W_padded)."""
        right, bottom = size[1] - self.left - self.width, size[0] - self.top - self.height
        sides = (self.left, right, self.top, bottom)
        # Where there is nothing to pad, no operator is traced into an exported file.
        return F.pad(map_, sides, mode="replicate") if any(sides) else map_


@dataclass(frozen=True)
class PreparedPair:
    """A stereo pair as the network reads it: (1, 3, H_padded, W_padded) float32 each, and the way back."""

    left: torch.Tensor
    right: torch.Tensor
    window: Window


@dataclass(frozen=True)
class InputConvention:
    """RGB images of 0..255 are multiplied by ``scale``, normalised by ``mean`` and ``std``, then padded.

    ``multiple`` is what height and width must be divisible by; padding replicates the edge. The
    defaults suit a network that takes ImageNet-normalised images of any size.
    """

    scale: float = 1.0 / 255.0
    mean: tuple[float, float, float] = IMAGENET_MEAN
    std: tuple[float, float, float] = IMAGENET_STD
    multiple: int = 1
    sides: PadSides = PadSides.BOTTOM_RIGHT

    def __post_init__(self) -> None:
        """Take a side as text; refuse what no image could be prepared with.

        Raises:
            InputError: an unknown side, or a multiple below 1.
        """
        object.__setattr__(self, "sides", member_of(PadSides, "padding side", self.sides))
        if self.multiple < 1:
            raise InputError(f"multiple is {self.multiple}, expected what height and width are divisible by")

    def describe(self) -> dict[str, Any]:
        """Plain values for the evaluation's key."""
        return asdict(self)

    def window(self, height: int, width: int) -> tuple[Window, tuple[int, int]]:
        """Where a height x width image lies in its padded input, and that input's (height, width)."""
        # What is missing to the next multiple.
        extra_h, extra_w = -height % self.multiple, -width % self.multiple
        top = {PadSides.BOTTOM_RIGHT: 0, PadSides.TOP_RIGHT: extra_h, PadSides.CENTRE: extra_h // 2}[
            self.sides
        ]
        left = extra_w // 2 if self.sides is PadSides.CENTRE else 0
        return Window(top, left, height, width), (height + extra_h, width + extra_w)

    def prepare(self, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> PreparedPair:
        """Two (H, W, 3) RGB uint8 images of one rectified pair, as network input.

        Raises:
            InputError: the images are not both (H, W, 3), or differ in size.
        """
        if left.shape != right.shape or left.ndim != 3 or left.shape[2] != 3:
            raise InputError(
                f"left and right image must both be (H, W, 3), found {left.shape} and {right.shape}: "
                "give the two images of one rectified pair"
            )
        window, padded = self.window(*left.shape[:2])
        return PreparedPair(self._input(left, window, padded), self._input(right, window, padded), window)

    def _input(self, image: NDArray[np.uint8], window: Window, padded: tuple[int, int]) -> torch.Tensor:
        # Images that Ray holds may not be written to, which torch wants of all it shares memory with.
        own = np.require(image, requirements=("C", "W"))
        # In place: every step would make another array of the image's size.
        x = torch.from_numpy(own).permute(2, 0, 1).float().mul_(self.scale)
        x = x.sub_(torch.tensor(self.mean)[:, None, None]).div_(torch.tensor(self.std)[:, None, None])
        return window.pad(x[None], padded).contiguous()
