"""Geometry lookup: what the volume and the feature correlation say around the current disparity.

Paper section 3.3. Two levels are read, each at the nine offsets -4..4: level 0 in steps of one
quarter-resolution pixel, level 1 in steps of two, where a value is the mean of two neighbours.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch
from torch import Tensor

from sfkit.architectures.foundation_stereo.aggregation import FILTERED
from sfkit.architectures.foundation_stereo.cost_volume import cosine_rows

LEVELS = 2
RADIUS = 4
OFFSETS = 2 * RADIUS + 1
LOOKUP_CHANNELS = LEVELS * OFFSETS * (FILTERED + 1)

STRIP_ENTRIES = 1 << 22  # of the correlation table of one strip of rows, in low-memory mode


def sample_around(signal: Tensor, position: Tensor, level: int) -> Tensor:
    """A signal at nine places around a position, by linear interpolation, zero outside.

    Offsets are whole steps, so the nine places share one fractional part: ten neighbouring entries
    are read and blended pairwise. Level 1 reads twenty and averages them in twos, so no coarser copy
    of the signal is kept.

    Args:
        signal: (B, C, N, h, w), a signal of N entries (even) a pixel and channel.
        position: (B, 1, h, w), in entries of the signal; any real number.
        level: 0 or 1; entries of level l are means of 2**l entries.

    Returns:
        (B, C, 9, h, w): the signal of that level at position / 2**level + (-4..4).
    """
    count, span = OFFSETS + 1, 2**level
    scaled = position / span
    floor = scaled.floor()
    first = (floor.long() - RADIUS) * span
    steps = torch.arange(count * span, device=signal.device)
    index = first[:, :, None] + steps[:, None, None]
    inside = (index >= 0) & (index < signal.shape[2])
    # Read inside and blanked below: a gather from outside is an error.
    index = index.clamp(0, signal.shape[2] - 1).expand(-1, signal.shape[1], -1, -1, -1)
    entries = torch.where(inside, signal.gather(2, index), 0.0)
    # Coarser levels average neighbours where they are read: no pooled copy of the volume is kept.
    if level:
        entries = torch.unflatten(entries, 2, (count, span)).mean(dim=3)
    return torch.lerp(entries[:, :, :-1], entries[:, :, 1:], (scaled - floor)[:, :, None])


class GeometryLookup:
    """The filtered volume and the all-pairs correlation of one image pair, ready to be read.

    With ``low_memory`` the correlation of every left pixel with every right pixel of its row is not
    stored (4 h w**2 bytes) but computed again, strip by strip of rows, at every lookup; the numbers
    are the same.
    """

    def __init__(self, volume: Tensor, left: Tensor, right: Tensor, low_memory: bool = False) -> None:
        """Volume (B, 28, D, h, w) and the features of both images (B, C, h, w); all are read as float32."""
        self._volume = volume.float()
        self._left, self._right = left.float(), right.float()
        self._pairs = None if low_memory else cosine_rows(self._left, self._right)

    def __call__(self, disparity: Tensor) -> Tensor:
        """Evidence around a disparity.

        Args:
            disparity: (B, 1, h, w) in quarter-resolution pixels.

        Returns:
            (B, 522, h, w): for each level the 28 volume channels at nine offsets, then the
            correlation at nine offsets.
        """
        columns = torch.arange(disparity.shape[-1], dtype=disparity.dtype, device=disparity.device)
        matched = columns - disparity
        parts = []
        for level, correlation in enumerate(self._correlation(matched)):
            parts.append(sample_around(self._volume, disparity, level).flatten(1, 2))
            parts.append(correlation)
        return torch.cat(parts, dim=1)

    def _correlation(self, matched: Tensor) -> list[Tensor]:
        """For each level, (B, 9, h, w): left (y, x) against right (y, matched + offsets)."""
        strips = [
            [
                sample_around(pairs.permute(0, 3, 1, 2)[:, None], matched[:, :, rows], level)[:, 0]
                for level in range(LEVELS)
            ]
            for rows, pairs in self._tables()
        ]
        return [torch.cat(level, dim=2) for level in zip(*strips, strict=True)]

    def _tables(self) -> Iterator[tuple[slice, Tensor]]:
        if self._pairs is not None:
            yield slice(None), self._pairs
            return
        batch, _, height, width = self._left.shape
        # As many rows as the table of a strip has room for.
        strip = max(1, STRIP_ENTRIES // (batch * width**2))
        for start in range(0, height, strip):
            rows = slice(start, start + strip)
            yield rows, cosine_rows(self._left[:, :, rows], self._right[:, :, rows])
