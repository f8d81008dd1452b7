"""NMRF's state dicts: the published keys, the blocks, and the layouts checkpoints come in."""

from __future__ import annotations

import json
from fnmatch import fnmatchcase
from pathlib import Path

import pytest
import torch

from sfkit.architectures import architecture
from sfkit.checkpoints import Member, PoolSpec
from sfkit.errors import InputError
from sfkit.merging import open_pool

KEY_FILES = {"nmrf-res": "nmrf_keys.json", "nmrf-swint": "nmrf_swint_keys.json"}
NAMES = tuple(KEY_FILES)

# Tensors and scalars of each block, counted on the original networks.
BLOCKS = {
    "nmrf-swint": {
        "backbone": (169, 27_517_818),
        "neck": (101, 425_088),
        "cost_volume": (111, 1_310_602),
        "head": (210, 3_294_608),
    },
    "nmrf-res": {
        "backbone": (17, 1_032_608),
        "neck": (2, 33_024),
        "cost_volume": (111, 1_458_058),
        "head": (210, 3_589_520),
    },
}

State = dict[str, torch.Tensor]


@pytest.fixture(scope="module")
def networks() -> dict[str, torch.nn.Module]:
    return {name: architecture(name).build() for name in NAMES}


@pytest.mark.parametrize("name", NAMES)
def test_state_dict_is_the_published_one(
    shipped_goldens: Path, networks: dict[str, torch.nn.Module], name: str
) -> None:
    published = json.loads((shipped_goldens / "nmrf" / KEY_FILES[name]).read_text())
    parameters = dict(networks[name].named_parameters())
    found = {
        key: {
            "shape": list(tensor.shape),
            "dtype": str(tensor.dtype).removeprefix("torch."),
            "kind": "param" if key in parameters else "buffer",
        }
        for key, tensor in networks[name].state_dict().items()
    }
    assert found == published
    assert list(found) == list(published)


@pytest.mark.parametrize("name", NAMES)
def test_blocks_hold_every_parameter_exactly_once(networks: dict[str, torch.nn.Module], name: str) -> None:
    blocks = architecture(name).blocks({})
    counts = {block: [0, 0] for block in blocks}
    for key, parameter in networks[name].named_parameters():
        (owner,) = [b for b, globs in blocks.items() if any(fnmatchcase(key, g) for g in globs)]
        counts[owner][0] += 1
        counts[owner][1] += parameter.numel()
    assert {block: tuple(count) for block, count in counts.items()} == BLOCKS[name]


@pytest.mark.parametrize("name", NAMES)
def test_constants_are_exactly_the_buffers(networks: dict[str, torch.nn.Module], name: str) -> None:
    network, globs = networks[name], architecture(name).constants
    constant = {k for k in network.state_dict() if any(fnmatchcase(k, g) for g in globs)}
    assert constant == {key for key, _ in network.named_buffers()}


@pytest.mark.parametrize(
    ("name", "prefix", "alias"),
    [("nmrf-res", "backbone", "image_encoder"), ("nmrf-swint", "image_encoder", "backbone")],
)
def test_the_other_compat_prefix_is_renamed(
    networks: dict[str, torch.nn.Module], name: str, prefix: str, alias: str
) -> None:
    rename = architecture(name).rename
    assert rename is not None
    keys = list(networks[name].state_dict())
    saved = [alias + k.removeprefix(prefix) if k.startswith(prefix + ".") else k for k in keys]
    assert saved != keys
    assert list(rename(saved).values()) == keys
    assert list(rename(keys).values()) == keys


def _saved(state: State, path: Path, layout: str) -> Path:
    prefixed = {"module." + key: tensor for key, tensor in state.items()}
    content = {
        "bare": state,
        "module": prefixed,
        "model": {"model": state, "optimizer": {"state": {}, "param_groups": []}, "step": 7, "epoch": 1},
        "model_state": {"model_state": state},
    }[layout]
    torch.save(content, path)
    return path


def _pool(folder: Path, name: str) -> PoolSpec:
    base, source = (Member(part, folder / f"{part}.pth") for part in ("base", "source"))
    return PoolSpec("pool", name, base, (source,))


@pytest.mark.parametrize("layout", ["bare", "module", "model", "model_state"])
def test_pool_opens_the_layouts_in_use(
    networks: dict[str, torch.nn.Module], tmp_path: Path, layout: str
) -> None:
    state = dict(networks["nmrf-res"].state_dict())
    _saved(state, tmp_path / "base.pth", layout)
    moved = state | {"refinement.norm.bias": state["refinement.norm.bias"] + 1}
    moved["inference.layers.0.nmp.attn.relative_position_index"] = torch.zeros(36, 36, dtype=torch.int64)
    _saved(moved, tmp_path / "source.pth", layout)
    pool = open_pool(_pool(tmp_path, "nmrf-res"))
    assert [spec.key for spec, _ in pool.layout.entries] == ["refinement.norm.bias"]


@pytest.mark.parametrize(("read_as", "saved_as"), [NAMES, NAMES[::-1]])
def test_the_other_variants_checkpoint_is_refused_in_a_sentence(
    networks: dict[str, torch.nn.Module], tmp_path: Path, read_as: str, saved_as: str
) -> None:
    state = dict(networks[saved_as].state_dict())
    _saved(state, tmp_path / "base.pth", "model")
    _saved(state, tmp_path / "source.pth", "model")
    with pytest.raises(
        InputError, match=f"expected the .* encoder of architecture '{read_as}': open it as '{saved_as}'"
    ):
        open_pool(_pool(tmp_path, read_as))


def test_check_passes_its_own_variant_and_leaves_other_defects_to_strict_loading() -> None:
    check = architecture("nmrf-res").check
    assert check is not None
    check({"backbone.conv1.weight": (64, 3, 7, 7)}, {})
    check({"image_encoder.layer1.0.conv1.weight": (64, 64, 3, 3)}, {})
    check({"dpn.mlp.0.bias": (8,)}, {})
    with pytest.raises(InputError, match=r"'backbone\.backbone\.patch_embed\.proj\.bias' of a Swin-T"):
        check({"backbone.backbone.patch_embed.proj.bias": (96,)}, {})
