"""FoundationStereo's options, its configuration file and its entry in the registry."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest
from foundation_stereo_reference import skeleton

from sfkit.architectures import PadSides, architecture
from sfkit.architectures.foundation_stereo import (
    FoundationStereo,
    hierarchical_disparity,
    options_from_config,
)
from sfkit.errors import InputError

PUBLISHED = """
corr_implementation: reg
corr_levels: 2
corr_radius: 4
hidden_dims:
- 128
- 128
- 128
low_memory: 0
max_disp: 416
mixed_precision: true
n_downsample: 2
n_gru_layers: 3
slow_fast_gru: false
train_iters: 22
valid_iters: 32
vit_size: vits
"""


def config(folder: Path, text: str) -> Path:
    path = folder / "cfg.yaml"
    path.write_text(text, encoding="utf-8")
    return path


def test_a_published_configuration_becomes_options(tmp_path: Path) -> None:
    options = options_from_config(config(tmp_path, PUBLISHED))
    assert options == {
        "vit_size": "vits",
        "max_disp": 416,
        "iterations": 32,
        "mixed_precision": True,
        "low_memory": False,
    }
    assert isinstance(options["low_memory"], bool)
    entry = architecture("foundation-stereo")
    assert entry.resolve(options) == {**options, "disparity_attention": "disparity"}
    assert isinstance(skeleton(**options), FoundationStereo)


def test_a_configuration_without_a_size_is_the_large_one(tmp_path: Path) -> None:
    assert options_from_config(config(tmp_path, "max_disp: 192")) == {"vit_size": "vitl", "max_disp": 192}


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("vit_size: vith", r"cfg\.yaml: unknown vit_size 'vith', expected one of: vitb, vitl, vits"),
        ("max_disp: 200", r"cfg\.yaml: max_disp is 200, expected a positive multiple of 32"),
        ("valid_iters: 0", r"cfg\.yaml: iterations is 0, expected an integer of at least 1"),
        ("mixed_precision: maybe", r"cfg\.yaml: mixed_precision is 'maybe', expected true or false"),
        ("corr_radius: 5", r"cfg\.yaml: corr_radius is 5, expected 4"),
        ("hidden_dims: [64, 64, 64]", r"cfg\.yaml: hidden_dims is \[64, 64, 64\], expected"),
        ("- just\n- a list", r"cfg\.yaml holds a list, expected a mapping"),
        ("a: [", r"cfg\.yaml cannot be read as YAML"),
        ("a: !!python/object:os.system {}", r"cfg\.yaml cannot be read as YAML"),
    ],
)
def test_a_configuration_of_another_network_is_refused(tmp_path: Path, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        options_from_config(config(tmp_path, text))


def test_a_missing_configuration_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"cfg\.yaml cannot be read as YAML"):
        options_from_config(tmp_path / "cfg.yaml")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"vit_size": "vit-s"}, "unknown vit_size 'vit-s'.*did you mean 'vits'"),
        ({"disparity_attention": "head"}, "unknown disparity_attention 'head'.*did you mean 'heads'"),
        ({"max_disp": 0}, "max_disp is 0, expected a positive multiple of 32"),
        ({"max_disp": 192.0}, "max_disp is 192.0, expected a positive multiple of 32"),
        ({"iterations": True}, "iterations is True, expected an integer of at least 1"),
        ({"low_memory": 1}, "low_memory is 1, expected true or false"),
    ],
)
def test_an_option_out_of_range_is_refused(options: dict[str, Any], said: str) -> None:
    with pytest.raises(InputError, match=said):
        skeleton(**options)


def test_a_checkpoint_of_another_size_is_refused_with_the_option_to_set() -> None:
    entry = architecture("foundation-stereo")
    assert entry.check is not None
    shapes = {key: tuple(t.shape) for key, t in skeleton(vit_size="vits").state_dict().items()}
    entry.check(shapes, entry.resolve({"vit_size": "vits"}))
    with pytest.raises(InputError, match="vit_size 'vits', expected that of 'vitl': set the option"):
        entry.check(shapes, entry.resolve())


def test_images_reach_the_network_unscaled_and_padded_around_their_centre() -> None:
    inputs = architecture("foundation-stereo").inputs({})
    assert (inputs.scale, inputs.mean, inputs.std) == (1.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0))
    assert (inputs.multiple, inputs.sides) == (32, PadSides.CENTRE)


@pytest.mark.parametrize("ratio", [0.0, 1.0, -0.5, float("nan")])
def test_a_smaller_copy_must_be_smaller(ratio: float) -> None:
    network = skeleton(vit_size="vits")
    pair = next(network.parameters()), next(network.parameters())
    with pytest.raises(InputError, match=r"ratio is .* expected a number between 0 and 1"):
        hierarchical_disparity(network, *pair, ratio=ratio)
