"""The three published sizes of FoundationStereo; only the monocular branch differs in size."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class VitSize:
    """Widths and depths of one Depth-Anything-V2 branch.

    Attributes:
        width: channels of a ViT token.
        depth: number of transformer layers.
        heads: attention heads, each of 64 channels.
        taps: the four layers (counted from 0) whose output the dense-prediction head reads.
        head_width: channels inside the dense-prediction head.
        tap_channels: channels of the four taps after their projection.
    """

    width: int
    depth: int
    heads: int
    taps: tuple[int, int, int, int]
    head_width: int
    tap_channels: tuple[int, int, int, int]

    @property
    def out_channels(self) -> int:
        """Channels of the map that the branch hands to the feature and context networks."""
        return self.head_width // 2


SIZES: dict[str, VitSize] = {
    "vits": VitSize(384, 12, 6, (2, 5, 8, 11), 64, (48, 96, 192, 384)),
    "vitb": VitSize(768, 12, 12, (2, 5, 8, 11), 128, (96, 192, 384, 768)),
    "vitl": VitSize(1024, 24, 16, (4, 11, 17, 23), 256, (256, 512, 1024, 1024)),
}
