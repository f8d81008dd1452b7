"""Pools: opening, checking, live networks, saving; on files like those users have."""

from __future__ import annotations

import warnings
from collections import OrderedDict
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file, save_file
from tiny import base_state, fine_tune, write_pool
from torch import nn

from sfkit import bank
from sfkit.architectures import register_architecture
from sfkit.checkpoints.checks import Kind
from sfkit.checkpoints.spec import Member, PoolSpec
from sfkit.checkpoints.targets import FileForm
from sfkit.errors import InputError, SfkitWarning
from sfkit.merging import Pool, Recipe, open_pool
from sfkit.merging.members import PoolOpener
from sfkit.merging.network import load_network
from sfkit.merging.origin import read_origin, read_recipe
from sfkit.merging.saving import save_merged


@pytest.fixture(scope="module")
def pool(tmp_path_factory: pytest.TempPathFactory) -> Pool:
    return open_pool(write_pool(tmp_path_factory.mktemp("pool")))


def test_merging_one_source_gives_that_source(pool: Pool) -> None:
    state = pool.state_dict(pool.equal("b"))
    original = load_file(pool.sources[1].path)
    assert state.keys() == original.keys()
    for key, tensor in original.items():
        assert state[key].dtype == tensor.dtype
        assert torch.allclose(state[key].float(), tensor.float(), atol=1e-6), key


def test_equal_weights_are_the_mean_of_the_state_dicts(pool: Pool) -> None:
    """Eq. 4 on whole files: base + mean of task vectors is the mean of the fine-tuned weights."""
    states = [load_file(source.path) for source in pool.sources]
    merged = pool.state_dict(pool.uniform())
    for key in merged:
        if merged[key].is_floating_point():
            mean = sum(state[key].double() for state in states) / len(states)
            assert torch.allclose(merged[key].double(), mean, atol=1e-6), key


def test_the_order_of_sources_changes_no_bit(pool: Pool) -> None:
    size = pool.layout.size
    one = pool.merge_into(pool.equal("a", "b", "c"), torch.empty(size))
    other = pool.merge_into(pool.equal("c", "a", "b"), torch.empty(size))
    assert torch.equal(one, other)


def test_the_live_model_is_made_of_views(pool: Pool) -> None:
    live = pool.merge(pool.equal("a"))
    start, stop = live.flat.data_ptr(), live.flat.data_ptr() + 4 * live.flat.numel()
    names = {spec.key for spec, _ in pool.layout.entries}
    held = dict(live.network.state_dict(keep_vars=True))
    assert all(start <= held[name].data_ptr() < stop for name in names)
    before = {name: held[name].clone() for name in names}
    live.apply(pool.equal("a", "b"))
    assert all(not torch.equal(before[name], held[name]) for name in names), "in place, no state dict loaded"


def test_a_live_network_equals_one_loaded_from_the_merged_file(pool: Pool, tmp_path: Path) -> None:
    """Also after other recipes passed through it: no part of the network may keep stale weights."""
    recipe = pool.equal("a", "c")
    live = pool.merge(pool.uniform())
    left, right = torch.randn(2, 1, 3, 32, 64, generator=torch.Generator().manual_seed(1)).unbind(0)
    live.disparity(left, right)
    live.apply(recipe)
    saved = load_network(save_merged(pool, recipe, tmp_path / "merged.safetensors"))
    with torch.inference_mode():
        expected = saved.network(left, right)
    assert torch.allclose(live.disparity(left, right), expected.reshape(32, 64), atol=1e-5)


@pytest.mark.parametrize(
    ("name", "form"), [("m.safetensors", FileForm.SAFETENSORS), ("m.pth", FileForm.ORIGINAL)]
)
def test_a_merged_file_is_as_readable_as_any_other(
    pool: Pool, tmp_path: Path, name: str, form: FileForm
) -> None:
    (tmp_path / "plain").touch()
    written = save_merged(pool, pool.equal("a"), tmp_path / name, form=form)
    assert written.stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_the_merged_file_tells_its_origin(pool: Pool, tmp_path: Path) -> None:
    recipe = Recipe.weighted({"a": 0.25, "b": 0.75, "c": 0.0}, pool.blocks, scale=1.25)
    path = save_merged(pool, recipe, tmp_path / "merged.safetensors")
    origin = read_origin(path)
    assert origin is not None
    assert origin.recipe == recipe == read_recipe(path)
    assert origin.sources.keys() == {"a", "b"}, "a source without weight is no part of the network"
    assert origin.sources["a"]["fingerprint"] == pool.identity["a"]
    assert origin.licences == {"base": "CC0-1.0", "a": "licence of a", "b": "licence of b"}
    rebuilt = pool.state_dict(origin.recipe)
    assert all(torch.equal(rebuilt[key], tensor) for key, tensor in load_file(path).items())


