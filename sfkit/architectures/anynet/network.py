"""AnyNet: coarse disparity first, then residuals at finer scales (Wang et al., ICRA 2019, figure 2)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, cast

import torch
import torch.nn.functional as F
from torch import nn

from sfkit.architectures.anynet.aggregation import Route, VolumeStack, soft_argmin
from sfkit.architectures.anynet.features import FeatureExtractor, FeaturePyramid
from sfkit.architectures.anynet.refinement import refine, spatial_propagation
from sfkit.architectures.anynet.volumes import full_volume, residual_volume
from sfkit.architectures.inputs import InputConvention
from sfkit.architectures.registry import register_architecture
from sfkit.errors import InputError

MULTIPLE = 16
BLOCKS = {
    "backbone": ["feature_extraction.block0.*", "feature_extraction.blocks.*"],
    "neck": ["feature_extraction.upblocks.*"],
    "cost_volume": ["volume_postprocess.0.*"],
    "head": ["volume_postprocess.1.*", "volume_postprocess.2.*"],
}


@dataclass(frozen=True)
class StageTrace:
    """What each stage found.

    Attributes:
        low: soft argmin of stages 1 to 3 at 1/16, 1/8 and 1/4 of the image size, (B, h, w) in pixels of
            that scale: a disparity in stage 1, a residual afterwards.
        disparities: disparity after each stage, (B, H, W) in pixels; the last one is the output.
        costs: of the candidates of stages 1 to 3, (B, D, h, w).
    """

    low: tuple[torch.Tensor, ...]
    disparities: tuple[torch.Tensor, ...]
    costs: tuple[torch.Tensor, ...]


def matching(network: nn.Module, left: torch.Tensor, right: torch.Tensor) -> tuple[torch.Tensor, ...]:
    """The distributions of stages 1 to 3: over disparities, then over residuals, each (B, D, h, w)."""
    trace = cast(AnyNet, network).trace(left, right)
    return tuple(torch.softmax(-cost, dim=1) for cost in trace.costs)


WITHOUT_SPN = {
    "refine_spn.*": "was it trained without the propagation stage? then say spn = false (in [options] of "
    "pool.toml, --option spn=false): with another's weights in that stage its error grows by up to 9.7 points"
}


@register_architecture(
    "anynet",
    matching=matching,
    blocks=BLOCKS,
    inputs=InputConvention(multiple=MULTIPLE),
    optional=("refine_spn.*",),
    advice=WITHOUT_SPN,
    version="1",
)
class AnyNet(nn.Module):
    """AnyNet with three stages and, with ``spn``, the spatial propagation stage.

    Args:
        ranges: disparity candidates of stage 1 (0 .. n-1, steps of 16 px), then the reach of stages 2
            and 3: m means the 2 m - 1 residuals -(m-1) .. m-1 (steps of 8 px and of 4 px). The weights do
            not depend on them.
        align_corners: how the warp reads its coordinates. True samples exact columns, as the published
            weights were trained; False is what the published code does on PyTorch 1.3 and later.
        spn: with the propagation stage; without it there are no ``refine_spn`` weights.

    Raises:
        InputError: ``ranges`` is not three whole numbers of at least 2, or a switch is not true or false.
    """

    stack_widths: ClassVar[tuple[int, int, int]] = (16, 4, 4)
    """Channels of the 3-D convolutions of stages 1 to 3."""

    def __init__(
        self, *, ranges: Sequence[int] = (12, 3, 3), align_corners: bool = True, spn: bool = True
    ) -> None:
        super().__init__()
        self.ranges = _checked_ranges(ranges)
        self.align_corners = _checked_switch("align_corners", align_corners)
        self.feature_extraction: nn.Module = FeatureExtractor()
        self.volume_postprocess = nn.ModuleList([VolumeStack(width) for width in self.stack_widths])
        self.refine_spn = spatial_propagation() if _checked_switch("spn", spn) else None
        self.apply(self.initialise)

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        """Positive disparity (B, H, W) of the left image in pixels, from the last stage.

        ``left`` and ``right`` are (B, 3, H, W), normalised; H and W must be multiples of 16.

        Raises:
            InputError: another shape.
        """
        return self.trace(left, right).disparities[-1]

    def stages(self, left: torch.Tensor, right: torch.Tensor) -> list[torch.Tensor]:
        """The disparity after each stage, coarse to fine, each (B, H, W) in pixels."""
        return list(self.trace(left, right).disparities)

    def trace(self, left: torch.Tensor, right: torch.Tensor) -> StageTrace:
        """All stages with their low-resolution values, for training, display and tests."""
        _check_images(left, right)
        size = (left.shape[-2], left.shape[-1])
        low: list[torch.Tensor] = []
        costs: list[torch.Tensor] = []
        disparities: list[torch.Tensor] = []
        for stage, (a, b) in enumerate(zip(*self._features(left, right), strict=True)):
            previous = disparities[-1] if disparities else None
            cost, first = self._cost(stage, a, b, previous)
            costs.append(cost)
            low.append(soft_argmin(cost, first))
            # Found in pixels of the small map, which are so many of the image's.
            step = _resize(low[-1] * (size[0] / a.shape[-2]), size)
            disparities.append(step if previous is None else previous + step)
        if self.refine_spn is not None:
            disparities.append(refine(self.refine_spn, left, disparities[-1]))
        return StageTrace(tuple(low), tuple(disparities), tuple(costs))

    @staticmethod
    def initialise(module: nn.Module) -> None:
        """Draw a convolution's weights from torch's random state, as the published training does."""
        if isinstance(module, nn.Conv2d | nn.Conv3d):
            # He et al. 2015, by the fan out.
            nn.init.normal_(
                module.weight, std=math.sqrt(2 / (math.prod(module.kernel_size) * module.out_channels))
            )

    def use_route(self, route: Route) -> None:
        """Compute the 3-D convolutions by ``route`` from now on; results agree within rounding."""
        for stack in self.volume_postprocess:
            cast(VolumeStack, stack).route = route

    def _cost(
        self, stage: int, left: torch.Tensor, right: torch.Tensor, previous: torch.Tensor | None
    ) -> tuple[torch.Tensor, int]:
        """What a stage thinks of its candidates, and the first of them."""
        if previous is None:
            cost, first = full_volume(left, right, self.ranges[0]), 0
        else:
            size = (left.shape[-2], left.shape[-1])
            disparity = _resize(previous, size) * (size[0] / previous.shape[-2])
            reach = self.ranges[stage] - 1
            cost = residual_volume(left, right, disparity, reach, align_corners=self.align_corners)
            first = -reach
        # The residual is added although its candidate was sampled at disparity - k: the published weights
        # learned the sign this way round.
        return self.volume_postprocess[stage](cost), first

    def _features(self, left: torch.Tensor, right: torch.Tensor) -> tuple[FeaturePyramid, FeaturePyramid]:
        if self.training:  # batch statistics are those of one side, as in the published training
            return self.feature_extraction(left), self.feature_extraction(right)
        # Both at once: by running statistics no image depends on another.
        both = self.feature_extraction(torch.cat([left, right]))
        n = left.shape[0]
        return FeaturePyramid(*[m[:n] for m in both]), FeaturePyramid(*[m[n:] for m in both])


@register_architecture(
    "anynet-slim",
    blocks=BLOCKS,
    inputs=InputConvention(multiple=MULTIPLE),
    optional=("refine_spn.*",),
    advice=WITHOUT_SPN,
    version="1",
)
class SlimAnyNet(AnyNet):
    """AnyNet with narrower 3-D convolutions: another architecture, whose weights fit no AnyNet."""

    stack_widths = (8, 4, 2)


def _resize(maps: torch.Tensor, size: tuple[int, int]) -> torch.Tensor:
    return F.interpolate(maps[:, None], size=size, mode="bilinear", align_corners=False)[:, 0]


def _checked_ranges(ranges: Sequence[int]) -> tuple[int, int, int]:
    values = tuple(ranges) if isinstance(ranges, list | tuple) else ()
    # By type: True is an int to Python.
    if len(values) != 3 or not all(type(v) is int and v >= 2 for v in values):
        raise InputError(
            f"ranges of architecture 'anynet' are {ranges!r}, expected three whole numbers of at least 2: "
            "give for example [12, 3, 3]"
        )
    return values[0], values[1], values[2]


def _checked_switch(name: str, value: bool) -> bool:
    if type(value) is not bool:
        raise InputError(
            f"{name} of architecture 'anynet' is {value!r}, expected true or false: write it without quotes"
        )
    return value


def _check_images(left: torch.Tensor, right: torch.Tensor) -> None:
    if left.shape != right.shape or left.ndim != 4 or left.shape[1] != 3:
        raise InputError(
            f"left and right must both be (B, 3, H, W), found {tuple(left.shape)} and {tuple(right.shape)}: "
            "prepare the pair with the architecture's input convention"
        )
    if left.shape[2] % MULTIPLE or left.shape[3] % MULTIPLE or 0 in left.shape:
        raise InputError(
            f"images of architecture 'anynet' are {left.shape[2]} x {left.shape[3]} pixels, expected "
            f"multiples of {MULTIPLE}: prepare the pair with the input convention, which pads it"
        )
