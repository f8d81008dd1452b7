"""Noise over images, and racing, on the sharp bank."""

from __future__ import annotations

from noise import kept_of, written

POOL = "bank-sharp"
HEAD = f"""## Does a model gain from knowing how noisy scores are? The sharp bank

`python benchmarks/noise.py --pool {POOL}`: the same on `{POOL}`, the first part with networks that run."""


def section() -> str:
    """Tables of whatever is finished.

    Raises:
        SystemExit: that is nothing.
    """
    return written(kept_of(POOL), HEAD, POOL)
