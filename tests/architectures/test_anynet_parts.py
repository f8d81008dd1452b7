"""AnyNet's parts against loops written from the equations, and its two convolution routes against Conv3d."""

from __future__ import annotations

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from hypothesis import given, settings
from hypothesis import strategies as st

from sfkit.architectures.anynet.aggregation import Route, VolumeStack, soft_argmin
from sfkit.architectures.anynet.convolution import Convolution, banded, direct
from sfkit.architectures.anynet.refinement import propagate
from sfkit.architectures.anynet.volumes import full_volume, residual_volume

ROUTES = pytest.mark.parametrize("convolve", [direct, banded])
TOLERANCE = {torch.float32: 2e-5, torch.float64: 1e-12}


def _normal(seed: int, *shape: int, dtype: torch.dtype = torch.float64) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).normal(size=shape)).to(dtype)


def _stack(width: int, seed: int, dtype: torch.dtype) -> VolumeStack:
    rng = np.random.default_rng(seed)
    stack = VolumeStack(width)
    for key, value in stack.state_dict().items():
        if value.is_floating_point():
            low = 0.5 if key.endswith("running_var") else -0.5
            value.copy_(torch.from_numpy(rng.uniform(low, 1.5, value.shape)))
    return stack.to(dtype)


def test_full_volume_follows_its_definition() -> None:
    left, right = _normal(0, 2, 3, 4, 6), _normal(1, 2, 3, 4, 6)
    volume = full_volume(left, right, candidates=8)
    for b, d, y, x in np.ndindex(2, 8, 4, 6):
        other = right[b, :, y, x - d] if x >= d else torch.zeros(3, dtype=right.dtype)
        assert volume[b, d, y, x] == pytest.approx((left[b, :, y, x] - other).abs().sum().item())


def test_residual_volume_of_whole_disparities_compares_whole_columns() -> None:
    left, right = _normal(2, 1, 2, 3, 9), _normal(3, 1, 2, 3, 9)
    disparity = torch.full((1, 3, 9), 3.0, dtype=left.dtype)
    volume = residual_volume(left, right, disparity, reach=2, align_corners=True)
    for k, y, x in np.ndindex(5, 3, 9):
        column = x - 3 + (k - 2)
        other = right[0, :, y, column] if 0 <= column < 9 else torch.zeros(2, dtype=right.dtype)
        assert volume[0, k, y, x] == pytest.approx((left[0, :, y, x] - other).abs().sum().item())


def test_residual_volume_passes_gradients_to_the_disparity() -> None:
    left, right = _normal(4, 1, 2, 3, 9), _normal(5, 1, 2, 3, 9)
    disparity = (2.3 + 0.1 * _normal(6, 1, 3, 9)).requires_grad_()

    def volume(d: torch.Tensor) -> torch.Tensor:
        return residual_volume(left, right, d, reach=2, align_corners=True)

    assert torch.autograd.gradcheck(volume, (disparity,))


def test_soft_argmin_is_the_candidate_of_the_lowest_cost() -> None:
    cost = torch.full((1, 5, 1, 1), 1e3, dtype=torch.float64)
    cost[0, 3] = 0.0
    assert soft_argmin(cost, first=-2).item() == pytest.approx(1.0)
    assert soft_argmin(torch.zeros(1, 5, 1, 1), first=0).item() == pytest.approx(2.0)


@ROUTES
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64], ids=str)
@settings(max_examples=20, deadline=None)
@given(shape=st.tuples(*[st.integers(1, 5)] * 6), bias=st.booleans(), seed=st.integers(0, 99))
def test_convolution_routes_equal_conv3d(
    convolve: Convolution, dtype: torch.dtype, shape: tuple[int, ...], bias: bool, seed: int
) -> None:
    batch, in_, out, planes, height, width = shape
    maps = _normal(seed, batch, in_, planes, height, width, dtype=dtype)
    weight = _normal(seed + 100, out, in_, 3, 3, 3, dtype=dtype)
    shift = _normal(seed + 200, out, dtype=dtype) if bias else None
    before = maps.clone()
    found = convolve(maps, weight, shift)
    expected = F.conv3d(F.relu(maps), weight, shift, padding=1)
    torch.testing.assert_close(found, expected, atol=20 * TOLERANCE[dtype], rtol=TOLERANCE[dtype])
    assert torch.equal(maps, before)


