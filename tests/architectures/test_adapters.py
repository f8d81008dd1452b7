"""Adapters against stand-ins: packages with the shape of a checkout and its way of being called."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from own_networks import NETWORK, write_pool, write_states
from stand_ins import STAND_INS, openstereo, write, write_stand_in
from torch import nn

import sfkit
from sfkit.architectures import architecture, registry
from sfkit.architectures.calling import Calling
from sfkit.architectures.code import tree_digest
from sfkit.architectures.module_blocks import ByNetwork
from sfkit.errors import InputError
from sfkit.merging.blocks import BlockPartition


def pool_of(name: str, folder: Path) -> sfkit.Pool:
    """A pool of the stand-in's networks."""
    return sfkit.open_pool(write_stand_in(name, folder))


@pytest.mark.parametrize("name", STAND_INS)
def test_each_gives_the_disparity_of_the_network_it_wraps(name: str, tmp_path: Path) -> None:
    pool = pool_of(name, tmp_path)
    namespace: dict[str, type[nn.Module]] = {}
    exec(NETWORK, namespace)  # noqa: S102 (the network itself, called plainly)
    plain = namespace["MyNet"]()
    plain.load_state_dict(pool.state_dict(pool.base_recipe()))
    left, right = torch.rand(2, 1, 3, 96, 192, generator=torch.Generator().manual_seed(1)) * 255
    raw = name in ("raft-stereo", "igev-stereo")
    expected = plain(*(image / 255 if raw else image for image in (left, right)))
    found = pool.merge(pool.base_recipe()).disparity(left, right)
    torch.testing.assert_close(found, expected[0].detach())


# What a network of the repository consists of: adapter, options, file, class, its modules -> blocks.
PARTS = {
    "raft-stereo": (
        {},
        "core/raft_stereo.py:RAFTStereo",
        ("cnet", "context_zqr_convs", "fnet", "update_block"),
        ["context", "features", "update"],
    ),
    "raft-stereo realtime": (
        {"shared_backbone": True},
        "core/raft_stereo.py:RAFTStereo",
        ("cnet", "context_zqr_convs", "conv2", "update_block"),
        ["context", "features", "update"],
    ),
    "gmstereo": (
        {},
        "unimatch/unimatch.py:UniMatch",
        ("backbone", "transformer", "feature_flow_attn", "refine", "refine_proj"),
        ["backbone", "transformer", "propagation", "refinement"],
    ),
    "gmstereo one scale": (
        {"num_scales": 1, "reg_refine": False},
        "unimatch/unimatch.py:UniMatch",
        ("backbone", "transformer", "feature_flow_attn", "upsampler"),
        ["backbone", "transformer", "propagation", "refinement"],
    ),
    "aanet": (
        {},
        "nets/__init__.py:AANet",
        ("feature_extractor", "fpn", "aggregation", "refinement"),
        ["backbone", "aggregation", "refinement"],
    ),
    "aanet unrefined": (
        {"refinement_type": "None"},
        "nets/__init__.py:AANet",
        ("feature_extractor", "fpn", "aggregation"),
        ["backbone", "aggregation"],
    ),
}


@pytest.mark.parametrize("name", PARTS)
def test_every_part_of_a_repositorys_network_lies_in_a_block(name: str, tmp_path: Path) -> None:
    options, place, parts, expected = PARTS[name]
    file, _, kind = place.partition(":")
    layers = "".join(f"\n        self.{part} = nn.Linear(1, 1)" for part in parts)
    text = (
        f"class {kind}(nn.Module):\n    def __init__(self, *_, **__):\n        super().__init__(){layers}\n"
    )
    write(tmp_path, {file: f"from torch import nn\n\n{text}"})
    entry = architecture(name.split()[0])
    resolved = entry.resolve({"root": str(tmp_path), **options})
    keys = [key for key, _ in entry.build(**resolved).named_parameters()]
    partition = BlockPartition.of(entry.blocks(resolved))
    partition.check(keys)
    assert list(partition.names) == expected
    assert all(partition.block_of(key) >= 0 for key in keys)


