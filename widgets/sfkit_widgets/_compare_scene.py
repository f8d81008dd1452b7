"""One pair with all its networks, as DisparityCompare carries it to the browser."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from sfkit.analysis.differences import OutlierRegion, advantage, outlier_regions
from sfkit.analysis.disparities import DisparityPanels, NetworkMaps
from sfkit.analysis.labels import score_text
from sfkit.analysis.pair_maps import Map
from sfkit.colours import DISPARITY, ERROR, ERROR_SPAN, hatch, lookup
from sfkit.figures.differences import ADVANTAGE_SPAN

NO_VALUE, NOT_FINITE = 0, 65535
LOWEST, HIGHEST = 1, 65534
NO_RESIDUAL, RESIDUAL_NOT_FINITE, RESIDUAL_STEPS = 255, 254, 2.5  # codes; steps of a percent
REACH = 256.0  # pixels beyond the colour range; values further away are cut off, and shown as cut off
HATCH_SIDE = 8
PHOTOGRAPH_QUALITY = 90


@dataclass(frozen=True)
class MapCoding:
    """How disparities become 16-bit codes: pixels = offset + (code - 1) * step for codes 1 to 65534.

    Code 0 is no value (no ground truth that counts), code 65535 a prediction that is not finite. Values
    beyond either end take the end's code. All maps of a pair share one coding, so that the difference
    of two codes times ``step`` is a difference in pixels.
    """

    offset: float
    step: float
    below: bool = False  # whether code 1 also stands for lower values
    above: bool = False  # whether code 65534 also stands for higher values

    @classmethod
    def of(cls, panels: DisparityPanels) -> MapCoding:
        """As fine as the range of the values allows, whose ends are cut off at :data:`REACH`."""
        low, high = panels.limits
        maps = [panels.truth, *(network.disparity for network in panels.networks)]
        known = [map_[np.isfinite(map_)] for map_ in maps]
        bottom = min((float(values.min()) for values in known if values.size), default=low)
        top = max((float(values.max()) for values in known if values.size), default=high)
        offset = max(bottom, low - REACH)
        end = min(top, high + REACH)
        step = max(end - offset, high - low) / (HIGHEST - LOWEST)
        return cls(offset, step, below=bottom < offset, above=top > end)

    def codes(self, map_: Map, *, missing: int) -> NDArray[np.uint16]:
        """(H, W) codes of disparities in pixels; what is not finite becomes ``missing``."""
        finite = np.isfinite(map_)
        scaled = (np.where(finite, map_, self.offset).astype(np.float64) - self.offset) / self.step
        held = np.clip(np.rint(scaled) + LOWEST, LOWEST, HIGHEST)
        return np.where(finite, held, missing).astype("<u2")


def scene(panels: DisparityPanels) -> dict[str, Any]:
    """Everything a pair shows: pictures and maps as bytes, the rest plain JSON.

    Maps are (H, W) uint16 in little-endian order; see :class:`MapCoding`. Errors are differences of them.
    A pair without ground truth has ``right`` in place of ``truth``, and each network its ``residual`` map,
    (H, W) uint8: percent times 2.5, 254 where the prediction is not finite, 255 where there is no match.
    """
    coding = MapCoding.of(panels)
    height, width = panels.truth.shape
    return {
        "benchmark": panels.benchmark,
        "protocol": panels.protocol,
        "pair": panels.pair,
        "width": width,
        "height": height,
        "offset": coding.offset,
        "step": coding.step,
        "cut": [coding.below, coding.above],
        "limits": list(panels.limits),
        "threshold": panels.threshold,
        "kind": panels.kind.name,
        "unit": panels.kind.unit,
        "missing": panels.kind.missing,
        "left": _photograph(panels.left),
        "right": None if panels.right is None else _photograph(panels.right),
        "truth": coding.codes(panels.truth, missing=NO_VALUE).tobytes() if panels.right is None else None,
        "networks": [_network(panels, network, coding) for network in panels.networks],
    }


def palettes() -> dict[str, Any]:
    """The figures' colours: two maps of (256, 3) RGB bytes, a hatch of (8, 8, 3), and their spans."""
    return {
        "disparity": lookup(DISPARITY).tobytes(),
        "error": lookup(ERROR).tobytes(),
        "hatch": hatch(HATCH_SIDE, HATCH_SIDE).tobytes(),
        "errorSpan": ERROR_SPAN,
        "advantageSpan": ADVANTAGE_SPAN,
    }


def _network(panels: DisparityPanels, network: NetworkMaps, coding: MapCoding) -> dict[str, Any]:
    return {
        "name": network.name,
        "score": ", ".join(score_text(metric, score) for metric, score in network.scores.items()),
        "map": coding.codes(network.disparity, missing=NOT_FINITE).tobytes(),
        "residual": None if panels.right is None else residual_codes(network.error).tobytes(),
        "against": [_against(other.error, network.error, panels.threshold) for other in panels.networks],
        "regions": [_region(region) for region in outlier_regions(network.error, panels.threshold)],
    }


def residual_codes(residual: Map) -> NDArray[np.uint8]:
    """(H, W) codes of residuals in percent: 0 to 250, where not finite 254, where there is none 255."""
    finite = np.isfinite(residual)
    codes = np.rint(np.where(finite, residual, 0.0) * RESIDUAL_STEPS).astype(np.uint8)
    return np.where(finite, codes, np.where(np.isnan(residual), NO_RESIDUAL, RESIDUAL_NOT_FINITE)).astype(
        np.uint8
    )


def _against(reference: Map, network: Map, threshold: float) -> dict[str, float | None]:
    """What a network fixes and breaks; None where no pixel counts in both."""
    if (np.isnan(reference) | np.isnan(network)).all():
        return {"fixed": None, "broken": None}
    found = advantage(reference, network, threshold)
    return {"fixed": found.fixed, "broken": found.broken}


def _region(region: OutlierRegion) -> dict[str, Any]:
    """A region as JSON has it: None where an error is infinite."""
    values = {**asdict(region), "peak": list(region.peak)}
    return {
        name: None if isinstance(value, float) and not math.isfinite(value) else value
        for name, value in values.items()
    }


def _photograph(image: NDArray[np.uint8]) -> bytes:
    options = [cv2.IMWRITE_JPEG_QUALITY, PHOTOGRAPH_QUALITY]
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(image[..., ::-1]), options)
    if not done:
        raise ValueError(f"an image of {image.shape} cannot be coded as JPEG")
    return np.asarray(data).tobytes()
