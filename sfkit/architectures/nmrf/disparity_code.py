"""The sinusoidal code of a disparity."""

from __future__ import annotations

import torch

BANDS = 15
LENGTH = 2 * BANDS + 1

# 3.14, not pi: the top band multiplies every difference by 2^14, and the weights were trained with 3.14.
EIGHTH_UNIT = 3.14 / 64
QUARTER_UNIT = 3.14 / 128


def disparity_code(disparity: torch.Tensor, unit: float) -> torch.Tensor:
    """(...) disparities -> (..., 31): sin(u 2^i), cos(u 2^i), i = 0 .. 14, and u = disparity * unit.

    ``unit`` is ``EIGHTH_UNIT`` for disparities in 1/8 px and ``QUARTER_UNIT`` for 1/4 px. The result
    is float32, also under autocast (float64 if the input is): half precision would turn the upper
    bands into noise. u is one rounded product, which the powers of two then scale exactly.
    """
    # Autocast leaves pointwise functions alone, so the input's precision decides.
    value = disparity if disparity.dtype == torch.float64 else disparity.float()
    u = (value * unit)[..., None]
    powers = torch.arange(BANDS, device=u.device, dtype=u.dtype)
    bands = u * torch.exp2(powers)
    return torch.cat((bands.sin(), bands.cos(), u), -1)