def test_opening_a_pool_builds_its_network_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_REGISTRY", dict(registry._REGISTRY))  # no other test shall recognise it
    namespace: dict[str, type[nn.Module]] = {}
    exec(NETWORK, namespace)  # noqa: S102 (a network of a user's)
    built = []

    def build() -> nn.Module:
        built.append(namespace["MyNet"]())
        return built[-1]

    globs = {"features": ["features.*", "fpn.*"], "head": ["head.*"], "refinement": ["refinement.*"]}
    sfkit.register_architecture("counted", blocks=ByNetwork.fitting(globs), version="1")(build)
    write_states(tmp_path)
    pool = sfkit.open_pool(write_pool(tmp_path, 'architecture = "counted"'))
    assert pool.blocks == ("features", "head")
    assert len(built) == 1
    assert architecture("counted").blocks({}) == {"features": ["features.*"], "head": ["head.*"]}


def test_a_changed_checkout_is_another_version_and_its_place_is_none(tmp_path: Path) -> None:
    described = [pool_of("raft-stereo", tmp_path / place).describe() for place in ("here", "there")]
    assert described[0] == described[1]
    (tmp_path / "here" / "checkout" / "core" / "parts.py").write_text(NETWORK + "# changed\n")
    entry = architecture("raft-stereo")
    options = entry.resolve({"root": str(tmp_path / "here" / "checkout")})
    assert entry.version_of(options) != described[0]["version"]


def test_the_configuration_says_how_images_become_input(tmp_path: Path) -> None:
    inputs = architecture("openstereo").inputs(
        {"root": str(openstereo(tmp_path)), "cfg": "lightstereo/s.yaml"}
    )
    assert inputs == sfkit.InputConvention(1 / 255, (0.5,) * 3, (0.25,) * 3, 16, sfkit.PadSides.TOP_RIGHT)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "the option root is missing, expected your checkout of XiandaGuo/OpenStereo"),
        ({"root": "{root}", "cfg": "gone.yaml"}, r"gone\.yaml: no such file"),
    ],
)
def test_openstereo_refusals(options: dict[str, str], message: str, tmp_path: Path) -> None:
    root = str(openstereo(tmp_path))
    filled = {key: value.format(root=root) for key, value in options.items()}
    entry = architecture("openstereo")
    with pytest.raises(InputError, match=message):
        entry.build(**entry.resolve(filled))


@pytest.mark.parametrize("name", ["AANet", "CFNet", "NMRF", "STTR", "IInet", "MonSter"])
def test_models_of_openstereo_that_need_a_gpu_are_refused_by_name(name: str, tmp_path: Path) -> None:
    root = openstereo(tmp_path)
    (root / "cfgs" / "model.yaml").write_text(f"MODEL: {{ NAME: {name} }}")
    entry = architecture("openstereo")
    with pytest.raises(InputError, match=f"OpenStereo's {name} is not offered: .* does not run on a CPU"):
        entry.build(**entry.resolve({"root": str(root), "cfg": "model.yaml"}))


def test_an_aanet_without_its_extension_says_what_to_build(tmp_path: Path) -> None:
    write(tmp_path, {"nets/deform_conv/__init__.py": "from . import deform_conv_cuda"})
    with pytest.raises(InputError, match=r"nets/deform_conv: its CUDA extension is not built.*build\.sh"):
        architecture("aanet").build(root=str(tmp_path))


@pytest.mark.parametrize(
    ("calling", "output"),
    [
        (Calling(output="last"), lambda d: [d * 0, d]),
        (Calling(output="first"), lambda d: (d, None)),
        (Calling(output="key:disp"), lambda d: {"disp": d[:, None]}),
        (Calling(output=("last", "negated")), lambda d: [torch.stack([-d, d * 0], 1)]),
        (Calling(output="fraction"), lambda d: d / 32),
        (Calling(resolution=4), lambda d: d[:, ::4, ::4] / 4),
    ],
)
def test_outputs(calling: Calling, output: Callable[[torch.Tensor], object]) -> None:
    disparity = torch.full((1, 16, 32), 5.0)
    images = torch.zeros(1, 3, 16, 32)
    torch.testing.assert_close(calling.call(lambda *_: output(disparity), images, images), disparity)


def test_unknown_words_are_refused() -> None:
    with pytest.raises(InputError, match=r"unknown step of a network's output 'negative'.*'negated'"):
        Calling(output="negative")
    with pytest.raises(InputError, match="unknown form of a network's input"):
        Calling(form="dict")
    with pytest.raises(InputError, match="resolution is 0"):
        Calling(resolution=0)


def test_digests_leave_hidden_folders_out(tmp_path: Path) -> None:
    write(tmp_path, {"a.py": "1", ".venv/b.py": "2"})
    before = tree_digest(tmp_path)
    write(tmp_path, {".venv/b.py": "3"})
    assert tree_digest(tmp_path) == before
