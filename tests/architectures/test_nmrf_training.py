"""NMRF's training mode: losses against plain sums, and steps that reach every parameter."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from nmrf_fill import fill

from sfkit.architectures import NMRF, architecture
from sfkit.architectures.nmrf import Coarse, NMRFOutput
from sfkit.architectures.nmrf.training import (
    Losses,
    LossWeights,
    losses,
    parameter_groups,
    target_histogram,
)
from sfkit.errors import InputError

NAMES = ("nmrf-res", "nmrf-swint")
SIZE = (64, 96)


def _network(name: str) -> NMRF:
    network = architecture(name).build()
    assert isinstance(network, NMRF)
    fill(network, "B")
    return network.train()


def _scene(rng: np.random.Generator) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    """A random texture, itself shifted by 2 to 20 pixels, and ground truth with holes: (2, ...) each."""
    height, width = SIZE
    shifts = rng.integers(2, 21, 2)
    textures = rng.integers(0, 256, (2, 3, height, width + 20)).astype(np.float32)
    left = np.stack([t[..., :width] for t in textures])
    right = np.stack([t[..., s : s + width] for t, s in zip(textures, shifts, strict=True)])
    truth = np.broadcast_to(shifts[:, None, None], (2, height, width)).astype(np.float32).copy()
    truth[rng.random(truth.shape) < 0.3] = np.inf
    return torch.from_numpy(left), torch.from_numpy(right), torch.from_numpy(truth)


def _estimate(rng: np.random.Generator, bins: int = 5) -> NMRFOutput:
    """Random outputs for a 16 x 24 image, all positive."""

    def draw(*shape: int) -> torch.Tensor:
        return torch.from_numpy(rng.uniform(0, 5, shape))

    refined = tuple(draw(1, 16, 24) for _ in range(5))
    coarse = tuple(Coarse(draw(1, 16, 24, 4), draw(1, 16, 24, 4)) for _ in range(5))
    prob = draw(6, bins).softmax(-1)
    return NMRFOutput(4 * refined[-1], refined[-1], draw(1, 6, 4), draw(1, 6, 4), prob, coarse, refined[:-1])


def _truth(rng: np.random.Generator) -> torch.Tensor:
    truth = torch.from_numpy(rng.uniform(1, 50, (1, 16, 24)))
    truth[0, 0, :4] = torch.tensor([0.0, -3.0, torch.inf, torch.nan], dtype=truth.dtype)
    return truth


def _smooth(error: float) -> float:
    return error**2 / 2 if error < 1 else error - 0.5


@pytest.mark.parametrize("smooth", [False, True])
def test_losses_equal_plain_sums_over_pixels(smooth: bool) -> None:
    rng = np.random.default_rng(0)
    estimate, truth = _estimate(rng), _truth(rng)
    found = losses(estimate, truth, max_disp=45.0, smooth=smooth)
    valid = [(y, x) for y, x in np.ndindex(16, 24) if 0 < truth[0, y, x] < 45]
    measure = _smooth if smooth else float

    proposal, near = 0.0, [p for p in valid if truth[0, *p] < 40]  # five bins of eight pixels
    for y, x in near:
        labels = 8 * estimate.proposal[0, 3 * (y // 8) + x // 8]
        proposal += _smooth(float((labels - truth[0, y, x]).abs().min()))
    assert float(found.proposal) == pytest.approx(proposal / len(near))

    for layer, loss in zip(estimate.aux_coarse, found.coarse, strict=True):
        total = 0.0
        for y, x in valid:
            weights = layer.logits_pred[0, y, x].softmax(-1)
            errors = (8 * layer.disp_pred[0, y, x] - truth[0, y, x]).abs()
            total += sum(float(w) * measure(float(e)) for w, e in zip(weights, errors, strict=True))
        assert float(loss) == pytest.approx(total / len(valid))

    for map_, loss in zip((*estimate.aux_refined, estimate.disp_pred), found.refined, strict=True):
        errors = [measure(abs(float(4 * map_[0, y, x] - truth[0, y, x]))) for y, x in valid]
        assert float(loss) == pytest.approx(np.mean(errors))


def test_init_loss_is_the_cross_entropy_with_the_blocks_histogram() -> None:
    rng = np.random.default_rng(1)
    estimate, truth = _estimate(rng), _truth(rng)
    truth[0, 8:, 8:16] = 0  # a block without ground truth does not count
    target = np.zeros((6, 5))
    for y, x in np.ndindex(16, 24):
        d = float(truth[0, y, x])
        if 0 < d < 40 and x >= d:
            low, rest = int(d // 8), d / 8 - d // 8
            target[3 * (y // 8) + x // 8, low] += 1 - rest
            target[3 * (y // 8) + x // 8, min(low + 1, 4)] += rest
    mass = target.sum(1, keepdims=True)
    target = np.divide(target, mass, out=np.zeros_like(target), where=mass > 0)
    clean = torch.where(torch.isfinite(truth) & (truth > 0), truth, 0.0)
    assert np.allclose(target_histogram(clean, 5)[0].numpy(), target)
    expected = -(target * np.log(estimate.prob.numpy())).sum() / (mass > 0).sum()
    assert float(losses(estimate, truth).init) == pytest.approx(expected)


def test_total_is_the_weighted_sum() -> None:
    one = torch.tensor(1.0)
    ones = Losses(one, one, (one,) * 5, (one,) * 5)
    assert float(ones.total()) == pytest.approx(1 + 1 + 5.8 + 8.4)
    assert float(ones.total(LossWeights(proposal=0.0))) == pytest.approx(1 + 5.8 + 8.4)


def test_no_ground_truth_means_no_loss() -> None:
    estimate = _estimate(np.random.default_rng(2))
    assert float(losses(estimate, torch.zeros(1, 16, 24)).total()) == 0


def test_losses_refuse_what_they_cannot_compare() -> None:
    estimate = _estimate(np.random.default_rng(3))
    with pytest.raises(InputError, match=r"ground truth is \(1, 8, 8\), expected \(1, 16, 24\)"):
        losses(estimate, torch.zeros(1, 8, 8))
    evaluated = NMRFOutput(estimate.disp, estimate.disp_pred, *[estimate.proposal] * 2, estimate.prob)
    with pytest.raises(InputError, match="expected one made in training mode"):
        losses(evaluated, torch.zeros(1, 16, 24))


def _has_no_effect(key: str) -> bool:
    """A bias of the keys moves all logits of a query alike, and softmax does not see that."""
    return key.endswith(".k.bias")


@pytest.mark.parametrize("name", NAMES)
def test_steps_stay_finite_and_reach_every_parameter(name: str) -> None:
    rng = np.random.default_rng(4)
    network = _network(name)
    optimiser = torch.optim.AdamW(parameter_groups(network))
    before = {key: p.detach().clone() for key, p in network.named_parameters()}
    for depth in (rng, None):  # stochastic depth, then every branch
        left, right, truth = _scene(rng)
        loss = losses(network.estimate(left, right, rng=depth), truth).total()
        assert torch.isfinite(loss)
        optimiser.zero_grad()
        loss.backward()
        gradients = {key: p.grad for key, p in network.named_parameters()}
        norm = torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        assert torch.isfinite(norm)
        optimiser.step()
    for key, gradient in gradients.items():
        assert gradient is not None, key
        assert torch.isfinite(gradient).all(), key
        if not _has_no_effect(key):
            assert gradient.abs().max() > 0, key
            assert not torch.equal(dict(network.named_parameters())[key], before[key]), key


def test_without_the_proposal_loss_nothing_trains_the_propagation() -> None:
    network = _network("nmrf-res")
    left, right, truth = _scene(np.random.default_rng(5))
    losses(network.estimate(left, right), truth).total(LossWeights(proposal=0.0)).backward()
    untouched = {key for key, p in network.named_parameters() if p.grad is None or not p.grad.any()}
    assert untouched == {
        key
        for key, _ in network.named_parameters()
        if key.startswith(("dpn.propagation.", "dpn.prop_head.", "dpn.proj."))
    }


def test_a_few_steps_on_one_scene_lower_the_loss() -> None:
    network = _network("nmrf-res")
    left, right, truth = _scene(np.random.default_rng(6))
    optimiser = torch.optim.Adam(network.parameters(), lr=1e-4)
    curve = []
    for _ in range(4):
        loss = losses(network.estimate(left, right), truth).total()
        optimiser.zero_grad()
        loss.backward()
        optimiser.step()
        curve.append(loss.item())
    assert curve[-1] < curve[0]


@pytest.mark.parametrize("name", NAMES)
def test_parameter_groups_hold_every_parameter_once_at_its_rate(name: str) -> None:
    network = _network(name)
    key_of = {id(p): key for key, p in network.named_parameters()}
    seen = []
    for group in parameter_groups(network, rate=1e-3, weight_decay=0.1):
        for parameter in group["params"]:
            key = key_of[id(parameter)]
            slow = key.startswith("image_encoder.backbone.") or ".sampling_offsets." in key
            table = key.endswith(("relative_position_bias_table", "relative_position_enc_table"))
            assert group["lr"] == (1e-4 if slow else 1e-3), key
            assert group["weight_decay"] == (0.0 if table else 0.1), key
            seen.append(key)
    assert sorted(seen) == sorted(key_of.values())
