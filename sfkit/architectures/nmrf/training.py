"""What NMRF is trained with: losses on bins, proposals and every layer, and which parameters learn slowly."""

from __future__ import annotations

from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

import torch
import torch.nn.functional as F
from torch import nn

from sfkit.architectures.nmrf import windows
from sfkit.architectures.nmrf.network import NMRF, REFINE_STRIDE, Coarse, NMRFOutput
from sfkit.architectures.nmrf.proposals import STRIDE
from sfkit.errors import InputError

TRAINING_LIMIT = 192.0  # px; the KITTI configurations use 384 and the smooth loss
LEAST_MASS = 1e-3
LEAST_PROB = 1e-6


@dataclass(frozen=True)
class LossWeights:
    """How the losses add up; the defaults are the training code's.

    ``proposal`` is the exception: that code computes the proposal loss but, under a name its weights
    do not list, leaves it out of the sum. Then nothing trains the label propagation, for its labels
    are detached; 0.0 reproduces it.
    """

    init: float = 1.0
    proposal: float = 1.0
    coarse: tuple[float, ...] = (1.0, 1.0, 1.0, 1.4, 1.4)
    refined: tuple[float, ...] = (1.4, 1.4, 1.6, 2.0, 2.0)


@dataclass(frozen=True)
class Losses:
    """The losses of one batch, scalars; ``coarse`` and ``refined`` have one a layer, the last one last."""

    init: torch.Tensor
    proposal: torch.Tensor
    coarse: tuple[torch.Tensor, ...]
    refined: tuple[torch.Tensor, ...]

    def total(self, weights: LossWeights | None = None) -> torch.Tensor:
        """The weighted sum, by default with the training code's weights."""
        w = weights or LossWeights()
        terms = [w.init * self.init, w.proposal * self.proposal]
        terms += [a * loss for a, loss in zip(w.coarse, self.coarse, strict=True)]
        terms += [a * loss for a, loss in zip(w.refined, self.refined, strict=True)]
        return torch.stack(terms).sum()


def losses(
    estimate: NMRFOutput, truth: torch.Tensor, *, max_disp: float = TRAINING_LIMIT, smooth: bool = False
) -> Losses:
    """Compare a training-mode estimate with ground truth.

    A loss whose pixels are all invalid is 0.

    Args:
        estimate: of a network in training mode.
        truth: (B, H, W) disparity in pixels; what is not finite or not positive is invalid.
        max_disp: pixels from this disparity on are left out, in pixels.
        smooth: smooth L1 instead of L1 for the layers' disparities (the KITTI configurations).

    Raises:
        InputError: the estimate comes from evaluation mode, or the shapes differ.
    """
    if not estimate.aux_coarse:
        raise InputError("the estimate has no layers' outputs, expected one made in training mode: train()")
    if truth.shape != estimate.disp.shape:
        raise InputError(
            f"ground truth is {tuple(truth.shape)}, expected {tuple(estimate.disp.shape)} like the disparity"
        )
    # Unknown truth is 0 from here on: a NaN would survive the mask, in gradients as well.
    truth = torch.where(torch.isfinite(truth) & (truth > 0), truth, 0.0).to(estimate.disp.dtype)
    mask = (truth > 0) & (truth < max_disp)
    refined = (*estimate.aux_refined, estimate.disp_pred)
    return Losses(
        init=_init_loss(estimate.prob, truth),
        proposal=_proposal_loss(estimate, truth, mask),
        coarse=tuple(_coarse_loss(layer, truth, mask, smooth) for layer in estimate.aux_coarse),
        refined=tuple(_mean(_distance(d * REFINE_STRIDE, truth, smooth), mask) for d in refined),
    )


