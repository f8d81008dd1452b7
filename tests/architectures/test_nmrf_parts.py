"""NMRF's parts against plain formulas, written out pair by pair, and against other implementations."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
import torch.nn.functional as F
from hypothesis import given
from hypothesis import strategies as st

from sfkit.architectures.nmrf import layers
from sfkit.architectures.nmrf.inference import CandidateMessages, MessageStack, RelativeAttention
from sfkit.architectures.nmrf.layers import EIGHTH_UNIT, LENGTH, QUARTER_UNIT, disparity_code
from sfkit.architectures.nmrf.matching import MatchingFeatures, warp
from sfkit.architectures.nmrf.neck import HEADS, POINTS, DeformableAttention
from sfkit.architectures.nmrf.propagation import StripeAttention, _other_pixels_or_self, cost_patches
from sfkit.architectures.nmrf.proposals import GROUPS, cost_volume, pick_seeds
from sfkit.architectures.nmrf.swin import SwinBackbone


def _random(seed: int, *shape: int) -> torch.Tensor:
    return torch.from_numpy(np.random.default_rng(seed).standard_normal(shape))


def _randomise(module: torch.nn.Module, seed: int) -> torch.nn.Module:
    module.double()
    rng = np.random.default_rng(seed)
    for parameter in module.requires_grad_(False).parameters():
        parameter.data = torch.from_numpy(0.3 * rng.standard_normal(tuple(parameter.shape)))
    return module


@given(bins=st.integers(4, 9), width=st.integers(1, 7), seed=st.integers(0, 99))
def test_cost_volume_is_the_mean_product_of_matching_pixels(bins: int, width: int, seed: int) -> None:
    left, right = _random(seed, 2, 8, 3, width), _random(seed + 1, 2, 8, 3, width)
    cost = cost_volume(left, right, bins)
    assert cost.shape == (2, 3, width, GROUPS, bins)
    for x in range(width):
        for d in range(bins):
            if d > x:
                assert (cost[:, :, x, :, d] == 0).all()
                continue
            products = (left[..., x] * right[..., x - d]).reshape(2, GROUPS, -1, 3).mean(2)
            assert torch.allclose(cost[:, :, x, :, d], products.transpose(1, 2))


def test_seeds_are_local_maxima_first_and_plateaus_survive_whole() -> None:
    prob = torch.tensor(
        [
            [0.30, 0.10, 0.20, 0.05, 0.15, 0.02, 0.12, 0.06],  # maxima at 0, 2, 4, 6
            [0.20, 0.20, 0.01, 0.50, 0.01, 0.03, 0.03, 0.02],  # plateaus at 0, 1 and at 5, 6
        ]
    )
    assert pick_seeds(prob, 4)[0].tolist() == [0, 2, 4, 6]
    second = pick_seeds(prob, 4)[1].tolist()
    assert second[0] == 3
    assert set(second[1:3]) == {0, 1}
    assert second[3] in (5, 6)


def test_bins_too_small_to_suppress_rank_below_the_suppressed() -> None:
    prob = torch.tensor([0.0009, 0.3, 0.2, 0.1, 0.0008, 0.0007])
    assert pick_seeds(prob, 4)[0] == 1
    assert set(pick_seeds(prob, 3).tolist()) == {1, 2, 3}
    assert pick_seeds(prob, 4)[3] == 0


def test_disparity_code_by_hand() -> None:
    code = disparity_code(torch.tensor([2.5], dtype=torch.float64), EIGHTH_UNIT)[0].numpy()
    u = 2.5 * 3.14 / 64
    expected = [math.sin(u * 2**i) for i in range(15)] + [math.cos(u * 2**i) for i in range(15)] + [u]
    assert code.shape == (LENGTH,)
    assert np.allclose(code, expected, rtol=0, atol=1e-10)
    assert QUARTER_UNIT == EIGHTH_UNIT / 2


def test_disparity_code_is_float32_from_one_rounded_product() -> None:
    value = torch.arange(0, 40, 0.37, dtype=torch.float32)
    u = value.numpy() * np.float32(3.14 / 64)
    expected = np.sin((u * np.float32(2**14)).astype(np.float64))
    with torch.autocast("cpu", dtype=torch.bfloat16):
        code = disparity_code(value, EIGHTH_UNIT)
    assert code.dtype == torch.float32
    assert np.abs(code[:, 14].numpy() - expected).max() < 1e-6


@pytest.mark.parametrize("width", [2, 9])
def test_warp_equals_grid_sample(width: int) -> None:
    right = _random(0, 2, 3, 4, width)
    disparity = 6 * _random(1, 2, 4, width, 5)
    x = (torch.arange(width)[:, None] - disparity) * 2 / (width - 1) - 1
    y = (torch.arange(4) * 2 / 3 - 1)[None, :, None, None].expand_as(x)
    grid = torch.stack((x, y), -1).flatten(2, 3)
    expected = F.grid_sample(right, grid, align_corners=True).permute(0, 2, 3, 1).reshape(2, 4, width, 5, 3)
    assert torch.allclose(warp(right.permute(0, 2, 3, 1), disparity), expected, atol=1e-12)


def test_warp_of_a_broken_disparity_is_broken_and_its_neighbours_are_not() -> None:
    disparity = torch.zeros(1, 1, 4, 1)
    disparity[0, 0, 1], disparity[0, 0, 2] = math.nan, math.inf
    warped = warp(torch.ones(1, 1, 4, 2), disparity)[0, 0, :, 0, 0]
    assert torch.isfinite(warped).tolist() == [True, False, False, True]


def test_unary_correlates_groups_of_eight_channels() -> None:
    left, right = _random(2, 1, 2, 6, 320), _random(3, 1, 2, 6, 320)
    disparity = torch.full((1, 2, 6, 1), 2.0, dtype=torch.float64)
    unary = MatchingFeatures(left, right).unary(disparity)
    assert unary.shape == (1, 2, 6, 1, 160)
    pixel = unary[0, 1, 5, 0]
    assert torch.equal(pixel[:64], left[0, 1, 5, :64])
    assert torch.allclose(pixel[64:128], right[0, 1, 3, :64])
    for group in range(32):
        channels = slice(64 + 8 * group, 72 + 8 * group)
        assert torch.isclose(pixel[128 + group], (left[0, 1, 5, channels] * right[0, 1, 3, channels]).mean())


def test_cost_patches_are_group_major_and_repeat_the_last_bin() -> None:
    cost = _random(4, 1, 1, 1, GROUPS, 10)
    patch = cost_patches(cost, torch.tensor([[[[2, 9]]]]))[0, 0, 0]
    assert patch.shape == (2, 9 * GROUPS)
    bins = [[0, 0, 0, 1, 2, 3, 4, 5, 6], [5, 6, 7, 8, 9, 9, 9, 9, 9]]
    for candidate in range(2):
        assert torch.equal(patch[candidate], cost[0, 0, 0][:, bins[candidate]].flatten())


@pytest.mark.parametrize("vertical", [True, False])
def test_stripe_attention_pair_by_pair(vertical: bool) -> None:
    height, width, N, c = 3, 4, 2, 4
    attention = StripeAttention(c, vertical)
    _randomise(attention, 5)
    q, k, v = (_random(s, 1, height, width, N, c) for s in (6, 7, 8))
    length = height if vertical else width
    found = attention(q, k, v, _other_pixels_or_self(length, N, torch.device("cpu")))
    kernel = attention.get_v.weight[:, 0]
    for y, x, n in np.ndindex(height, width, N):
        stripe = [(i, x) for i in range(height)] if vertical else [(y, i) for i in range(width)]
        others = [(*p, m) for p in stripe for m in range(N) if p != (y, x) or m == n]
        expected = torch.zeros(c, dtype=torch.float64)
        for head in (slice(0, 2), slice(2, 4)):
            logits = torch.stack([(q[0, y, x, n, head] * k[0, *o, head]).sum() * 2**-0.5 for o in others])
            weights = logits.softmax(0)
            expected[head] = sum(w * v[0, *o, head] for w, o in zip(weights, others, strict=True))
        for i, j in stripe:  # neighbours with all their candidates, the centre with its own value
            if abs(i - y) <= 1 and abs(j - x) <= 1:
                value = v[0, y, x, n] if (i, j) == (y, x) else v[0, i, j].sum(0)
                expected += kernel[:, i - y + 1, j - x + 1] * value
        assert torch.allclose(found[0, y, x, n], expected, atol=1e-12)


def test_candidate_messages_stay_within_the_pixel() -> None:
    messages = _randomise(CandidateMessages(8), 9)
    x, code = _random(10, 1, 2, 2, 4, 8), _random(11, 1, 2, 2, 4, LENGTH)
    before = messages(x, code)
    x[0, 1, 1] += 1
    after = messages(x, code)
    same = (before == after).flatten(3).all(-1)
    assert same[0].tolist() == [[True, True], [True, False]]


def test_relative_attention_pair_by_pair() -> None:
    window, N, c = 2, 2, 8
    T, per_head = window**2, c // 4
    attention = RelativeAttention(c, window)
    _randomise(attention, 12)
    qkv = _random(13, 1, 3, T, N, 3 * c)
    strangers = torch.zeros(3, T, T, dtype=torch.float64)
    strangers[2, 0, 3] = strangers[2, 3, 0] = -math.inf
    found = attention(qkv, strangers)
    table = attention.relative_position_enc_table.reshape(-1, 4, 3, per_head)
    for w, i, n, head in np.ndindex(3, T, N, 4):
        q, k, v = (qkv[0, w, :, :, part * c + head * per_head :][..., :per_head] for part in range(3))
        logits, values = [], []
        for j, m in np.ndindex(T, N):
            if (i == j and n != m) or (w == 2 and {i, j} == {0, 3}):
                continue
            down, across = i // 2 - j // 2 + 1, i % 2 - j % 2 + 1
            qe, ke, ve = table[3 * down + across, head]
            logits.append(per_head**-0.5 * (q[i, n] @ k[j, m] + q[i, n] @ ke + k[j, m] @ qe))
            values.append(v[j, m] + ve)
        expected = torch.stack(logits).softmax(0) @ torch.stack(values)
        mine = found[0, w, i, n, head * per_head : (head + 1) * per_head]
        assert torch.allclose(mine, expected, atol=1e-12)


def test_message_stack_pads_with_zero_tokens_on_both_sides() -> None:
    stack = MessageStack(8, window=4, layers=2, candidates=2).eval()
    _randomise(stack, 14)
    unary, code = _random(15, 1, 7, 9, 2, 160), _random(16, 1, 7, 9, 2, LENGTH)
    (found,) = stack.pass_messages(unary, code)
    # 7 -> 8: none on top, one below; 9 -> 12: one left, two right.
    tokens = F.pad(stack.ffn(unary), (0, 0, 0, 0, 1, 2, 0, 1))
    strangers = stack._strangers(tokens)
    padded_code = F.pad(code, (0, 0, 0, 0, 1, 2, 0, 1))
    for layer in stack.layers:
        tokens = layer(tokens, padded_code, strangers)
    assert torch.equal(found, stack.norm(tokens[:, :7, 1:10]))


def test_deformable_attention_pair_by_pair() -> None:
    width = 16
    attention = DeformableAttention(width)
    _randomise(attention, 17)
    queries, values = _random(18, 1, 3, 4, width), _random(19, 1, 5, 2, width)
    found = attention(queries, values)
    maps = attention.value_proj(values)[0].reshape(5, 2, HEADS, -1)
    offsets = attention.sampling_offsets(queries)[0].reshape(3, 4, HEADS, POINTS, 2)
    weights = attention.attention_weights(queries)[0].reshape(3, 4, HEADS, POINTS).softmax(-1)

    def read(head: int, y: float, x: float) -> torch.Tensor:
        total = torch.zeros(maps.shape[-1], dtype=torch.float64)
        for i, j in np.ndindex(5, 2):
            total += max(0.0, 1 - abs(y - i)) * max(0.0, 1 - abs(x - j)) * maps[i, j, head]
        return total

    for r, c in np.ndindex(3, 4):
        gathered = []
        for head in range(HEADS):
            # Cell centres lie at half pixels: query (r, c) sits at ((c + 1/2) / w) of the map's width.
            places = [
                (r + 0.5) / 3 * 5 - 0.5 + offsets[r, c, head, :, 1],
                (c + 0.5) / 4 * 2 - 0.5 + offsets[r, c, head, :, 0],
            ]
            reads = [read(head, float(y), float(x)) for y, x in zip(*places, strict=True)]
            gathered.append(weights[r, c, head] @ torch.stack(reads))
        expected = attention.output_proj(torch.cat(gathered))
        assert torch.allclose(found[0, r, c], expected, atol=1e-12)


def test_spread_writes_sub_pixels_row_by_row() -> None:
    blocks = torch.arange(2 * 3 * 4).reshape(1, 2, 3, 1, 4)
    pixels = layers.spread(blocks, 2)[0, :, :, 0]
    for y, x in np.ndindex(4, 6):
        assert pixels[y, x] == blocks[0, y // 2, x // 2, 0, 2 * (y % 2) + x % 2]


def test_winner_is_the_first_of_the_best() -> None:
    disparity = torch.tensor([[[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]]])
    score = torch.tensor([[[[0.0, 7.0, 7.0], [1.0, 0.0, 0.0]]]])
    assert layers.winner(disparity, score).tolist() == [[[2.0, 4.0]]]


def test_lower_median_takes_the_lower_middle_value() -> None:
    block = torch.arange(16.0).flip(0).reshape(1, 4, 4)
    assert layers.lower_median(torch.cat((block, block + 100), 2), 4).tolist() == [[[7.0, 107.0]]]


def test_stochastic_depth_follows_its_generator_and_rests_in_evaluation() -> None:
    images = _random(20, 2, 3, 32, 32).float()
    backbone = SwinBackbone(drop_path=0.9)
    with torch.no_grad():
        whole = backbone(images)[-1]
        dropped = [backbone(images, np.random.default_rng(s))[-1] for s in (1, 1, 2)]
        assert torch.equal(dropped[0], dropped[1])
        assert not torch.equal(dropped[0], dropped[2])
        assert torch.equal(backbone.eval()(images, np.random.default_rng(1))[-1], whole)
    assert backbone.drop_rates[0] == 0
    assert backbone.drop_rates[-1] == 0.9


def test_stochastic_depth_keeps_the_mean_of_each_branch() -> None:
    backbone = SwinBackbone(drop_path=0.5)
    many = torch.zeros(20_000, 1, 1, 1)
    for rate, keep in zip(
        backbone.drop_rates, backbone._keep_factors(many, np.random.default_rng(3)), strict=True
    ):
        assert keep is not None
        kept = keep[keep != 0]
        assert torch.allclose(kept, torch.full_like(kept, 1 / (1 - rate)))
        assert abs(float(keep.mean()) - 1) < 0.03
