"""Do a pair's images agree with its ground truth: wrong scale, sign, order and rectification by name.

At the right disparity a pixel's neighbourhood in the left image orders its grey values as that in the right
image does (the census transform, Zabih and Woodfill, ECCV 1994). So the residual along the ground truth as it
was read must beat the residuals of its other readings: scaled, negated, mirrored, upside down, with the two
bytes of its values swapped, with the images exchanged, with the right image a row off; and those a few pixels
beside it. What shifts it by less than a pixel, such as base 255 read as 256, cannot be told. Ground truth may
be as sparse as one likes: each pixel brings its own window of images.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfkit.errors import InputError

AS_READ = "as read"
RADIUS = 2  # of the census window, 5 x 5
PIXELS = 20_000  # of a pair at most; residuals are then known within 0.2 points
ENOUGH = 200  # pixels that two readings share; below, nothing is said
# Of eight real pairs of eight data sets every other reading of a scale, sign or order that shares enough
# pixels lies above 1.4 times the residual as read, a row up or down above 1.1 times.
CLEARLY = 0.9
CLEARLY_OFF_ROW = 0.95
EXPLAINS = 42.0  # percent; a reading above it explains the images no better than chance
# Of these pairs and 16 rendered ones sound truth lies below 0.90, noisy images included; swapped bytes above
# 0.97, random truth above 0.93 where it spans more than a few pixels. Of 124 pairs of `bank-sharp` five, grey
# and bare ones, are sound above 0.93, where 104 random truths lie as well: no limit spares the five and finds
# as many, neither on all pixels nor on the quarter of most contrast. The sentence says that such images may
# be to blame.
BESIDE = 0.93
CHANCE = 30.0  # percent; below, images are explained, or flat
POINTS = 1.5  # percentage points by which another reading must win; keeps textureless pairs from warning


@dataclass(frozen=True)
class Reading:
    """Another way to read a pair.

    Attributes:
        name: of the reading.
        scale: what the disparity is multiplied by.
        exchanged: whether the two images change places.
        rows: by how many rows the right image is shifted.
        flip: the axis along which the ground truth is turned around: 0 upside down, 1 mirrored.
        swapped: the divisor of 16-bit values whose two bytes are swapped; 0 for none.
        meaning: what is wrong, and what to do, should this reading explain the images better.
    """

    name: str
    scale: float = 1.0
    exchanged: bool = False
    rows: int = 0
    flip: int | None = None
    swapped: float = 0.0
    meaning: str = ""

    @property
    def limit(self) -> float:
        """A reading wins where its residual is below this share of the residual as read."""
        return CLEARLY_OFF_ROW if self.rows else CLEARLY


def _scaled(factor: float) -> Reading:
    word = f"{factor:g} times" if factor >= 1 else f"1/{1 / factor:g} of"
    inverse = f"divided by {factor:g}" if factor >= 1 else f"multiplied by {1 / factor:g}"
    return Reading(
        f"{word} the disparity",
        scale=factor,
        meaning=f"the disparities look wrongly scaled: {word} them fit the images better; "
        f"check the coding, whose divisor should be {inverse}",
    )


READINGS: tuple[Reading, ...] = (
    *(_scaled(factor) for factor in (2.0, 4.0, 8.0, 16.0, 256.0, 1 / 2, 1 / 4, 1 / 8, 1 / 16, 1 / 256)),
    Reading(
        "the negative disparity",
        scale=-1.0,
        meaning="left and right look exchanged, or the disparity's sign: the images match better the other "
        "way round; give the left camera's image as the left one, and positive disparities",
    ),
    Reading(
        "the images exchanged",
        exchanged=True,
        meaning="left and right look exchanged: the images match better the other way round, "
        "the ground truth belongs to the image given as the right one",
    ),
    *(
        Reading(
            f"the right image a row {'down' if rows > 0 else 'up'}",
            rows=rows,
            meaning=f"the images look badly rectified: they match better with the right one shifted {word}; "
            "rectify the pair again",
        )
        for rows, word in ((-1, "up by a row"), (1, "down by a row"))
    ),
    *(
        Reading(
            f"the ground truth {word}",
            flip=axis,
            meaning=f"the ground truth looks turned around: {word} it fits the images better; check in which "
            "order its rows and columns are stored",
        )
        for axis, word in ((0, "upside down"), (1, "mirrored"))
    ),
    *(
        Reading(
            f"the bytes of 16-bit values by {divisor} swapped",
            swapped=divisor,
            meaning="the two bytes of the 16-bit ground truth look swapped: exchanged they fit the images "
            "better; write it again in the byte order of its format",
        )
        for divisor in (256, 100)
    ),
)


@dataclass(frozen=True)
class Photometric:
    """Residuals of one pair under the readings of its ground truth.

    Attributes:
        residual: percent of differing census bits at the disparity as read; NaN without a pixel to compare.
        pixels: how many pixels it is over.
        others: by another reading's name, the pair (its residual, that as read) over the pixels whose
            match lies inside the image under both; readings with fewer than ``ENOUGH`` of these are left out.
        beside: the mean residual a few pixels to either side of the disparity, and that as read over the same
            pixels; NaN without enough of them.
    """

    residual: float
    pixels: int
    others: Mapping[str, tuple[float, float]]
    beside: tuple[float, float] = (float("nan"), float("nan"))

    @property
    def better(self) -> tuple[Reading, ...]:
        """Readings that explain the images clearly better than the ground truth as read, the best first."""
        found = [
            (theirs / ours, reading)
            for reading in READINGS
            if reading.name in self.others
            for theirs, ours in (self.others[reading.name],)
            if theirs < min(EXPLAINS, reading.limit * ours, ours - POINTS)
        ]
        return tuple(reading for _, reading in sorted(found, key=lambda item: item[0]))

    @property
    def doubt(self) -> str | None:
        """What is wrong by the best of the better readings, in one sentence; None where none is better."""
        if not self.better:
            return None
        best = self.better[0]
        theirs, ours = self.others[best.name]
        return f"{best.meaning} ({theirs:.1f} % of census bits differ in place of {ours:.1f} %)"

    @property
    def unexplained(self) -> str | None:
        """One sentence where no reading explains the images, nor that as read more than a few pixels off."""
        theirs, ours = self.beside
        if self.better or not (ours > CHANCE and ours >= BESIDE * theirs):
            return None
        return (
            f"the ground truth does not explain the images, as read or otherwise: {ours:.1f} % of census "
            f"bits differ along it and {theirs:.1f} % a few pixels beside it; check that it belongs to these "
            "images and its coding, unless they show hardly more than noise, haze or bare walls"
        )


def check_ground_truth(
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    disparity: NDArray[np.floating[Any]],
    *,
    pixels: int = PIXELS,
) -> Photometric:
    """Compare a pair's images along its ground truth, as read and read otherwise.

    Args:
        left: (H, W, 3) RGB or (H, W) grey.
        right: the same of the right image.
        disparity: (H, W) in pixels of the left view; not finite where unknown.
        pixels: how many are compared at most, evenly spread.

    Raises:
        InputError: the three differ in size.
    """
    if not left.shape[:2] == right.shape[:2] == disparity.shape:
        raise InputError(
            f"images and ground truth: found the sizes {left.shape[:2]}, {right.shape[:2]} and "
            f"{disparity.shape}, expected one for all three"
        )
    first, second = _grey(left), _grey(right)
    rows, columns = _sampled(disparity, pixels)
    shift = disparity[rows, columns].astype(np.float64)
    # Once for each: every reading is compared with one of these two.
    codes = {False: _codes(first, rows, columns), True: _codes(second, rows, columns)}
    as_read, inside = _residuals(Reading(AS_READ), first, second, rows, columns, shift, codes[False])
    others: dict[str, tuple[float, float]] = {}
    for reading in READINGS:
        of, against = (second, first) if reading.exchanged else (first, second)
        read = _read(reading, disparity, rows, columns, shift)
        theirs, also = _residuals(reading, of, against, rows, columns, read, codes[reading.exchanged])
        # On the pixels that both readings can judge: a smaller scale keeps more matches inside the image.
        both = inside & also
        if int(both.sum()) >= ENOUGH:
            others[reading.name] = (100 * float(theirs[both].mean()), 100 * float(as_read[both].mean()))
    count = int(inside.sum())
    residual = 100 * float(as_read[inside].mean()) if count else float("nan")
    plain, steps = Reading(AS_READ), _steps(left.shape[1])
    off = [_residuals(plain, first, second, rows, columns, shift + by, codes[False]) for by in steps]
    all_inside = np.logical_and.reduce([inside, *(there for _, there in off)])
    if int(all_inside.sum()) < ENOUGH:
        return Photometric(residual, count, others)
    means = [100 * float(values[all_inside].mean()) for values in (*(found for found, _ in off), as_read)]
    return Photometric(residual, count, others, (float(np.mean(means[:-1])), means[-1]))


def _steps(width: int) -> tuple[float, ...]:
    """Steps to either side [px] that leave the match also in large images, whose texture is coarse."""
    near, far = max(5.0, width / 160), max(8.0, width / 100)
    return (-far, -near, near, far)


def _read(
    reading: Reading,
    disparity: NDArray[np.floating[Any]],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    shift: NDArray[np.float64],
) -> NDArray[np.float64]:
    """The ground truth (pixels,) before it is scaled; NaN where the reading has none."""
    if reading.flip is not None:
        return np.flip(disparity, reading.flip)[rows, columns].astype(np.float64)
    if not reading.swapped:
        return shift
    stored = np.round(shift * reading.swapped)
    # Anything else was no such 16-bit value.
    if not (np.allclose(stored, shift * reading.swapped, rtol=0, atol=0.02) and (abs(stored) < 2**16).all()):
        return np.full_like(shift, np.nan)
    return abs(stored).astype(np.uint16).byteswap() / reading.swapped


def _grey(image: NDArray[np.uint8]) -> NDArray[np.float32]:
    return image.mean(axis=2, dtype=np.float32) if image.ndim == 3 else image.astype(np.float32)


def _sampled(disparity: NDArray[np.floating[Any]], pixels: int) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
    """Evenly spread pixels with ground truth whose window lies inside the image."""
    known = np.isfinite(disparity)
    edge = RADIUS + 1  # the right image may be shifted by a row
    known[:edge], known[-edge:], known[:, :edge], known[:, -edge:] = False, False, False, False
    rows, columns = np.nonzero(known)
    if len(rows) > pixels:
        # Evenly over the image and without a draw, so that a check says the same each time.
        chosen = np.linspace(0, len(rows) - 1, pixels).astype(np.intp)
        rows, columns = rows[chosen], columns[chosen]
    return rows, columns


def _codes(
    image: NDArray[np.float32],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp] | NDArray[np.float64],
) -> NDArray[np.bool_]:
    """Census bits (24, pixels) around places whose column may lie between two pixels."""
    # One column short, so that there is a next one to interpolate with.
    whole = np.clip(np.floor(columns), RADIUS, image.shape[1] - RADIUS - 2).astype(np.intp)
    part = (columns - whole).astype(np.float32)

    def grey(dy: int, dx: int) -> NDArray[np.float32]:
        # Between columns the grey values are interpolated, not the bits: disparities are not whole numbers.
        at = image[rows + dy, whole + dx]
        return at + part * (image[rows + dy, whole + dx + 1] - at)

    centre, reach = grey(0, 0), range(-RADIUS, RADIUS + 1)
    return np.stack([grey(dy, dx) > centre for dy in reach for dx in reach if (dy, dx) != (0, 0)])


def _residuals(
    reading: Reading,
    left: NDArray[np.float32],
    right: NDArray[np.float32],
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    shift: NDArray[np.float64],
    codes: NDArray[np.bool_],
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Share of differing bits (pixels,), and where the match lies inside the image with its window."""
    width = left.shape[1]
    match = columns - reading.scale * shift
    inside = (match >= RADIUS) & (match <= width - RADIUS - 2)
    # Any legal column does for those outside, whose answer is not used.
    there = np.where(inside, match, RADIUS)
    differing = np.not_equal(codes, _codes(right, rows - reading.rows, there)).mean(axis=0)
    return differing, inside