def target_histogram(truth: torch.Tensor, bins: int) -> torch.Tensor:
    """How the pixels of each 8x8 block spread over the bins: (B, H, W) px -> (B, H/8 * W/8, D), sums 1 or 0.

    A disparity is split linearly between the two nearest bins. Pixels beyond the bins, and those
    whose match lies left of the right image, do not count.
    """
    # Further left there is no match inside the right image.
    inside = torch.arange(truth.shape[-1], device=truth.device) >= truth
    counted = (truth > 0) & (truth < bins * STRIDE) & inside
    place, mass = windows.cut(truth, STRIDE) / STRIDE, windows.cut(counted, STRIDE).to(truth.dtype)
    low = place.floor().clamp(max=bins - 1)
    upper = mass * (place - place.floor())
    histogram = truth.new_zeros(*place.shape[:2], bins)
    histogram.scatter_add_(-1, low.long(), mass - upper)
    # The last bin has no next one: its share stays with itself.
    histogram.scatter_add_(-1, (low + 1).clamp(max=bins - 1).long(), upper)
    return histogram / histogram.sum(-1, keepdim=True).clamp(min=LEAST_MASS)


def _init_loss(prob: torch.Tensor, truth: torch.Tensor) -> torch.Tensor:
    """Cross-entropy of the bins with the block's histogram, over the blocks with any ground truth."""
    target = target_histogram(truth, prob.shape[-1]).flatten(0, 1)
    # Blocks without ground truth add nothing to the sum, and do not count in the mean.
    count = (target.sum(-1) > 0).sum().clamp(min=1)
    return -(target * prob.clamp(min=LEAST_PROB).log()).sum() / count


def _proposal_loss(estimate: NMRFOutput, truth: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    """Each pixel against the nearest of its block's labels."""
    limit = estimate.prob.shape[-1] * STRIDE
    labels = estimate.proposal * STRIDE
    pixels = windows.cut(truth, STRIDE)
    # The nearest of the labels counts: one of them is to be right.
    away = (pixels[..., None] - labels[..., None, :]).abs().amin(-1)
    loss = F.smooth_l1_loss(away, torch.zeros_like(away), reduction="none")
    return _mean(loss, windows.cut(mask & (truth < limit), STRIDE))


def _coarse_loss(layer: Coarse, truth: torch.Tensor, mask: torch.Tensor, smooth: bool) -> torch.Tensor:
    """The candidates' errors, weighted by the probability their scores give them."""
    error = _distance(layer.disp_pred * STRIDE, truth[..., None].expand_as(layer.disp_pred), smooth)
    return _mean((layer.logits_pred.softmax(-1) * error).sum(-1), mask)


def _distance(disparity: torch.Tensor, truth: torch.Tensor, smooth: bool) -> torch.Tensor:
    measure = F.smooth_l1_loss if smooth else F.l1_loss
    return measure(disparity, truth, reduction="none")


def _mean(values: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
    # Without a valid pixel the sum is 0: divided by 1 it stays 0, and has a gradient.
    return (values * mask).sum() / mask.sum().clamp(min=1)


FINE_TUNING_RATE = 2e-4  # the peak of a one-cycle schedule; gradients are clipped to a norm of 1
WEIGHT_DECAY = 1e-5
SLOWDOWN = 0.1
SLOW = ("image_encoder.backbone.*", "*.sampling_offsets.*")
WITHOUT_DECAY = ("*.relative_position_*_table",)


def parameter_groups(
    network: NMRF, rate: float = FINE_TUNING_RATE, weight_decay: float = WEIGHT_DECAY
) -> list[dict[str, Any]]:
    """Parameter groups for ``torch.optim.AdamW``, each parameter in exactly one.

    Swin-T and the sampling offsets learn at a tenth of ``rate``, the residual encoder at full rate;
    relative-position tables do not decay.
    """
    groups: dict[tuple[float, float], list[nn.Parameter]] = {}
    for name, parameter in network.named_parameters():
        slow, tables = (any(fnmatchcase(name, p) for p in patterns) for patterns in (SLOW, WITHOUT_DECAY))
        setting = (rate * SLOWDOWN if slow else rate, 0.0 if tables else weight_decay)
        groups.setdefault(setting, []).append(parameter)
    return [{"params": p, "lr": lr, "weight_decay": decay} for (lr, decay), p in groups.items()]
