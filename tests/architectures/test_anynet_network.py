"""AnyNet as an entry of the registry: options, blocks, input convention, training."""

from __future__ import annotations

from fnmatch import fnmatchcase
from typing import Any

import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from sfkit.architectures import architecture
from sfkit.architectures.anynet import AnyNet, Route
from sfkit.errors import InputError

ENTRY = architecture("anynet")


def _network(seed: int = 0, **options: Any) -> AnyNet:
    """With random weights and running statistics, the same for every call."""
    rng = np.random.default_rng(seed)
    network = AnyNet(**options)
    for _, value in sorted(network.state_dict().items(), key=lambda item: item[0]):
        if value.is_floating_point():
            if value.ndim == 1:
                sample = rng.uniform(0.5, 1.5, value.shape)
            else:
                sample = rng.normal(size=value.shape) * (2 / np.prod(value.shape[1:])) ** 0.5
            value.copy_(torch.from_numpy(sample))
    return network.eval()


def _images(seed: int, batch: int, height: int, width: int) -> tuple[torch.Tensor, torch.Tensor]:
    rng = np.random.default_rng(seed)
    left, right = (rng.normal(size=(batch, 3, height, width)).astype(np.float32) for _ in range(2))
    return torch.from_numpy(left), torch.from_numpy(right)


def test_blocks_hold_every_weight_once_but_those_of_the_propagation_stage() -> None:
    found: dict[str, int] = {}
    network = AnyNet()
    for key, parameter in network.named_parameters():
        homes = [n for n, globs in ENTRY.blocks({}).items() if any(fnmatchcase(key, g) for g in globs)]
        assert len(homes) == (0 if key.startswith("refine_spn.") else 1), key
        for name in homes:
            found[name] = found.get(name, 0) + parameter.numel()
    assert found == {"backbone": 1215, "neck": 768, "cost_volume": 28674, "head": 3972}
    optional = {k for k in network.state_dict() if any(fnmatchcase(k, g) for g in ENTRY.optional)}
    assert optional == set(network.state_dict()) - set(AnyNet(spn=False).state_dict())
    assert len(optional) == 6


def test_defaults_are_those_of_the_published_weights() -> None:
    assert ENTRY.resolve({}) == {"ranges": (12, 3, 3), "align_corners": True, "spn": True}


@pytest.mark.parametrize("spn", [True, False])
@settings(max_examples=12, deadline=None)
@given(height=st.integers(1, 70), width=st.integers(1, 70))
def test_any_image_size_comes_back_as_it_was(spn: bool, height: int, width: int) -> None:
    rng = np.random.default_rng(height * 100 + width)
    left, right = (rng.integers(0, 256, (height, width, 3), dtype=np.uint8) for _ in range(2))
    pair = ENTRY.inputs({}).prepare(left, right)
    with torch.no_grad():
        disparity = _network(spn=spn)(pair.left, pair.right)
    assert disparity.shape == (1, *pair.left.shape[-2:])
    cropped = pair.window.crop(disparity)[0]
    assert cropped.shape == (height, width)
    assert bool(torch.isfinite(cropped).all())
    assert (pair.window.top, pair.window.left) == (0, 0)


def test_pairs_of_a_batch_do_not_see_one_another() -> None:
    network = _network().double()
    left, right = (i.double() for i in _images(1, 3, 48, 64))
    with torch.no_grad():
        together = network.stages(left, right)
        alone = [network.stages(left[i : i + 1], right[i : i + 1]) for i in range(3)]
    for stage, joint in enumerate(together):
        torch.testing.assert_close(joint, torch.cat([a[stage] for a in alone]))


def test_stages_end_with_the_output_and_start_with_the_coarse_disparity() -> None:
    network = _network()
    left, right = _images(2, 2, 48, 64)
    with torch.no_grad():
        output, stages, trace = network(left, right), network.stages(left, right), network.trace(left, right)
    assert [s.shape for s in stages] == [(2, 48, 64)] * 4
    assert torch.equal(stages[-1], output)
    assert [v.shape for v in trace.low] == [(2, 3, 4), (2, 6, 8), (2, 12, 16)]
    # A corner of the image lies outside the centres of the coarse grid: its value is that of the nearest one.
    torch.testing.assert_close(stages[0][:, 0, 0], 16 * trace.low[0][:, 0, 0])
    torch.testing.assert_close(stages[0][:, -1, -1], 16 * trace.low[0][:, -1, -1])
    residual = stages[1] - stages[0]
    torch.testing.assert_close(residual[:, 0, 0], 8 * trace.low[1][:, 0, 0], atol=1e-4, rtol=0)


@pytest.mark.parametrize("align_corners", [True, False])
def test_fast_route_equals_the_plain_one(align_corners: bool) -> None:
    network = _network(align_corners=align_corners)
    left, right = _images(3, 2, 96, 128)
    found = {}
    for route in Route:
        network.use_route(route)
        with torch.no_grad():
            found[route] = network.stages(left, right)
    for fast, plain in zip(found[Route.FAST], found[Route.PLAIN], strict=True):
        assert float((fast - plain).abs().max()) <= 5e-3
        assert float((fast - plain).abs().mean()) <= 3e-4


def test_ranges_come_from_toml_and_do_not_change_the_weights() -> None:
    network = ENTRY.build(**ENTRY.resolve({"ranges": [4, 3, 5], "spn": False}))
    network.load_state_dict(AnyNet(spn=False).state_dict())
    left, right = _images(4, 1, 32, 48)
    with torch.no_grad():
        trace = network.eval().trace(left, right)
    assert all(float(t.abs().max()) <= m for t, m in zip(trace.low, (3, 2, 4), strict=True))


@pytest.mark.parametrize(
    "ranges", [(12, 3), [12, 3, 3, 3], [12, 3, 1], [12.0, 3, 3], [True, 3, 3], "444", 12]
)
def test_wrong_ranges_are_refused(ranges: Any) -> None:
    with pytest.raises(
        InputError, match=r"ranges of architecture 'anynet' are .*three whole numbers of at least 2"
    ):
        AnyNet(ranges=ranges)


@pytest.mark.parametrize("name", ["align_corners", "spn"])
def test_switches_are_true_or_false(name: str) -> None:
    with pytest.raises(
        InputError, match=f"{name} of architecture 'anynet' is 'false', expected true or false"
    ):
        AnyNet(**{name: "false"})


def test_images_that_were_not_prepared_are_refused() -> None:
    network = _network()
    left, right = _images(5, 1, 48, 64)
    with pytest.raises(InputError, match=r"48 x 60 pixels, expected multiples of 16"):
        network(left[..., :60], right[..., :60])
    with pytest.raises(InputError, match=r"must both be \(B, 3, H, W\)"):
        network(left, right[..., :48])


def test_training_sends_gradients_everywhere_and_counts_both_sides() -> None:
    network = _network(ranges=[4, 3, 3]).train()
    left, right = _images(6, 2, 64, 96)
    sum((d - 5).abs().mean() for d in network.stages(left, right)).backward()
    for key, parameter in network.named_parameters():
        assert parameter.grad is not None, key
        assert bool(torch.isfinite(parameter.grad).all()), key
        assert bool(parameter.grad.abs().sum() > 0), key
    counts = {k: int(v) for k, v in network.state_dict().items() if k.endswith("num_batches_tracked")}
    assert len(counts) == 29
    assert all(n == (2 if k.startswith("feature_extraction.") else 1) for k, n in counts.items())