@ROUTES
def test_convolution_routes_have_exact_gradients(convolve: Convolution) -> None:
    maps, weight = _normal(7, 1, 2, 4, 3, 3), _normal(8, 2, 2, 3, 3, 3)
    shift = _normal(9, 2)
    inputs = [t.requires_grad_() for t in (maps, weight, shift)]
    assert torch.autograd.gradcheck(convolve, inputs)


@pytest.mark.parametrize("training", [False, True], ids=["eval", "train"])
@pytest.mark.parametrize("width", [16, 4])
@pytest.mark.parametrize("planes", [4, 5, 12])
def test_fast_stack_equals_the_plain_one_with_its_gradients_and_statistics(
    width: int, planes: int, training: bool
) -> None:
    cost = _normal(10, 2, planes, 6, 7, dtype=torch.float32).abs() * 3
    seen: dict[Route, list[torch.Tensor]] = {}
    for route in Route:
        stack = _stack(width, seed=11, dtype=torch.float32).train(training)
        stack.route = route
        leaf = cost.clone().requires_grad_()
        out = stack(leaf)
        # Batch norm has no gradient along a constant, so the loss must not be a plain sum.
        (out / out.detach().abs().max()).square().sum().backward()
        assert leaf.grad is not None
        seen[route] = [out.detach(), leaf.grad, *[_grad(p) for p in stack.parameters()], *stack.buffers()]
    for fast, plain in zip(seen[Route.FAST], seen[Route.PLAIN], strict=True):
        scale = float(plain.abs().max()) or 1.0
        assert float((fast - plain).abs().max()) <= 1e-4 * scale


def _grad(parameter: torch.nn.Parameter) -> torch.Tensor:
    assert parameter.grad is not None
    return parameter.grad


def test_fast_stack_sees_weights_that_were_changed_in_place() -> None:
    stack = _stack(4, seed=12, dtype=torch.float64).eval()
    cost = _normal(13, 1, 5, 4, 4)
    before = stack(cost)
    with torch.no_grad():
        for tensor in stack.state_dict().values():
            tensor.mul_(2)
    after = stack(cost)
    stack.route = Route.PLAIN
    torch.testing.assert_close(after, stack(cost))
    assert not torch.allclose(after, before)


def _scan_by_hand(state: torch.Tensor, gates: torch.Tensor) -> torch.Tensor:
    out = torch.zeros_like(state)
    batch, channels, height, width = state.shape
    for b, c, t, y in np.ndindex(batch, channels, width, height):
        value, rest = 0.0, 1.0
        for i, row in enumerate((y - 1, y, y + 1)):
            if t > 0 and 0 <= row < height:
                gate = gates[b, i, c, y, t].item()
                value += gate * out[b, c, row, t - 1].item()
                rest -= gate
        out[b, c, y, t] = value + rest * state[b, c, y, t].item()
    return out


@pytest.mark.parametrize("shape", [(2, 3, 4, 5), (1, 1, 1, 6), (1, 2, 5, 1)])
def test_scan_equals_a_loop_over_pixels(shape: tuple[int, int, int, int]) -> None:
    batch, channels, height, width = shape
    state, gates = _normal(14, *shape), _normal(15, batch, 3, channels, height, width)
    torch.testing.assert_close(propagate(state, gates), _scan_by_hand(state, gates))


def test_scan_has_exact_gradients() -> None:
    state, gates = _normal(16, 2, 2, 4, 5).requires_grad_(), _normal(17, 2, 3, 2, 4, 5).requires_grad_()
    assert torch.autograd.gradcheck(propagate, (state, gates))
