"""FoundationStereo pools in the public layout: what is merged, what is left alone, and what comes out."""

from __future__ import annotations

import shutil
import warnings
from collections.abc import Iterator
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import pytest
import torch
from foundation_stereo_reference import key_list

from sfkit.architectures import architecture
from sfkit.architectures.foundation_stereo import FoundationStereo, foundation_stereo
from sfkit.checkpoints import FileForm, Member, PoolSpec
from sfkit.checkpoints.checks import Kind
from sfkit.errors import SfkitWarning
from sfkit.merging import Pool, open_pool
from sfkit.merging.blocks import OUTSIDE
from sfkit.merging.cache import VectorCache
from sfkit.merging.network import load_network
from sfkit.merging.saving import save_merged
from sfkit.merging.tensor_specs import tensor_specs

State = dict[str, torch.Tensor]
CONFIG = "vit_size: vits\nmax_disp: 64\nvalid_iters: 2\nmixed_precision: true\nlow_memory: 0\n"
VIT = "feature.dino."
# Of the specification: dead parameters outside the frozen ViT, and the keys that share a tensor.
DEAD = ("context_zqr_convs.*", "stem_4.*", "cnet.down.*", "cnet.norm.*")
SHARED = [f"cnet.layer{n}.0" for n in (2, 3, 4, 5)]


def source_of(base: State, seed: int) -> State:
    """Every floating tensor outside the ViT moved a little, the dead ones too; keys of one tensor alike."""
    generator = torch.Generator().manual_seed(seed)
    moved: dict[int, torch.Tensor] = {}
    state = dict(base)
    for key, value in base.items():
        if key.startswith(VIT) or not value.is_floating_point():
            continue
        if value.data_ptr() not in moved:
            noise = torch.exp(0.02 * torch.randn(value.shape, generator=generator))
            moved[value.data_ptr()] = value * noise + (0 if key.endswith("running_var") else 0.001)
        state[key] = moved[value.data_ptr()]
    return state


