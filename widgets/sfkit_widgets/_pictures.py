"""Maps of pixels as pictures for the browser, in the figures' colours and quick enough to follow a drag."""

from __future__ import annotations

from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sfkit.colours import (
    DISPARITY,
    ERROR,
    ERROR_SPAN,
    SHARE,
    Stops,
    colour_at,
    painted_disparity,
    painted_error,
    picked,
    share_position,
    shrunk,
    text_on,
)

PICTURE = NDArray[np.uint8]

LONGEST = 960
"""Pixels of a picture's longest side; larger maps lose rows and columns."""

MIME = "image/jpeg"
_QUALITY = 88
_SHADES = 101


def photograph(image: PICTURE) -> bytes:
    """An RGB image (H, W, 3) as JPEG."""
    return _coded(shrunk(image, LONGEST)[..., ::-1])


def disparity_picture(disparity: NDArray[np.floating[Any]], limits: tuple[float, float]) -> bytes:
    """A disparity map (H, W) in pixels as JPEG; what is not finite is hatched grey."""
    return _coded(painted_disparity(picked(disparity, LONGEST), limits)[..., ::-1])


def error_picture(error: NDArray[np.floating[Any]], threshold: float) -> bytes:
    """An error or residual map (H, W) as JPEG: blue below the threshold, orange beyond, hatch: no value."""
    return _coded(painted_error(picked(error, LONGEST), threshold)[..., ::-1])


def disparity_legend(limits: tuple[float, float]) -> dict[str, Any]:
    """The colour key of a disparity map: stops from low to high, and what its ticks say."""
    low, high = limits
    return {"stops": _css(DISPARITY), "ticks": [f"≤ {low:g}", f"{(low + high) / 2:g}", f"≥ {high:g} px"]}


def error_legend(threshold: float, unit: str) -> dict[str, Any]:
    """The colour key of an error or residual map, its threshold in the middle."""
    low, high = (threshold * 2.0**octave for octave in (-ERROR_SPAN, ERROR_SPAN))
    return {"stops": _css(ERROR), "ticks": [f"≤ {low:.3g}", f"{threshold:g}", f"≥ {high:g} {unit}"]}


def share_colours() -> list[list[str]]:
    """Background and text colour of the weights 0, 0.01, ..., 1."""
    colours = [colour_at(SHARE, share_position(step / (_SHADES - 1))) for step in range(_SHADES)]
    return [[f"rgb({r},{g},{b})", text_on((r, g, b))] for r, g, b in colours]


def _css(stops: Stops) -> list[str]:
    return [f"rgb({r},{g},{b})" for r, g, b in stops]


def _coded(picture: PICTURE) -> bytes:
    """A BGR picture as JPEG that keeps colours at full resolution: edges of errors are thin."""
    options = [
        cv2.IMWRITE_JPEG_QUALITY,
        _QUALITY,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR,
        cv2.IMWRITE_JPEG_SAMPLING_FACTOR_444,
    ]
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(picture), options)
    if not done:
        raise ValueError(f"a picture of {picture.shape} cannot be coded as JPEG")
    return np.asarray(data).tobytes()
