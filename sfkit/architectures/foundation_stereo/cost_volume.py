"""The hybrid cost volume: group-wise correlation beside the two images' own features (paper section 3.2).

Entry (y, x, d) pairs left pixel x with right pixel x - d; d counts pixels of the quarter-resolution grid.
Where x - d lies outside the image, whatever would come from the right image is zero.
"""

from __future__ import annotations

import torch
import torch.nn.functional as F
from torch import Tensor

GROUPS = 8
PROJECTED = 12  # channels that each image adds beside the correlations
VOLUME_CHANNELS = GROUPS + 2 * PROJECTED


def cosine_rows(left: Tensor, right: Tensor) -> Tensor:
    """Cosine similarity of every left pixel with every right pixel of its row, in [-1, 1], float32.

    Args:
        left: features (B, C, h, w).
        right: features (B, C, h, w').

    Returns:
        (B, h, w, w'): entry [b, y, x, x'] pairs left (y, x) with right (y, x').
    """
    with torch.autocast(left.device.type, enabled=False):
        unit_left = F.normalize(left.float(), dim=1).permute(0, 2, 3, 1)
        unit_right = F.normalize(right.float(), dim=1).permute(0, 2, 1, 3)
        return unit_left @ unit_right


def correlation_by_disparity(left: Tensor, right: Tensor, disparities: int) -> Tensor:
    """Cosine similarity of left (y, x) with right (y, x - d), (B, D, h, w); zero where x < d.

    All pairs of a row come from one matrix product; a skewed view then reads its diagonals. With the
    right row mirrored and D - 1 empty pixels behind it, pair (x, x - d) lies at column w - 1 - x + d,
    which is one step ahead of row x's start for every d.
    """
    width = left.shape[-1]
    mirrored = F.pad(right.flip(-1), (0, disparities - 1))
    pairs = cosine_rows(left, mirrored)
    batch, height, _, columns = pairs.shape
    # Read in rows one entry shorter, each row begins where its own pixel matches.
    skewed = pairs.flatten(2)[..., width - 1 : -1].view(batch, height, width, columns - 1)
    return skewed[..., :disparities].permute(0, 3, 1, 2)


def shift_by_disparity(right: Tensor, disparities: int) -> Tensor:
    """The right image at (y, x - d), as (B, C, h, D, w) from (B, C, h, w); zero where x < d."""
    return F.pad(right, (disparities - 1, 0)).unfold(-1, right.shape[-1], 1).flip(-2)


def hybrid_volume(
    left: Tensor, right: Tensor, left_projected: Tensor, right_projected: Tensor, disparities: int
) -> Tensor:
    """The volume that the aggregation filters.

    Args:
        left: features of the left image, (B, C, h, w), C a multiple of 8.
        right: features of the right image, same shape.
        left_projected: (B, 12, h, w), copied to every disparity, also where x < d.
        right_projected: (B, 12, h, w), shifted by the disparity.
        disparities: D, the number of candidate disparities; may exceed w.

    Returns:
        (B, 32, D, h, w): 8 correlations, 12 left channels, 12 right channels.
    """
    batch, _, height, width = left.shape
    volume = left_projected.new_empty(batch, VOLUME_CHANNELS, disparities, height, width)
    # one group at a time: the all-pairs table of one group is the largest intermediate
    groups = zip(left.chunk(GROUPS, dim=1), right.chunk(GROUPS, dim=1), strict=True)
    for index, (of_left, of_right) in enumerate(groups):
        volume[:, index] = correlation_by_disparity(of_left, of_right, disparities)
    volume[:, GROUPS : GROUPS + PROJECTED] = left_projected[:, :, None]
    volume[:, GROUPS + PROJECTED :] = shift_by_disparity(right_projected, disparities).transpose(2, 3)
    return volume
