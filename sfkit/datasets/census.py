"""``census``: how well a disparity map explains its pair, without any ground truth.

The right image, resampled by the predicted disparity, must look like the left one. What is compared is the
census transform (Zabih and Woodfill, ECCV 1994): of each pixel, whether its neighbours are brighter than
itself; exposure, contrast and vignetting leave that order alone. The score is the percent of differing bits,
the mean over two scales, over pixels whose match lies inside the right image:

1. both images smoothed by a Gaussian of 1.2 px;
2. smoothed by 3 px, every second pixel: haze and sensor noise mislead the fine scale alone.

A pixel's 5 x 5 window has 24 neighbours, of which half are compared: the other half asks the same questions
from the other end. What was tried before this became the definition is in docs/results.md.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

from sfkit.datasets.metric import Count, Map, Mask, Metric, Ratio, register_metric
from sfkit.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    import torch
    from numpy.typing import NDArray

    from sfkit.datasets.pairs import Sample

CHANCE = 50.0  # percent of bits by which unrelated images differ: the worst a map can do


@dataclass(frozen=True)
class CensusScale:
    """One scale of the comparison.

    Attributes:
        sigma: of the Gaussian that smooths both images, in pixels; 0 leaves them.
        step: every so many pixels of rows and columns are kept, after smoothing.
        window: height and width of the neighbourhood, odd, in pixels that were kept.
    """

    sigma: float
    step: int = 1
    window: tuple[int, int] = (5, 5)

    @property
    def offsets(self) -> list[tuple[int, int]]:
        """One of each two opposite neighbours, as (rows, columns)."""
        high, wide = (side // 2 for side in self.window)
        every = [(dy, dx) for dy in range(-high, high + 1) for dx in range(-wide, wide + 1)]
        # One of each two opposite neighbours: the other compares the same two pixels from its own centre.
        return every[len(every) // 2 + 1 :]

    @property
    def margin(self) -> int:
        """Kept pixels at the image's border without a whole window."""
        return max(self.window) // 2


SCALES = (CensusScale(1.2), CensusScale(3.0, step=2))


@dataclass(frozen=True)
class Residual:
    """How one disparity map explains its pair.

    Attributes:
        score: percent of differing bits, the mean over the scales; 50 where nothing could be compared.
        inside: share of pixels whose match lies inside the right image.
    """

    score: float
    inside: float


@dataclass(frozen=True)
class _Level:
    """A pair at one scale; grey values of both images, the left one's bits."""

    scale: CensusScale
    right: torch.Tensor
    bits: tuple[torch.Tensor, ...]


