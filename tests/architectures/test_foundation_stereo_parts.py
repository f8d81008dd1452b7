"""Parts of FoundationStereo against loops, peer formulas and hand values; no golden arrays needed."""

from __future__ import annotations

import math
from fnmatch import fnmatchcase

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from hypothesis import given
from hypothesis import strategies as st

from sfkit.architectures import architecture
from sfkit.architectures.foundation_stereo import lookup
from sfkit.architectures.foundation_stereo.aggregation import AxialConv, soft_argmin
from sfkit.architectures.foundation_stereo.cost_volume import hybrid_volume
from sfkit.architectures.foundation_stereo.disparity_transformer import (
    DisparityAttention,
    SelfAttention,
    position_code,
)
from sfkit.architectures.foundation_stereo.monocular import input_size
from sfkit.architectures.foundation_stereo.network import FoundationStereo, RefinementTrace
from sfkit.architectures.foundation_stereo.sizes import SIZES, VitSize
from sfkit.architectures.foundation_stereo.upsampling import convex_upsample
from sfkit.architectures.foundation_stereo.vit import VisionTransformer
from sfkit.errors import InputError

Pairs = tuple[torch.Tensor, torch.Tensor]

TINY = VitSize(width=64, depth=4, heads=1, taps=(0, 1, 2, 3), head_width=16, tap_channels=(8, 8, 8, 8))


@pytest.fixture(autouse=True)
def _reproducible() -> None:
    torch.manual_seed(5)


def test_the_hybrid_volume_is_what_loops_over_its_entries_give() -> None:
    width, candidates = 6, 8  # more candidates than columns
    left, right = torch.randn(2, 16, 3, width), torch.randn(2, 16, 3, width)
    own_left, own_right = torch.randn(2, 12, 3, width), torch.randn(2, 12, 3, width)
    volume = hybrid_volume(left, right, own_left, own_right, candidates)
    expected = np.zeros((2, 32, candidates, 3, width))
    for b, d, y, x in np.ndindex(2, candidates, 3, width):
        expected[b, 8:20, d, y, x] = own_left[b, :, y, x]
        if x < d:
            continue
        expected[b, 20:, d, y, x] = own_right[b, :, y, x - d]
        for g in range(8):
            one, other = left[b, 2 * g : 2 * g + 2, y, x], right[b, 2 * g : 2 * g + 2, y, x - d]
            expected[b, g, d, y, x] = one @ other / (one.norm() * other.norm())
    np.testing.assert_allclose(volume.numpy(), expected, atol=1e-6)


def bilinear_lookup(signal: torch.Tensor, position: torch.Tensor) -> torch.Tensor:
    """The published formula: (P, C, N) sampled at (P, K) by torch's grid sampler -> (P, C, K)."""
    grid = 2 * position / (signal.shape[-1] - 1) - 1
    grid = torch.stack([grid, torch.zeros_like(grid)], dim=-1)[:, None]
    return F.grid_sample(signal[:, :, None], grid, mode="bilinear", padding_mode="zeros", align_corners=True)[
        :, :, 0
    ]


@pytest.mark.parametrize("low_memory", [False, True])
def test_the_lookup_is_a_grid_sample_of_two_averaged_levels(
    low_memory: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lookup, "STRIP_ENTRIES", 600)  # 1 row a strip: 2 * 16 * 16 entries
    batch, candidates, height, width = 2, 24, 3, 16
    volume = torch.randn(batch, lookup.FILTERED, candidates, height, width)
    left, right = torch.randn(batch, 20, height, width), torch.randn(batch, 20, height, width)
    disparity = torch.empty(batch, 1, height, width).uniform_(-8, candidates + 8)
    disparity[:, :, 0, :4] = torch.tensor([0.0, -0.5, candidates - 1.0, 7.0])
    found = lookup.GeometryLookup(volume, left, right, low_memory)(disparity)

    table = torch.einsum("bcyx,bcyz->byxz", F.normalize(left, dim=1), F.normalize(right, dim=1))
    places = disparity.reshape(-1, 1)
    matched = torch.arange(width).repeat(batch * height)[:, None] - places
    geometry = volume.permute(0, 3, 4, 1, 2).reshape(len(places), lookup.FILTERED, candidates)
    pairs = table.reshape(len(places), 1, width)
    offsets = torch.arange(-4, 5)
    parts = []
    for level in (0, 1):
        for signal, position in ((geometry, places), (pairs, matched)):
            coarse = F.avg_pool1d(signal, 2**level)
            parts.append(bilinear_lookup(coarse, position / 2**level + offsets).flatten(1))
    expected = torch.cat(parts, dim=1).view(batch, height, width, -1).permute(0, 3, 1, 2)
    assert found.shape == (batch, lookup.LOOKUP_CHANNELS, height, width) == (2, 522, 3, 16)
    torch.testing.assert_close(found, expected, atol=1e-5, rtol=1e-5)


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf, 1e30, -1e30])
def test_a_lookup_at_a_runaway_disparity_does_not_crash(value: float) -> None:
    signal = torch.ones(1, 2, 8, 1, 3)
    found = lookup.sample_around(signal, torch.full((1, 1, 1, 3), value), level=1)
    assert found.shape == (1, 2, 9, 1, 3)


