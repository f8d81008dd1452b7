"""AnyNet with more channels where they are cheap, and edges as sharp as the image's.

The matching is AnyNet's (Wang et al., ICRA 2019): a full search at 1/16, residuals at 1/8 and 1/4. Two things
differ. Images are halved by the first convolution, so that features may be eight times as wide for the same
work. And the last map is raised from a quarter to the full size by convex combination: each pixel is a
weighted mean of the nine coarse disparities around it, the weights read from the left image (Teed and Deng,
"RAFT", ECCV 2020, section 3.3), which keeps an edge an edge where bilinear interpolation makes a ramp.
"""

from __future__ import annotations

from collections.abc import Sequence

import torch
import torch.nn.functional as F
from torch import nn

from sfkit.architectures.anynet.features import FeaturePyramid, Up, unit
from sfkit.architectures.anynet.network import MULTIPLE, AnyNet, StageTrace, matching
from sfkit.architectures.inputs import InputConvention
from sfkit.architectures.registry import register_architecture

QUARTER, EIGHTH, SIXTEENTH = 8, 16, 32
"""Channels of the features at 1/4, 1/8 and 1/16 of the image's size."""
HIDDEN = 24
SCALE = 4  # the last stage works at a quarter of the image size
PIXELS = 10.0  # disparities enter the upsampling in tens of pixels, the size of the other features

BLOCKS = {
    "backbone": ["feature_extraction.stem.*", "feature_extraction.blocks.*"],
    "neck": ["feature_extraction.upblocks.*"],
    "cost_volume": ["volume_postprocess.0.*"],
    "head": ["volume_postprocess.1.*", "volume_postprocess.2.*", "upsampling.*"],
}


@register_architecture(
    "anynet-wide", matching=matching, blocks=BLOCKS, inputs=InputConvention(multiple=MULTIPLE), version="1"
)
class WideAnyNet(AnyNet):
    """AnyNet's stages on wider features, then convex upsampling; arguments as :class:`AnyNet` has them."""

    def __init__(self, *, ranges: Sequence[int] = (4, 3, 3), align_corners: bool = True) -> None:
        super().__init__(ranges=ranges, align_corners=align_corners, spn=False)
        self.feature_extraction: nn.Module = WideFeatures()
        self.upsampling = ConvexUpsampling()
        # AnyNet drew for the parts that these replace.
        self.feature_extraction.apply(self.initialise)
        self.upsampling.apply(self.initialise)

    def trace(self, left: torch.Tensor, right: torch.Tensor) -> StageTrace:
        """AnyNet's stages; the fourth disparity is the third one raised anew."""
        found = super().trace(left, right)
        stem = self.feature_extraction.stem(left)  # type: ignore[operator]  # modules are untyped
        raised = self.upsampling(found.disparities[-1], stem)
        return StageTrace(found.low, (*found.disparities, raised), found.costs)


class WideFeatures(nn.Module):
    """Image (B, 3, H, W), normalised, H and W multiples of 16 -> ``FeaturePyramid``."""

    def __init__(self) -> None:
        super().__init__()
        self.stem = nn.Conv2d(3, QUARTER, 3, stride=2, padding=1)
        self.blocks = nn.ModuleList(
            [
                nn.Sequential(unit(QUARTER, QUARTER, stride=2), unit(QUARTER, QUARTER)),
                nn.Sequential(unit(QUARTER, EIGHTH, stride=2), unit(EIGHTH, EIGHTH)),
                nn.Sequential(unit(EIGHTH, SIXTEENTH, stride=2), unit(SIXTEENTH, SIXTEENTH)),
            ]
        )
        self.upblocks = nn.ModuleList([Up(EIGHTH + SIXTEENTH, EIGHTH), Up(QUARTER + EIGHTH, QUARTER)])

    def forward(self, image: torch.Tensor) -> FeaturePyramid:
        quarter = self.blocks[0](self.stem(image.contiguous(memory_format=torch.channels_last)))
        eighth = self.blocks[1](quarter)
        sixteenth = self.blocks[2](eighth)
        eighth = self.upblocks[0](eighth, sixteenth)
        return FeaturePyramid(sixteenth, eighth, self.upblocks[1](quarter, eighth))


class ConvexUpsampling(nn.Module):
    """Disparity (B, H, W) and the left image's stem (B, 8, H/2, W/2) -> disparity (B, H, W), in pixels.

    The disparity is read at a quarter of the size, where its stage found it.
    """

    def __init__(self) -> None:
        super().__init__()
        self.hidden = nn.Conv2d(4 * QUARTER + 1, HIDDEN, 3, padding=1)
        self.weights = nn.Conv2d(HIDDEN, 9 * SCALE * SCALE, 1)

    def forward(self, disparity: torch.Tensor, stem: torch.Tensor) -> torch.Tensor:
        batch, height, width = disparity.shape
        small = (height // SCALE, width // SCALE)
        low = F.interpolate(disparity[:, None], size=small, mode="bilinear", align_corners=False)
        # Two by two places of the stem become channels, so that both are at a quarter of the size.
        guide = torch.cat([F.pixel_unshuffle(stem, 2), low / PIXELS], dim=1)
        weights = self.weights(F.relu(self.hidden(guide))).view(batch, 9, SCALE * SCALE, *small)
        # Edges are repeated: zeros would pull disparities at the border down.
        around = F.unfold(F.pad(low, (1, 1, 1, 1), mode="replicate"), 3).view(batch, 9, 1, *small)
        fine = (torch.softmax(weights, dim=1) * around).sum(dim=1)
        return F.pixel_shuffle(fine, SCALE)[:, 0]