@pytest.mark.parametrize("container", [None, "state_dict", "model_state", "model"])
@pytest.mark.parametrize("prefix", ["", "module."])
def test_original_layouts_come_back(tmp_path: Path, container: str | None, prefix: str) -> None:
    base = {prefix + key: tensor for key, tensor in base_state().items()}
    torch.save({container: base, "epoch": 3} if container else OrderedDict(base), tmp_path / "base.pth")
    save_file(fine_tune(base_state(), 1), tmp_path / "a.safetensors")
    spec = PoolSpec(
        "p", "anynet", Member("base", tmp_path / "base.pth"), (Member("a", tmp_path / "a.safetensors"),),
        {"ranges": [4, 3, 3], "spn": False},
    )  # fmt: skip
    opened = open_pool(spec)
    path = save_merged(opened, opened.equal("a"), tmp_path / "out.pth", form=FileForm.ORIGINAL)
    loaded = torch.load(path, weights_only=True)
    state = loaded[container] if container else loaded
    assert list(state) == list(base)
    assert read_recipe(path) == opened.equal("a")


def test_fingerprints_do_not_depend_on_wrapping(tmp_path: Path) -> None:
    state = base_state()
    write_pool(tmp_path, 1)
    wrapped = {"state_dict": {f"module.{k}": v for k, v in fine_tune(state, 1).items()}}
    torch.save(wrapped, tmp_path / "a.tar")
    text = (tmp_path / "pool.toml").read_text()
    first = open_pool(tmp_path / "pool.toml").identity
    (tmp_path / "pool.toml").write_text(text.replace("a.safetensors", "a.tar"))
    assert open_pool(tmp_path / "pool.toml").identity == first


def test_counters_may_be_absent_or_differ(tmp_path: Path) -> None:
    path = write_pool(tmp_path)
    state = {k: v for k, v in load_file(tmp_path / "a.safetensors").items() if "num_batches" not in k}
    save_file(state, tmp_path / "a.safetensors")
    pool = open_pool(path)
    assert "feature_extraction.block0.0.1.0.num_batches_tracked" in pool.state_dict(pool.equal("a"))


def test_a_missing_optional_part_is_a_zero_task_vector(tmp_path: Path) -> None:
    with torch.random.fork_rng():
        torch.manual_seed(0)
        from sfkit.architectures import architecture

        base = {k: v.clone() for k, v in architecture("anynet").build(ranges=(4, 3, 3)).state_dict().items()}
    save_file(base, tmp_path / "base.safetensors")
    save_file(fine_tune(base, 1), tmp_path / "a.safetensors")
    lacking = {k: v for k, v in fine_tune(base, 2).items() if not k.startswith("refine_spn")}
    save_file(lacking, tmp_path / "b.safetensors")
    members = [Member(n, tmp_path / f"{n}.safetensors") for n in ("base", "a", "b")]
    spec = PoolSpec("p", "anynet", members[0], tuple(members[1:]), {"ranges": [4, 3, 3]})
    with pytest.warns(SfkitWarning, match="source 'b' lacks 6 optional tensors"):
        pool = open_pool(spec)
    merged, key = pool.state_dict(pool.equal("a", "b")), "refine_spn.1.weight"
    full = load_file(tmp_path / "a.safetensors")[key]
    assert torch.allclose(merged[key], base[key] + (full - base[key]) / 2, atol=1e-6), "not renormalised"
    save_file(lacking, tmp_path / "base.safetensors")
    with pytest.raises(InputError, match=r"base\.safetensors: .*is missing.*spn = false"):
        open_pool(spec)


def test_unchanged_tensors_are_left_out_of_the_buffers(tmp_path: Path) -> None:
    path = write_pool(tmp_path, 2)
    base = load_file(tmp_path / "base.safetensors")
    for name in ("a", "b"):
        state = load_file(tmp_path / f"{name}.safetensors")
        frozen = {k: base[k] if k.startswith("feature_extraction") else v for k, v in state.items()}
        save_file(frozen, tmp_path / f"{name}.safetensors")
    pool = open_pool(path)
    assert not any(spec.key.startswith("feature_extraction") for spec, _ in pool.layout.entries)
    merged = pool.state_dict(pool.uniform())
    assert torch.equal(
        merged["feature_extraction.block0.0.0.weight"], base["feature_extraction.block0.0.0.weight"]
    )


def test_a_random_network_is_no_fine_tune(tmp_path: Path) -> None:
    path = write_pool(tmp_path, 2)
    save_file(base_state(seed=99), tmp_path / "b.safetensors")
    with pytest.warns(SfkitWarning, match="source 'b' does not look like a fine-tune of the base"):
        open_pool(path)


def test_the_base_as_a_source_is_pointed_out(tmp_path: Path) -> None:
    path = write_pool(tmp_path, 2)
    save_file(base_state(), tmp_path / "b.safetensors")
    with pytest.warns(SfkitWarning, match="source 'b' is the base itself"):
        open_pool(path)


def test_twins_are_refused(tmp_path: Path) -> None:
    path = write_pool(tmp_path, 2)
    save_file(load_file(tmp_path / "a.safetensors"), tmp_path / "b.safetensors")
    with pytest.raises(InputError, match="source 'b' has the same content as source 'a'"):
        open_pool(path)


