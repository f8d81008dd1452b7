"""Does a loaded pair make sense: its images, its ground truth, and whether the two fit together."""

from __future__ import annotations

import numpy as np

from sfkit.datasets.order import compare_orders
from sfkit.datasets.pairs import Sample
from sfkit.datasets.photometric import PIXELS, check_ground_truth

OUTSIDE_SHARE = 0.3  # of the ground truth; correct pairs lie below 0.15


def problems(sample: Sample, *, labelled: bool = True) -> tuple[str, ...]:
    """What makes a pair useless, one sentence each; ``labelled`` says whether it should have ground truth."""
    known = np.isfinite(sample.disparity)
    found = []
    if labelled and not known.any():
        found.append("no ground truth is finite and positive; check the file and its coding")
    flat = [
        f"the {side} image is one flat colour; check the file"
        for side, image in (("left", sample.left), ("right", sample.right))
        if (image == image[:1, :1]).all()
    ]
    found += flat
    # Two flat images are equal as well, and were told of already.
    if not flat and np.array_equal(sample.left, sample.right):
        found.append("left and right are the same image; give the two views of the pair")
    if known.any() and (share := float((sample.disparity[known] > sample.size[1]).mean())) > 0:
        found.append(
            f"{100 * share:.1f} % of the disparities exceed the image's width of {sample.size[1]} px; "
            "check the coding and its scale"
        )
    return tuple(found)


def unexplained(sample: Sample) -> tuple[str, ...]:
    """Whether the ground truth says anything about the images at all, which a closer look takes; at most one
    sentence.
    """
    if not np.isfinite(sample.disparity).any() or np.array_equal(sample.left, sample.right):
        return ()
    found = check_ground_truth(sample.left, sample.right, sample.disparity).unexplained
    return (found,) if found else ()


def warnings(sample: Sample, pixels: int = PIXELS) -> tuple[str, ...]:
    """What looks wrong but need not be, one sentence each; ``pixels`` at most are compared in the images."""
    found: list[str] = []
    known = np.isfinite(sample.disparity)
    if known.any() and not np.array_equal(sample.left, sample.right):
        seen = check_ground_truth(sample.left, sample.right, sample.disparity, pixels=pixels)
        found += [seen.doubt] if seen.doubt else []
    # Without ground truth the images themselves are all that can tell.
    if not known.any() and not np.array_equal(sample.left, sample.right):
        seen_order = compare_orders(sample.left, sample.right).doubt
        found += [seen_order] if seen_order else []
    # A match lies d to the left: beyond column d it is outside, as few points of a right scale are.
    columns = np.broadcast_to(np.arange(sample.size[1]), sample.size)
    if known.any() and (outside := float((sample.disparity > columns)[known].mean())) > OUTSIDE_SHARE:
        found.append(
            f"{100 * outside:.0f} % of the ground truth points outside the right image; "
            "check the scale in its coding"
        )
    if sample.nonoccluded is not None and known.any() and not (sample.nonoccluded & known).any():
        found.append("the mask calls every pixel with ground truth occluded; check that 255 means visible")
    return tuple(found)
