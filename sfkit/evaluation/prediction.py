"""Prediction: disparity of pairs without ground truth, and pictures of it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from sfkit.colours import SHARE, paint, painted_disparity, range_of

if TYPE_CHECKING:
    from sfkit.merging.network import LoadedNetwork

Image = NDArray[np.uint8]
Map = NDArray[np.float32]


def predict(model: LoadedNetwork, left: Image, right: Image) -> Map:
    """Disparity (H, W) in pixels of the left image, from two (H, W, 3) RGB uint8 images."""
    return predict_together(model, [(left, right)])[0]


def predict_together(model: LoadedNetwork, pairs: Sequence[tuple[Image, Image]]) -> list[Map]:
    """Disparities (H, W) in pixels, on the CPU, of pairs of one size that go through the network at once."""
    import torch  # here: pictures and plans of predictions do without

    # A network without parameters runs on the CPU.
    device = next((tensor.device for tensor in model.network.parameters()), torch.device("cpu"))
    prepared = [model.inputs.prepare(left, right) for left, right in pairs]
    left, right = (
        model.mode.place(torch.cat([getattr(pair, side) for pair in prepared]), device)
        for side in ("left", "right")
    )
    with torch.inference_mode(), model.mode.computing(device):
        output = model.network(left, right)
        maps = output.reshape(len(pairs), *output.shape[-2:]).float().cpu()
    # Copies: a view would keep the padded maps of the whole batch alive.
    return [pair.window.crop(map_).numpy().copy() for pair, map_ in zip(prepared, maps, strict=True)]


def of_right(model: LoadedNetwork, left: Image, right: Image) -> Map:
    """Disparity (H, W) of the right view: the mirrored pair has its cameras in order again."""
    mirrored = (np.ascontiguousarray(image[:, ::-1]) for image in (right, left))
    return np.ascontiguousarray(predict(model, *mirrored)[:, ::-1])


def preview_of(disparity: Map, limits: tuple[float, float] | None = None) -> Image:
    """A picture (H, W, 3) in RGB, hatched where values are not finite.

    Args:
        disparity: (H, W) in pixels.
        limits: disparities at the ends of the colours; without, the 1st and the 99th percentile.
    """
    return painted_disparity(disparity, limits or range_of(disparity))


def overview_of(
    left: Image, disparity: Map, confidence: Map | None = None, limits: tuple[float, float] | None = None
) -> Image:
    """Left image, disparity and, where there is one, confidence (0 to 1) side by side: (H, 2 W or 3 W, 3)."""
    panels = [left, preview_of(disparity, limits)]
    if confidence is not None:
        panels.append(paint(confidence, (0.0, 1.0), SHARE))
    return np.hstack(panels)