def test_attention_over_disparity_and_over_heads_follow_their_formulas() -> None:
    x = torch.randn(3, 5, 28)
    for over, equation in (
        (DisparityAttention.DISPARITY, ("nlhe,nmhe->nhlm", "nhlm,nmhe->nlhe")),
        (DisparityAttention.HEADS, ("nlae,nlbe->nlab", "nlab,nlbe->nlae")),
    ):
        attention = SelfAttention(28, over)
        q, k, v = (p(x).view(3, 5, 4, 7) for p in (attention.q_proj, attention.k_proj, attention.v_proj))
        scores = torch.einsum(equation[0], q, k) / math.sqrt(7)
        expected = attention.out_proj(torch.einsum(equation[1], scores.softmax(-1), v).reshape(3, 5, 28))
        torch.testing.assert_close(attention(x), expected, atol=1e-6, rtol=1e-5)


def test_the_position_code_interleaves_sine_and_cosine() -> None:
    code = position_code(3, 28, torch.device("cpu"))
    assert code.shape == (3, 28)
    assert code[0].tolist() == [0.0, 1.0] * 14
    slow = 2 * 10000 ** (-26 / 28)
    expected = [math.sin(2), math.cos(2), math.sin(slow), math.cos(slow)]
    assert code[2, [0, 1, 26, 27]].tolist() == pytest.approx(expected, abs=1e-6)


def test_an_axial_convolution_is_the_three_dimensional_one() -> None:
    conv, volume = AxialConv(6), torch.randn(2, 6, 20, 3, 4)
    expected = F.conv3d(volume, conv.weight, conv.bias, padding=(8, 0, 0))
    torch.testing.assert_close(conv(volume), expected, atol=1e-5, rtol=1e-5)


def test_soft_argmin_is_the_mean_disparity_of_the_softmax() -> None:
    scores = torch.zeros(1, 1, 12, 1, 3)
    scores[0, 0, 7, 0, 1] = 1e4
    scores[0, 0, 3:5, 0, 2] = 1e4
    assert soft_argmin(scores).flatten().tolist() == pytest.approx([5.5, 7.0, 3.5])