def public(state: State, prefix: str = "") -> dict[str, Any]:
    """A published checkpoint's layout."""
    return {
        "model": {prefix + key: value for key, value in state.items()},
        "global_step": 200_000,
        "epoch": 20,
    }


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Base, a and b of 250 MB each, with the configuration beside them."""
    place = tmp_path_factory.mktemp("foundation_stereo")
    (place / "cfg.yaml").write_text(CONFIG)
    with torch.random.fork_rng():
        torch.manual_seed(0)
        base = foundation_stereo(vit_size="vits").state_dict()
    torch.save(public(base), place / "base.pth")
    torch.save(public(source_of(base, 1), prefix="module."), place / "a.pth")
    torch.save(public(source_of(base, 2)), place / "b.pth")
    yield place
    shutil.rmtree(place)


@pytest.fixture(scope="module")
def pool(folder: Path) -> Pool:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        return opened(folder, "a", "b")


def opened(folder: Path, *names: str) -> Pool:
    base, *sources = (Member(name, folder / f"{name}.pth") for name in ("base", *names))
    spec = PoolSpec("public", "foundation-stereo", base, tuple(sources))
    return open_pool(spec, cache=VectorCache(folder / "cache"))


def state_of(path: Path) -> State:
    state: State = torch.load(path, weights_only=True, mmap=True)["model"]
    return {key.removeprefix("module."): value for key, value in state.items()}


def test_the_configuration_beside_the_base_gives_the_options(pool: Pool) -> None:
    expected = {"vit_size": "vits", "max_disp": 64, "iterations": 2, "mixed_precision": True}
    assert {key: pool.options[key] for key in expected} == expected
    assert pool.describe()["options"] == pool.options, "they are part of every evaluation's key"


def test_the_frozen_vit_and_dead_tensors_are_left_out_of_the_search(pool: Pool) -> None:
    """Sizes as published: 62,335,403 parameters, of which the ViT has 24,785,089."""
    changed = {spec.key: spec for spec, _ in pool.layout.entries}
    assert not any(key.startswith(VIT) or any(fnmatchcase(key, glob) for glob in DEAD) for key in changed)
    with torch.device("meta"):
        network = foundation_stereo(vit_size="vits")
    dead = sum(
        parameter.numel()
        for key, parameter in network.named_parameters()
        if any(fnmatchcase(key, glob) for glob in DEAD)
    )
    weights = [spec.size for spec in changed.values() if spec.kind is Kind.WEIGHT]
    assert sum(weights) == 62_335_403 - 24_785_089 - dead
    sizes = {
        name: {s.kind: s.stop - s.start for s in pool.layout.segments if s.block == block}
        for block, name in enumerate(pool.blocks)
    }
    assert sum(sizes["backbone"].values()) == 5_281_224
    assert sizes["cost_volume"][Kind.WEIGHT] == 4_884_939
    assert all(s.block != OUTSIDE for s in pool.layout.segments)


def test_a_shared_tensor_is_merged_once(pool: Pool) -> None:
    changed = [spec for spec, _ in pool.layout.entries]
    for place in SHARED:
        found = [s for s in changed if s.key.startswith((f"{place}.downsample.1.", f"{place}.norm3."))]
        assert len(found) == 4, "weight, bias and two running statistics, under one of two names each"
        assert all(len(spec.aliases) == 1 for spec in found)
    live = pool.merge(pool.uniform()).network.state_dict(keep_vars=True)
    for place in SHARED:
        one, other = (live[f"{place}.{part}.weight"] for part in ("downsample.1", "norm3"))
        assert one is other


def test_the_merged_file_loads_strictly_in_the_public_layout(folder: Path, pool: Pool) -> None:
    written = save_merged(pool, pool.uniform(), folder / "merged.pth", form=FileForm.ORIGINAL)
    content = torch.load(written, weights_only=True)
    state, base, a, b = content["model"], *(state_of(folder / f"{name}.pth") for name in ("base", "a", "b"))
    assert (content["global_step"], content["epoch"]) == (200_000, 20)
    assert list(state) == list(base)
    network = foundation_stereo(**pool.options)
    network.load_state_dict(state, strict=True)

    merged = {spec.key for spec, _ in pool.layout.entries}
    merged |= {alias for spec, _ in pool.layout.entries for alias in spec.aliases}
    for key, value in state.items():
        if key in merged:
            mean = (a[key].double() + b[key].double()) / 2
            assert torch.allclose(value.double(), mean, atol=1e-6), key
        else:
            assert torch.equal(value, base[key]), key
    for place in SHARED:
        for leaf in ("weight", "bias", "running_mean", "running_var", "num_batches_tracked"):
            assert torch.equal(state[f"{place}.downsample.1.{leaf}"], state[f"{place}.norm3.{leaf}"])

    again = opened_from(folder, "merged", "a")
    assert again.base.layout == pool.base.layout
    assert again.base.fingerprint not in pool.identity.values()


def opened_from(folder: Path, base: str, source: str) -> Pool:
    members = (Member(name, folder / f"{name}.pth") for name in (base, source))
    spec = PoolSpec("again", "foundation-stereo", next(members), tuple(members))
    return open_pool(spec, cache=VectorCache(folder / "cache"))


def test_live_and_loaded_networks_agree(folder: Path, pool: Pool) -> None:
    recipe = pool.equal("b")
    live = pool.merge(recipe)
    loaded = load_network(save_merged(pool, recipe, folder / "merged.safetensors"))
    assert isinstance(loaded.network, FoundationStereo)
    assert loaded.name == "foundation-stereo"
    expected, found = loaded.network.state_dict(), live.network.state_dict()
    assert all(torch.equal(found[key], expected[key]) for key in expected)
    left, right = 255 * torch.rand(2, 1, 3, 64, 96, generator=torch.Generator().manual_seed(0))
    with torch.inference_mode():
        disparity = loaded.network(left, right)[0]
    assert torch.allclose(live.disparity(left, right), disparity, atol=1e-4)
    assert bool(disparity.isfinite().all())


def test_a_source_whose_vit_differs_is_pointed_out_by_its_tensors(folder: Path, pool: Pool) -> None:
    state = state_of(folder / "a.pth")
    keys = [f"{VIT}depth_anything.pretrained.blocks.{n}.norm1.bias" for n in (0, 7)]
    moved = {key: value + 0.01 if key in keys else value for key, value in state.items()}
    torch.save(public(moved), folder / "c.pth")
    try:
        with pytest.warns(SfkitWarning, match="changed 2 tensors that are frozen") as heard:
            other = opened(folder, "b", "c")
    finally:
        (folder / "c.pth").unlink()
    (said,) = (str(warning.message) for warning in heard)
    assert said.startswith(f"{folder / 'c.pth'}: source 'c' changed 2 tensors that are frozen")
    assert all(key in said for key in keys)
    assert {spec.key for spec, _ in other.layout.entries if spec.key.startswith(VIT)} == set(keys)
    merged = other.state_dict(other.equal("b", "c"))
    assert torch.allclose(merged[keys[0]], state[keys[0]] + 0.005, atol=1e-6), "b has the base's there"
    assert other.vectors["b"].shape == other.vectors["c"].shape == (pool.layout.size + 2 * 384,)


def test_published_keys_are_what_a_pool_expects(shipped_goldens: Path) -> None:
    """The real key list of ViT-L, with shapes: strict in both directions."""
    entry = architecture("foundation-stereo")
    specs = tensor_specs(entry, entry.resolve({"vit_size": "vitl"}))
    found = {key: spec.shape for spec in specs for key in (spec.key, *spec.aliases)}
    assert found == {key: shape for key, (shape, _) in key_list(shipped_goldens, "vitl").items()}
