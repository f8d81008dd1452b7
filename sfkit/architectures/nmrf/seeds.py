"""Seeds of a pixel: the likeliest disparity bins, one a local maximum if there are enough."""

from __future__ import annotations

import torch
import torch.nn.functional as F

SUPPRESSED = 1e-3


def pick_seeds(prob: torch.Tensor, count: int) -> torch.Tensor:
    """Probabilities (..., D) -> the ``count`` seeds (..., count) int64, in units of 1/8 px, likeliest first.

    Bins that are no local maximum and exceed 1e-3 are set to exactly 1e-3, so plateaus survive whole
    and smaller bins rank below the suppressed ones. Ties are the rule where a pixel has fewer maxima
    than ``count``; ``torch.topk`` does not define their order (NMRF does the same), so the seeds of
    such pixels may differ between devices and PyTorch versions.
    """
    with torch.no_grad():
        flat = prob.reshape(-1, 1, prob.shape[-1])
        peak = F.max_pool1d(flat, 3, stride=1, padding=1).reshape(prob.shape)
        suppressed = (prob != peak) & (prob > SUPPRESSED)
        return prob.masked_fill(suppressed, SUPPRESSED).topk(count, dim=-1).indices
