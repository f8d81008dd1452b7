"""DisparityCompare on paper: the pair and its networks' maps, as they are shown."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from sfkit.analysis.differences import advantage
from sfkit.analysis.disparities import DisparityPanels, NetworkMaps
from sfkit.analysis.labels import score_text
from sfkit.colours import DISPARITY, ERROR, paint, painted_disparity, painted_error, picked, shrunk
from sfkit.figures.differences import ADVANTAGE_SPAN
from sfkit_widgets._sheet import MARGIN, MUTED, Sheet
from sfkit_widgets._still_sheets import INNER, pictures

LONGEST = 480  # pixels of a picture

Picture = NDArray[np.uint8]


def compare_sheet(panels: DisparityPanels, shown: str, first: str) -> Sheet:
    """Left image, ground truth or right image, and each network.

    Args:
        panels: the pair.
        shown: ``disparity``, ``error`` or ``better``.
        first: name of the network that others are compared to.
    """
    sheet = Sheet(f"Networks on pair {panels.pair} of {panels.benchmark}")
    (low, high), kind = panels.limits, panels.kind
    words = (
        f"disparity {low:g} to {high:g} px, dark to light; {kind.name}: blue below {panels.threshold:g} "
        f"{kind.unit}, orange beyond; hatched: {panels.hatched}"
    )
    sheet.text(MARGIN, sheet.y + 12, words, size=12, colour=MUTED, room=INNER)
    sheet.y += 20
    seen = [("left image", shrunk(panels.left, LONGEST)), _second(panels)]
    seen += [_network(panels, network, shown, first) for network in panels.networks]
    coded = [(caption, _coded(picture)) for caption, picture in seen]
    pictures(sheet, coded, panels.truth.shape, columns=3 if len(seen) > 4 else 2)
    return sheet


def _second(panels: DisparityPanels) -> tuple[str, Picture]:
    if panels.right is not None:
        return "right image", shrunk(panels.right, LONGEST)
    return "ground truth", paint(picked(panels.truth, LONGEST), panels.limits, DISPARITY)


def _network(panels: DisparityPanels, network: NetworkMaps, shown: str, first: str) -> tuple[str, Picture]:
    scores = ", ".join(score_text(metric, score) for metric, score in network.scores.items())
    if shown == "disparity":
        seen = painted_disparity(picked(network.disparity, LONGEST), panels.limits)
        return f"{network.name}: {scores}", seen
    reference = next(other for other in panels.networks if other.name == first)
    both = ~(np.isnan(reference.error) | np.isnan(network.error))
    if shown == "better" and network is not reference and both.any():
        found = advantage(reference.error, network.error, panels.threshold)
        span = ADVANTAGE_SPAN * panels.threshold
        caption = f"{network.name}: blue where better than {first}"
        return caption, paint(picked(found.difference, LONGEST), (-span, span), ERROR)
    caption = f"{network.name}, {panels.kind.name}: {scores}"
    return caption, painted_error(picked(network.error, LONGEST), panels.threshold)


def _coded(image: Picture) -> bytes:
    done, data = cv2.imencode(".jpg", np.ascontiguousarray(image[..., ::-1]))
    if not done:
        raise ValueError(f"an image of {image.shape} cannot be coded as JPEG")
    return np.asarray(data).tobytes()