def test_convex_upsampling_is_a_weighted_mean_of_nine_neighbours() -> None:
    disparity, logits = torch.randn(2, 1, 3, 4), torch.randn(2, 9, 12, 16)
    padded = np.pad(4 * disparity[:, 0].numpy(), ((0, 0), (1, 1), (1, 1)))
    weights = np.exp(logits.numpy()) / np.exp(logits.numpy()).sum(axis=1, keepdims=True)
    expected = np.zeros((2, 1, 12, 16))
    for b, y, x in np.ndindex(2, 12, 16):
        around = padded[b, y // 4 : y // 4 + 3, x // 4 : x // 4 + 3].flatten()
        expected[b, 0, y, x] = around @ weights[b, :, y, x]
    np.testing.assert_allclose(convex_upsample(disparity, logits).numpy(), expected, atol=1e-5)


@pytest.mark.parametrize(
    ("image", "expected"),
    [
        ((128, 256), (224, 336)),
        ((480, 640), (560, 672)),
        ((544, 960), (560, 1008)),
        ((1024, 1344), (1120, 1344)),
        ((1152, 1536), (1120, 1344)),
        ((1088, 1920), (784, 1344)),
        ((2016, 1504), (1344, 1120)),
        ((2048, 2048), (1344, 1344)),
        ((375, 1242), (448, 1344)),
        ((1376, 320), (1344, 336)),
    ],
)
def test_the_size_of_the_monocular_input(image: tuple[int, int], expected: tuple[int, int]) -> None:
    assert input_size(*image) == expected


@given(st.integers(1, 5000), st.integers(1, 5000))
def test_the_monocular_input_is_never_too_large_and_turns_with_the_image(height: int, width: int) -> None:
    rows, cols = input_size(height, width)
    assert rows % 112 == cols % 112 == 0
    assert 112 <= min(rows, cols) <= max(rows, cols) <= 1344
    assert input_size(width, height) == (cols, rows)


def test_positions_on_the_stored_grid_are_the_stored_ones() -> None:
    vit = VisionTransformer(TINY)
    assert torch.equal(vit.position_codes(37, 37), vit.pos_embed)
    resampled = vit.position_codes(16, 24)
    assert resampled.shape == (1, 1 + 16 * 24, 64)
    assert torch.equal(resampled[:, 0], vit.pos_embed[:, 0])


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::torch.jit.TracerWarning")
def test_a_trace_keeps_the_positions_of_its_size() -> None:
    """It counts rows and columns in tensors: for TorchScript this did not export."""
    vit = VisionTransformer(TINY).requires_grad_(False)
    image = torch.rand(1, 3, 112, 224)
    traced = torch.jit.trace(  # type: ignore[no-untyped-call]
        lambda x: vit.position_codes(x.shape[-2] // 14, x.shape[-1] // 14), image, check_trace=False
    )
    assert torch.equal(traced(image), vit.position_codes(8, 16))


@pytest.fixture(scope="module")
def network() -> FoundationStereo:
    torch.manual_seed(5)
    return FoundationStereo(TINY, 64, 2, DisparityAttention.DISPARITY, False, False).eval()


@pytest.fixture(scope="module")
def pairs() -> Pairs:
    generator = torch.Generator().manual_seed(6)
    left, right = 255 * torch.rand(2, 2, 3, 96, 64, generator=generator)
    return left, right


@pytest.fixture(scope="module")
def trace(network: FoundationStereo, pairs: Pairs) -> RefinementTrace:
    with torch.inference_mode():
        return network.trace(*pairs)


def test_a_batch_gives_what_its_pairs_give(
    network: FoundationStereo, pairs: Pairs, trace: RefinementTrace
) -> None:
    together = trace.disparities[-1]
    with torch.inference_mode():
        apart = torch.cat([network(left[None], right[None]) for left, right in zip(*pairs, strict=True)])
    assert together.shape == (2, 96, 64)
    assert together.dtype == torch.float32
    torch.testing.assert_close(together, apart, atol=1e-3, rtol=1e-4)


def test_a_trace_ends_with_the_disparity_and_resumes_from_its_start(
    network: FoundationStereo, pairs: Pairs, trace: RefinementTrace
) -> None:
    assert len(trace.disparities) == 2
    with torch.inference_mode():
        assert torch.equal(network(*pairs, initial=trace.initial), trace.disparities[-1])
        moved = network(*pairs, initial=trace.initial + 1.0)
    assert (moved - trace.disparities[-1]).abs().mean() > 1.0


def test_saving_memory_changes_nothing(
    network: FoundationStereo, pairs: Pairs, trace: RefinementTrace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network, "low_memory", True)
    with torch.inference_mode():
        torch.testing.assert_close(network(*pairs), trace.disparities[-1], atol=1e-4, rtol=1e-5)


def test_mixed_precision_changes_nothing_on_a_processor(
    network: FoundationStereo, pairs: Pairs, trace: RefinementTrace, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network, "mixed_precision", True)
    with torch.inference_mode():
        assert torch.equal(network(*pairs), trace.disparities[-1])


def test_half_precision_around_the_network_keeps_the_disparity_float32(
    network: FoundationStereo, pairs: Pairs
) -> None:
    left, right = (images[:1, :, :32] for images in pairs)  # processors may emulate bfloat16, slowly
    with torch.inference_mode():
        whole = network(left, right)
        with torch.autocast("cpu", dtype=torch.bfloat16):
            found = network(left, right)
    assert found.dtype == torch.float32
    assert not torch.equal(found, whole)
    assert (found - whole).abs().mean() < 1.0


def test_gradients_reach_every_parameter_but_the_frozen_and_the_dead(
    network: FoundationStereo, pairs: Pairs
) -> None:
    network(*(images[:1, :, :64] for images in pairs)).mean().backward()
    unreached = {name for name, parameter in network.named_parameters() if parameter.grad is None}
    network.zero_grad(set_to_none=True)
    silent = ("feature.dino.*", *architecture("foundation-stereo").dead)
    named = {name for name, _ in network.named_parameters()}
    assert unreached == {name for name in named if any(fnmatchcase(name, glob) for glob in silent)}


@pytest.mark.parametrize(
    ("left", "right", "said"),
    [
        ((1, 3, 64, 64), (1, 3, 64, 96), "must both be"),
        ((1, 1, 64, 64), (1, 1, 64, 64), "must both be"),
        ((3, 64, 64), (3, 64, 64), "must both be"),
        ((1, 3, 64, 70), (1, 3, 64, 70), "64 x 70, expected height and width to be multiples of 32"),
    ],
)
def test_images_of_wrong_shape_are_refused(
    network: FoundationStereo, left: tuple[int, ...], right: tuple[int, ...], said: str
) -> None:
    with pytest.raises(InputError, match=said):
        network(torch.zeros(left), torch.zeros(right))


def test_a_first_disparity_of_wrong_size_is_refused(network: FoundationStereo, pairs: Pairs) -> None:
    with pytest.raises(InputError, match=r"initial is \(2, 1, 96, 64\), expected \(2, 1, 24, 16\)"):
        network(*pairs, initial=torch.zeros(2, 1, 96, 64))


def test_the_table_of_sizes_is_consistent() -> None:
    for size in SIZES.values():
        assert size.width == 64 * size.heads
        assert size.taps[-1] == size.depth - 1
        assert (96 + size.out_channels) % 8 == 0  # eight correlation groups
