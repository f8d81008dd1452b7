"""FoundationStereo (Wen et al., CVPR 2025), inference: two rectified images to a disparity map.

Written from the paper and a description of the network's behaviour; attribute names are those of the
published checkpoints, so their state dicts load strictly.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import dataclass

import torch
from torch import Tensor, nn

from sfkit.architectures.foundation_stereo.aggregation import (
    FILTERED,
    FeatureGate,
    Hourglass,
    classifier,
    correlation_stem,
    soft_argmin,
)
from sfkit.architectures.foundation_stereo.context import (
    HIDDEN,
    ChannelAttention,
    ContextNetwork,
    SpatialAttention,
)
from sfkit.architectures.foundation_stereo.cost_volume import PROJECTED, hybrid_volume
from sfkit.architectures.foundation_stereo.disparity_transformer import DisparityAttention
from sfkit.architectures.foundation_stereo.lookup import GeometryLookup
from sfkit.architectures.foundation_stereo.neck import FUSED, FeatureNetwork, Features, image_stem
from sfkit.architectures.foundation_stereo.sizes import VitSize
from sfkit.architectures.foundation_stereo.update import Scales, UpdateBlock
from sfkit.architectures.foundation_stereo.upsampling import (
    FACTOR,
    STEM_CHANNELS,
    convex_upsample,
    mask_fusion,
    weight_logits,
)
from sfkit.architectures.inputs import IMAGENET_MEAN, IMAGENET_STD
from sfkit.errors import InputError

MULTIPLE = 32  # three halvings of the volume below a quarter of the resolution


@dataclass(frozen=True)
class Encoded:
    """Everything the recurrence reads; a pair's images are not needed after it.

    Attributes:
        lookup: evidence around a disparity.
        initial: the first disparity, (B, 1, h, w), quarter-resolution pixels.
        hidden: hidden states at the start, at 1/4, 1/8 and 1/16.
        context: gated context maps at these scales.
        attention: blend of the GRU's two kernels at these scales.
        stem: the left image's features at half resolution, (B, 32, H / 2, W / 2).
    """

    lookup: GeometryLookup
    initial: Tensor
    hidden: Scales
    context: Scales
    attention: Scales
    stem: Tensor


@dataclass(frozen=True)
class RefinementTrace:
    """A forward pass step by step.

    Attributes:
        initial: the first disparity, (B, 1, h, w), quarter-resolution pixels.
        disparities: after every iteration, (B, H, W) each, full-resolution pixels.
    """

    initial: Tensor
    disparities: tuple[Tensor, ...]


class FoundationStereo(nn.Module):
    """Stereo matching with a monocular foundation model inside.

    Args:
        size: widths of the frozen monocular branch.
        max_disp: disparities from 0 up to this many pixels enter the cost volume; a multiple of 32.
        iterations: recurrent updates.
        attention: over what the disparity transformer's attention runs.
        mixed_precision: on CUDA, run convolutions and attention in half precision; no effect elsewhere.
        low_memory: compute the all-pairs correlation again at each iteration instead of storing it.
    """

    def __init__(
        self,
        size: VitSize,
        max_disp: int,
        iterations: int,
        attention: DisparityAttention,
        mixed_precision: bool,
        low_memory: bool,
    ) -> None:
        super().__init__()
        self.disparities = max_disp // FACTOR
        self.iterations = iterations
        self.mixed_precision = mixed_precision
        self.low_memory = low_memory
        quarter = FUSED[0] + size.out_channels
        self.feature = FeatureNetwork(size)
        self.stem_2 = image_stem(3, STEM_CHANNELS)
        self.proj_cmb = nn.Conv2d(quarter, PROJECTED, 1)
        self.corr_stem = correlation_stem()
        self.corr_feature_att = FeatureGate(FILTERED, quarter)
        self.cost_agg = Hourglass(attention)
        self.classifier = classifier()
        self.cnet = ContextNetwork(size.out_channels)
        self.cam = ChannelAttention()
        self.sam = SpatialAttention()
        self.update_block = UpdateBlock()
        self.spx_2_gru = mask_fusion()
        self.spx_gru = weight_logits()
        # these two take no part in inference; published files hold them
        self.stem_4 = image_stem(STEM_CHANNELS, 48)
        self.context_zqr_convs = nn.ModuleList(nn.Conv2d(HIDDEN, 3 * HIDDEN, 3, padding=1) for _ in range(3))

    def forward(self, left: Tensor, right: Tensor, *, initial: Tensor | None = None) -> Tensor:
        """Disparity of the left image.

        Args:
            left: RGB images of 0..255, float, (B, 3, H, W), H and W multiples of 32.
            right: the right images of the rectified pairs, same shape.
            initial: a first disparity to start from, (B, 1, H / 4, W / 4), in quarter-resolution
                pixels; without it the cost volume gives one.

        Returns:
            (B, H, W) float32, in pixels: left pixel x matches right pixel x - d. Values are those of
            the network and are not clamped at zero.

        Raises:
            InputError: shapes other than these.
        """
        encoded = self.encode(left, right, initial)
        # Only the last step is brought to full resolution.
        disparity, mask = deque(self._refinements(encoded), maxlen=1).pop()
        return self._upsample(encoded, disparity, mask)

    def trace(self, left: Tensor, right: Tensor, *, initial: Tensor | None = None) -> RefinementTrace:
        """Like ``forward``, but with the first disparity and the one after every iteration."""
        encoded = self.encode(left, right, initial)
        steps = [self._upsample(encoded, *refined) for refined in self._refinements(encoded)]
        return RefinementTrace(encoded.initial, tuple(steps))

    def encode(self, left: Tensor, right: Tensor, initial: Tensor | None = None) -> Encoded:
        """Everything before the recurrence; arguments as in ``forward``."""
        _check(left, right, initial)
        with self._precision(left):
            left, right = _normalised(left), _normalised(right)
            left_features, right_features = self.feature(torch.cat([left, right])).halves()
            volume = self._filtered_volume(left_features, right_features)
            if initial is None:
                initial = soft_argmin(self.classifier(volume))
            hidden, context = zip(*self.cnet(left, left_features.monocular), strict=True)
            context = tuple(self._gated(x) for x in context)
            lookup = GeometryLookup(volume, left_features.quarter, right_features.quarter, self.low_memory)
            return Encoded(
                lookup=lookup,
                initial=initial.float(),
                hidden=_scales(x.tanh() for x in hidden),
                context=_scales(context),
                attention=_scales(self.sam(x) for x in context),
                stem=self.stem_2(left),
            )

    def _filtered_volume(self, left: Features, right: Features) -> Tensor:
        volume = hybrid_volume(
            left.quarter,
            right.quarter,
            self.proj_cmb(left.quarter),
            self.proj_cmb(right.quarter),
            self.disparities,
        )
        volume = self.corr_feature_att(self.corr_stem(volume), left.quarter)
        filtered: Tensor = self.cost_agg(volume, left)
        return filtered

    def _gated(self, context: Tensor) -> Tensor:
        context = torch.relu(context)
        gated: Tensor = self.cam(context) * context
        return gated

    def _refinements(self, encoded: Encoded) -> Iterator[tuple[Tensor, Tensor]]:
        """Disparity (B, 1, h, w) in quarter-resolution pixels, and mask, after every iteration."""
        hidden, disparity = encoded.hidden, encoded.initial
        for _ in range(self.iterations):
            evidence = encoded.lookup(disparity)
            with self._precision(disparity):
                update = self.update_block(hidden, encoded.context, encoded.attention, evidence, disparity)
            # Summed in full precision: half has steps of 1/16 from 64 on.
            hidden, disparity = update.hidden, disparity + update.step.float()
            yield disparity, update.mask

    def _upsample(self, encoded: Encoded, disparity: Tensor, mask: Tensor) -> Tensor:
        with self._precision(mask):
            logits = self.spx_gru(self.spx_2_gru(mask, encoded.stem))
        return convex_upsample(disparity, logits).squeeze(1)

    def _precision(self, x: Tensor) -> AbstractContextManager[object]:
        if self.mixed_precision and x.is_cuda:
            return torch.autocast("cuda", dtype=torch.float16)
        return nullcontext()


def _normalised(images: Tensor) -> Tensor:
    mean, std = (images.new_tensor(v).view(1, 3, 1, 1) for v in (IMAGENET_MEAN, IMAGENET_STD))
    return (images / 255.0 - mean) / std


def _scales(maps: Iterable[Tensor]) -> Scales:
    quarter, eighth, sixteenth = maps
    return quarter, eighth, sixteenth


def _check(left: Tensor, right: Tensor, initial: Tensor | None) -> None:
    shape = tuple(left.shape)
    if shape != tuple(right.shape) or len(shape) != 4 or shape[1] != 3:
        raise InputError(
            f"left and right must both be (B, 3, H, W), found {shape} and {tuple(right.shape)}: "
            "give batches of the two images of rectified pairs"
        )
    batch, _, height, width = shape
    if height % MULTIPLE or width % MULTIPLE or not height or not width:
        raise InputError(
            f"images are {height} x {width}, expected height and width to be multiples of {MULTIPLE}: "
            "pad them as the architecture's InputConvention does"
        )
    expected = (batch, 1, height // FACTOR, width // FACTOR)
    if initial is not None and tuple(initial.shape) != expected:
        raise InputError(
            f"initial is {tuple(initial.shape)}, expected {expected}: "
            "give a disparity in pixels of a quarter of the image's resolution"
        )
