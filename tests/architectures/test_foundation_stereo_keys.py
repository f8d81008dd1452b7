"""FoundationStereo's parameters against the lists of the published checkpoints."""

from __future__ import annotations

from fnmatch import fnmatchcase
from pathlib import Path

import pytest
import torch
from foundation_stereo_reference import key_list, partition, skeleton

from sfkit.architectures import architecture
from sfkit.architectures.foundation_stereo import foundation_stereo

# Parameters a block, aliases once, buffers not counted: the specification's table.
COUNTS = {
    "vits": {
        "backbone": 24_785_089 + 5_281_224,
        "neck": 4_873_836,
        "cost_volume": 4_884_939,
        "head": 22_510_315,
    },
    "vitb": {
        "backbone": 97_470_785 + 5_281_224,
        "neck": 5_289_068,
        "cost_volume": 4_890_027,
        "head": 22_547_179,
    },
    "vitl": {
        "backbone": 335_315_649 + 5_281_224,
        "neck": 6_396_012,
        "cost_volume": 4_903_275,
        "head": 22_620_907,
    },
}
TOTALS = {"vits": 62_335_403, "vitb": 135_478_283, "vitl": 374_517_067}
sizes = pytest.mark.parametrize("vit_size", COUNTS)


def blocks_of(key: str) -> list[str]:
    blocks = architecture("foundation-stereo").blocks({})
    return [name for name, globs in blocks.items() if any(fnmatchcase(key, glob) for glob in globs)]


@sizes
def test_the_state_dict_has_the_published_keys_shapes_and_types(shipped_goldens: Path, vit_size: str) -> None:
    state = skeleton(vit_size=vit_size).state_dict()
    ours = {key: (tuple(t.shape), str(t.dtype).removeprefix("torch.")) for key, t in state.items()}
    assert ours == key_list(shipped_goldens, vit_size)


@sizes
def test_four_blocks_hold_every_key_exactly_once(vit_size: str) -> None:
    found = {key: blocks_of(key) for key in skeleton(vit_size=vit_size).state_dict()}
    assert {key: names for key, names in found.items() if len(names) != 1} == {}


@sizes
def test_blocks_have_the_published_numbers_of_parameters(vit_size: str) -> None:
    counts = dict.fromkeys(COUNTS[vit_size], 0)
    for key, parameter in skeleton(vit_size=vit_size).named_parameters():
        counts[blocks_of(key)[0]] += parameter.numel()
    assert counts == COUNTS[vit_size]
    assert sum(counts.values()) == TOTALS[vit_size]


@sizes
def test_blocks_have_the_published_numbers_of_keys(shipped_goldens: Path, vit_size: str) -> None:
    published = partition(shipped_goldens)["counts"][vit_size]
    expected = {name: published[name]["keys"] for name in ("neck", "cost_volume", "head")}
    expected["backbone"] = published["backbone"]["keys"] + published["backbone_frozen_vit"]["keys"]
    found = dict.fromkeys(expected, 0)
    for key in skeleton(vit_size=vit_size).state_dict():
        found[blocks_of(key)[0]] += 1
    assert found == expected


@sizes
def test_the_dead_globs_name_exactly_the_keys_without_influence(shipped_goldens: Path, vit_size: str) -> None:
    published = partition(shipped_goldens)
    globs = architecture("foundation-stereo").dead
    dead = {
        key for key in skeleton(vit_size=vit_size).state_dict() if any(fnmatchcase(key, g) for g in globs)
    }
    assert dead == {*published["dead_parameters"], *published["dead_buffers"]}


def test_exactly_the_monocular_branch_is_frozen() -> None:
    parameters = dict(skeleton(vit_size="vits").named_parameters())
    frozen = {key for key, parameter in parameters.items() if not parameter.requires_grad}
    assert frozen == {key for key in parameters if key.startswith("feature.dino.")}


def test_aliased_keys_share_their_tensor_after_a_strict_load(shipped_goldens: Path) -> None:
    network = foundation_stereo(vit_size="vits")
    network.load_state_dict({key: t.clone() for key, t in network.state_dict().items()}, strict=True)
    state = network.state_dict()
    by_tensor: dict[int, list[str]] = {}
    for key, tensor in state.items():
        by_tensor.setdefault(tensor.data_ptr(), []).append(key)
    aliases = {tuple(sorted(pair)) for pair in partition(shipped_goldens)["aliases"].items()}
    assert len(aliases) == 20
    assert {tuple(sorted(keys)) for keys in by_tensor.values() if len(keys) > 1} == aliases


def test_a_file_in_the_published_layout_loads_strictly(tmp_path: Path) -> None:
    source = foundation_stereo(vit_size="vits").state_dict()
    path = tmp_path / "model_best_bp2.pth"
    torch.save({"model": source, "global_step": 7, "epoch": 1}, path)
    network = foundation_stereo(vit_size="vits")
    content = torch.load(path, weights_only=True)
    network.load_state_dict(content["model"], strict=True)
    assert all(torch.equal(tensor, source[key]) for key, tensor in network.state_dict().items())