def test_files_are_read_one_at_a_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Files that cannot be mapped (as torch wrote them before 1.6) are never in memory together."""
    write_pool(tmp_path, 3)
    for name in ("base", "a", "b", "c"):
        state = load_file(tmp_path / f"{name}.safetensors")
        torch.save(state, tmp_path / f"{name}.pth", _use_new_zipfile_serialization=False)
    text = (tmp_path / "pool.toml").read_text().replace(".safetensors", ".pth")
    (tmp_path / "pool.toml").write_text(text)
    opener_headers = PoolOpener.headers

    def headers(self: PoolOpener, members: object) -> object:
        files = opener_headers(self, members)  # type: ignore[arg-type]
        assert files == [None] * 4
        return files

    monkeypatch.setattr(PoolOpener, "headers", headers)
    assert open_pool(tmp_path / "pool.toml").names == ("a", "b", "c")


class Shared(nn.Module):
    """Two keys of one tensor, a buffer that is a constant, and running statistics."""

    def __init__(self) -> None:
        super().__init__()
        self.first = nn.Linear(2, 2, bias=False)
        self.second = nn.Linear(2, 2, bias=False)
        self.second.weight = self.first.weight
        self.norm = nn.BatchNorm1d(2)
        self.register_buffer("mean", torch.tensor([0.5]))

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        return left[:, 0] - right[:, 0]


def test_aliases_are_merged_once_and_written_twice(tmp_path: Path) -> None:
    register_architecture("shared-weights", blocks={"all": ["*"]})(Shared)
    for number, name in enumerate(("base", "a")):
        network = Shared()
        nn.init.constant_(network.first.weight, 1.0 + number)
        torch.save(network.state_dict(), tmp_path / f"{name}.pth")
    members = [Member(n, tmp_path / f"{n}.pth") for n in ("base", "a")]
    pool = open_pool(PoolSpec("p", "shared-weights", members[0], (members[1],)))
    kinds = {spec.key: spec.kind for spec in pool.specs}
    assert kinds == {
        "first.weight": Kind.WEIGHT, "norm.weight": Kind.WEIGHT, "norm.bias": Kind.WEIGHT,
        "norm.running_mean": Kind.STATISTIC, "norm.running_var": Kind.STATISTIC,
        "norm.num_batches_tracked": Kind.CONSTANT, "mean": Kind.CONSTANT,
    }  # fmt: skip
    assert pool.layout.size == 4, "one storage, merged once"
    written = load_file(save_merged(pool, pool.equal("a"), tmp_path / "m.safetensors"))
    assert torch.equal(written["first.weight"], written["second.weight"])
    assert written["first.weight"].unique().tolist() == [2.0]
    live = pool.merge(pool.equal("a")).network
    assert live.first.weight is live.second.weight


def test_real_checkpoints_open_without_a_warning(real_data: Path) -> None:
    path = Path(__file__).parents[1] / "pools" / "anynet_real.toml"
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        pool = open_pool(path)
    assert all(0.96 < source.kinship.cosine < 0.98 for source in pool.sources)
    layout = torch.load(real_data / "anynet" / "base_sceneflow.tar", map_location="cpu", weights_only=True)
    assert {f"module.{key}" for key in pool.base_tensors} == set(layout["state_dict"])


def test_task_arithmetic_on_real_weights_stays_finite(real_data: Path) -> None:
    """Lambda = 1 drives seven real running variances below zero, and the output to NaN, if added plainly."""
    pool = open_pool(Path(__file__).parents[1] / "pools" / "anynet_real.toml")
    states = [
        torch.load(real_data / "anynet" / file, map_location="cpu", weights_only=True)["state_dict"]
        for file in ("base_sceneflow.tar", "ft_kitti2012_official.tar", "ft_kitti2015_official.tar")
    ]
    variances = [key for key in states[0] if key.endswith("running_var")]
    plain = torch.cat([states[1][key] + states[2][key] - states[0][key] for key in variances])
    assert int((plain < 0).sum()) == 7, "the trap is there"

    live = pool.merge(Recipe.weighted({"kitti2012": 1.0, "kitti2015": 1.0}, pool.blocks))

    merged = live.network.state_dict()
    assert all(bool((merged[key.removeprefix("module.")] > 0).all()) for key in variances)
    left, right = torch.randn(2, 1, 3, 64, 128, generator=torch.Generator().manual_seed(0)).unbind(0)
    assert bool(torch.isfinite(live.disparity(left, right)).all())


def test_checkpoints_of_another_architecture_are_told_so() -> None:
    folder = bank.pool_path().parent
    members = [Member(name, folder / f"{name}.safetensors") for name in ("base", "haze")]
    with pytest.raises(InputError, match=r"its keys are those of .*anynet.*: is architecture = 'nmrf-res'"):
        open_pool(PoolSpec("other", "nmrf-res", members[0], (members[1],)))