class CensusTarget:
    """A pair made ready to be compared along any number of disparity maps.

    Args:
        left: (H, W, 3) RGB uint8.
        right: the same of the right image.
        scales: at which images are compared; their residuals are averaged.
        device: where to compute.

    Raises:
        InputError: an image smaller than a window.
    """

    def __init__(
        self,
        left: NDArray[np.uint8],
        right: NDArray[np.uint8],
        *,
        scales: Sequence[CensusScale] = SCALES,
        device: torch.device | str = "cpu",
    ) -> None:
        import torch

        self.size = left.shape[:2]
        self.device = torch.device(device)
        # The coarsest scale needs the most room.
        least = max(scale.step * max(scale.window) for scale in scales)
        if min(self.size) < least:
            raise InputError(
                f"census: found an image of {self.size[1]}x{self.size[0]} pixels, expected at least "
                f"{least} of them each way"
            )
        self._levels = tuple(self._level(left, right, scale) for scale in scales)

    def residual(self, disparity: Map | torch.Tensor) -> Residual:
        """The score of a map (H, W) in pixels; one that is not finite everywhere scores as chance does.

        Raises:
            InputError: the map has another size than the images.
        """
        import torch

        map_ = self._tensor(disparity)
        # A finite sum has finite terms only; asking each takes an eighth of the whole on a CPU.
        if not bool(torch.isfinite(map_.sum())) and not bool(torch.isfinite(map_).all()):
            return Residual(CHANCE, 0.0)
        shares, inside = [], 0.0
        for level in self._levels:
            differing, seen = self._differing(level, map_)
            count = int(seen.sum())
            # Whole numbers: the sum is the same on every device and number of threads.
            total = int(differing.mul_(seen).sum(dtype=torch.int64))
            shares.append(100.0 * total / (count * len(level.bits)) if count else CHANCE)
            # Of the finest scale: it says the most exactly which pixels leave the image.
            inside = inside or count / seen.numel()
        return Residual(math.fsum(shares) / len(shares), inside)

    def map(self, disparity: Map | torch.Tensor) -> NDArray[np.float32]:
        """Percent of differing bits (H, W), the mean over the scales; NaN where a match lies outside, at the
        border, and where the map is not finite.
        """
        import torch
        import torch.nn.functional as F

        map_ = self._tensor(disparity)
        finite = torch.isfinite(map_)
        # A pixel without a value is dropped at the end; NaN is no column to gather.
        held = torch.where(finite, map_, torch.zeros_like(map_))
        parts = []
        for level in self._levels:
            differing, seen = self._differing(level, held)
            percent = 100.0 * differing / len(level.bits)
            percent = torch.where(seen, percent, torch.full_like(percent, torch.nan))
            margin, step = level.scale.margin, level.scale.step
            # The border, where no window fits, has no value.
            whole = F.pad(percent, (margin,) * 4, value=torch.nan)
            # A pixel that was kept stands for a square of its step.
            whole = whole.repeat_interleave(step, 0).repeat_interleave(step, 1)
            parts.append(whole[: self.size[0], : self.size[1]])
        mean = torch.stack(parts).mean(dim=0)
        result: NDArray[np.float32] = torch.where(finite, mean, torch.nan).float().cpu().numpy()
        return result

    @cached_property
    def texture(self) -> float:
        """Share of pixels whose neighbourhood in the left image spreads over more than 4 grey levels."""
        return float((self._spread > TEXTURE).float().mean())

    def _tensor(self, disparity: Map | torch.Tensor) -> torch.Tensor:
        import torch

        map_ = torch.as_tensor(disparity, dtype=torch.float32).to(self.device)
        if tuple(map_.shape) != self.size:
            raise InputError(
                f"census: found a map of shape {tuple(map_.shape)}, expected {self.size} as the images"
            )
        return map_

    def _level(self, left: NDArray[np.uint8], right: NDArray[np.uint8], scale: CensusScale) -> _Level:
        import torch.nn.functional as F

        first, second = (_smoothed(_grey(image, self.device), scale) for image in (left, right))
        # Texture is asked of the finest of the usual scales, whatever others stand before it.
        if scale == SCALES[0] or not hasattr(self, "_spread"):
            # Brightest less darkest within 5 x 5 pixels.
            high = F.max_pool2d(first[None, None], 5, 1)
            low = -F.max_pool2d(-first[None, None], 5, 1)
            self._spread = (high - low)[0, 0]
        return _Level(scale, second, tuple(_bits(first, scale)))

    def _differing(self, level: _Level, disparity: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """How many bits differ (h, w), and where the match lies inside the right image."""
        import torch

        step, margin = level.scale.step, level.scale.margin
        # Every step-th pixel of a coarser image: disparities there are that much smaller.
        warped, inside = _warped(level.right, disparity[::step, ::step] / step)
        # A dozen bits: a byte counts them.
        count = torch.zeros_like(level.bits[0], dtype=torch.uint8)
        # One neighbour at a time: all at once take twelve times the memory.
        for ours, theirs in zip(level.bits, _bits(warped, level.scale), strict=True):
            count += ours.not_equal(theirs)
        return count, inside[margin:-margin, margin:-margin]


TEXTURE = 4.0  # grey levels within 5 x 5 pixels, after smoothing; sensor noise alone stays below


def _grey(image: NDArray[np.uint8], device: torch.device) -> torch.Tensor:
    import torch

    return torch.from_numpy(image.mean(axis=2, dtype="float32")).to(device)


def _smoothed(image: torch.Tensor, scale: CensusScale) -> torch.Tensor:
    """Smoothed by a Gaussian, borders repeated, every ``step``-th pixel kept."""
    import torch
    import torch.nn.functional as F

    if scale.sigma > 0:
        # Beyond three sigmas a Gaussian has next to no weight.
        reach = math.ceil(3 * scale.sigma)
        x = torch.arange(-reach, reach + 1, dtype=torch.float32, device=image.device)
        kernel = torch.exp(-(x**2) / (2 * scale.sigma**2))
        kernel /= kernel.sum()
        padded = F.pad(image[None, None], (reach,) * 4, mode="replicate")
        # A Gaussian is separable: two passes of 2 r + 1 weights, not one of their square.
        rows = F.conv2d(padded, kernel.view(1, 1, 1, -1))
        image = F.conv2d(rows, kernel.view(1, 1, -1, 1))[0, 0]
    return image[:: scale.step, :: scale.step].contiguous()


def _warped(right: torch.Tensor, disparity: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
    """The right image at (x - d), linear between pixels, and where that lies inside it."""
    import torch

    last = right.shape[1] - 1
    wanted = torch.arange(last + 1, dtype=torch.float32, device=right.device) - disparity
    match = wanted.clamp(0, last)
    # What clamping leaves alone lies inside: one comparison, where both ends would take three steps.
    inside = match == wanted
    # One column short of the last, so that there is always a next one to interpolate with.
    whole = match.floor().clamp_(max=last - 1)
    part = match.sub_(whole)
    column = whole.long()
    near = right.gather(1, column)
    return right[:, 1:].gather(1, column).sub_(near).mul_(part).add_(near), inside


def _bits(image: torch.Tensor, scale: CensusScale) -> Iterator[torch.Tensor]:
    """Whether each neighbour is brighter, (h, w) bool each, of pixels with a whole window."""
    margin, (height, width) = scale.margin, image.shape
    centre = image[margin : height - margin, margin : width - margin]
    for dy, dx in scale.offsets:
        yield image[margin + dy : height - margin + dy, margin + dx : width - margin + dx] > centre


def _recorder(sample: Sample, valid: Mask, device: str) -> Count:
    """Counts one pair's predictions; the mask plays no part, since no ground truth does.

    On a GPU of CUDA it counts there; Metal's queue is not for the second thread that counts.
    """
    target = CensusTarget(sample.left, sample.right, device=device if "cuda" in device else "cpu")

    def count(prediction: NDArray[np.floating[Any]]) -> Ratio:
        return target.residual(prediction).score, 1.0

    return count


CENSUS = register_metric(
    Metric(
        "census",
        of="census bits",
        pools=False,
        needs_truth=False,
        recorder=_recorder,
        on_device=True,
    )
)
"""Percent of differing census bits between the left image and the right one warped by the prediction."""
