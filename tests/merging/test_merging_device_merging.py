"""Merging on a device: resident or passing by, the bits are the CPU's; meta tensors show what moves."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from typing import Any

import pytest
import tiny
import torch
from torch.overrides import TorchFunctionMode

from sfkit.errors import InputError
from sfkit.merging import LiveModel, Pool, Recipe, device_merging, open_pool
from sfkit.merging.device_merging import DeviceMerger, windows
from sfkit.merging.forward import ForwardMode

CPU = torch.device("cpu")


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    """Three sources of a tiny AnyNet."""
    return open_pool(tiny.write_pool(tmp_path_factory.mktemp("pool")))


def recipes(pool: Pool) -> list[Recipe]:
    """Equal weights, one source, the base, and a mixture with a source that has no weight."""
    mixed = Recipe(
        ("c", "a", "b"), pool.blocks, ((0.5, 0.0, 0.75),) * len(pool.blocks), (1.25,) * len(pool.blocks)
    )
    return [pool.uniform(), pool.equal("b"), pool.base_recipe(), mixed]


@pytest.mark.parametrize("budget", [0, 1 << 40], ids=["passing by", "resident"])
def test_either_way_the_bits_are_those_of_the_pool(
    pool: Pool, budget: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(device_merging, "WINDOW", 64)  # several in each segment; 64 keeps vectors whole
    merger = DeviceMerger(pool.task_vectors, CPU, budget=budget)
    assert merger.resident is (budget > 0)
    out, expected = torch.empty(2, pool.layout.size)
    for recipe in recipes(pool):
        merger.merge_into(pool.ordered(recipe), out)
        assert torch.equal(out, pool.merge_into(recipe, expected))


def test_the_budget_counts_base_and_every_source(pool: Pool) -> None:
    need = 4 * pool.layout.size * (3 + 1)
    assert DeviceMerger(pool.task_vectors, CPU, budget=need).resident
    assert not DeviceMerger(pool.task_vectors, CPU, budget=need - 1).resident


def test_windows_cover_each_segment_once(pool: Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(device_merging, "WINDOW", 1000)
    cut = list(windows(pool.layout))
    assert all(0 < window.stop - window.start <= 1000 for window in cut)
    covered = [n for window in cut for n in range(window.start, window.stop)]
    assert covered == list(range(pool.layout.size))
    for segment in pool.layout.segments:
        inside = [w for w in cut if segment.start <= w.start < segment.stop]
        assert {(w.block, w.kind) for w in inside} == {(segment.block, segment.kind)}
        assert inside[-1].stop == segment.stop


class OneDevice(TorchFunctionMode):
    """Refuses every operation but a copy that takes tensors of two devices."""

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Iterable[type],
        args: tuple[Any, ...] = (),
        kwargs: dict[str, Any] | None = None,
    ) -> Any:
        given = [*args, *(kwargs or {}).values()]
        devices = {value.device for value in given if isinstance(value, torch.Tensor)}
        assert len(devices) <= 1 or func is torch.Tensor.copy_, f"{func} mixes {devices}"
        return func(*args, **(kwargs or {}))


@pytest.mark.parametrize("budget", [0, 1 << 40], ids=["passing by", "resident"])
def test_on_another_device_only_copies_cross(pool: Pool, budget: int) -> None:
    meta = torch.device("meta")
    merger = DeviceMerger(pool.task_vectors, meta, budget=budget)
    out = torch.empty(pool.layout.size, device=meta)
    with OneDevice():
        for recipe in recipes(pool):
            assert merger.merge_into(pool.ordered(recipe), out) is out
        with pytest.raises(AssertionError, match="mixes"):
            out.add_(pool.base_flat)


@pytest.mark.parametrize("mode", [ForwardMode(), ForwardMode(channels_last=True)])
def test_a_network_on_another_device_runs_there(pool: Pool, mode: ForwardMode) -> None:
    model = LiveModel(pool, pool.uniform(), device="meta", mode=mode)
    model.apply(pool.equal("a"))
    assert all(tensor.is_meta for tensor in model.network.state_dict().values())
    image = model.mode.place(torch.zeros(1, 3, 32, 64), model.device)
    with torch.inference_mode():
        output = model.network(image, image)
    assert output.is_meta
    assert output.shape[-2:] == (32, 64)


def test_bfloat16_and_channels_last_change_the_computing_and_not_the_weights(pool: Pool) -> None:
    images = torch.randn(2, 1, 3, 32, 64, generator=torch.Generator().manual_seed(3))
    plain, half, last = (
        LiveModel(pool, pool.uniform(), mode=mode)
        for mode in (ForwardMode(), ForwardMode("bfloat16"), ForwardMode(channels_last=True))
    )
    exact = plain.disparity(images[0], images[1])
    rough, turned = half.disparity(images[0], images[1]), last.disparity(images[0], images[1])
    assert torch.equal(plain.flat, half.flat)
    assert torch.equal(plain.flat, last.flat)
    assert rough.dtype == turned.dtype == torch.float32
    # Eight bits of mantissa, through some thirty layers; the layout changes no more than the order of sums.
    assert 0 < (rough - exact).norm() < 0.2 * exact.norm()
    torch.testing.assert_close(turned, exact, rtol=1e-4, atol=1e-4)


def test_an_unknown_precision_is_refused() -> None:
    with pytest.raises(InputError, match=r"unknown precision 'float16', expected one of: bfloat16, float32"):
        ForwardMode("float16")


def test_the_usual_mode_says_of_itself_what_keys_have_always_held() -> None:
    assert ForwardMode().describe() == {"precision": "float32"}
    both = ForwardMode("bfloat16", channels_last=True).describe()
    assert both == {"precision": "bfloat16", "channels_last": True}
