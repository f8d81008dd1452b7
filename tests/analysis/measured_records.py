"""Measured networks with errors that are known by hand, for the tests of statistics."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from sfkit.analysis import Measured
from sfkit.evaluation.metrics import ImageErrors, RegionErrors


def image(name: str, pixels: int, bad: int, sum_abs: float = 0.0) -> ImageErrors:
    """An image of which ``bad`` of ``pixels`` are off by more than 3 px, by 5 % too."""
    return ImageErrors(name, (3.0,), 0, {"all": RegionErrors(pixels, sum_abs, (bad,), bad)})


def measured(
    bad: Mapping[str, Sequence[int]],
    *,
    pixels: Sequence[int] | None = None,
    name: str = "one",
    protocol: str = "all-valid",
    family: str = "pairs",
    validation: bool = False,
) -> Measured:
    """Networks by their bad pixels of each image; images have 100 pixels unless given."""
    images = {}
    for network, counts in bad.items():
        sizes = pixels or [100] * len(counts)
        rows = enumerate(zip(sizes, counts, strict=True))
        images[network] = tuple(image(f"{name}-{n}", size, count) for n, (size, count) in rows)
    return Measured(name, protocol, family, "bad-3.0", validation, images)
