"""The options of FoundationStereo: what is allowed, and how a checkpoint's ``cfg.yaml`` maps to them."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sfkit.architectures.foundation_stereo.disparity_transformer import DisparityAttention
from sfkit.architectures.foundation_stereo.network import MULTIPLE
from sfkit.architectures.foundation_stereo.sizes import SIZES
from sfkit.architectures.yaml_file import read_yaml
from sfkit.errors import InputError, unknown_name

_FROM_CONFIG = {
    "vit_size": "vit_size",
    "max_disp": "max_disp",
    "valid_iters": "iterations",
    "mixed_precision": "mixed_precision",
    "low_memory": "low_memory",
}

# A file written before the key existed belongs to the only size of that time.
_SIZE_WITHOUT_KEY = "vitl"

# What the network is built with; a configuration that says otherwise belongs to another network.
_FIXED: Mapping[str, Any] = {
    "hidden_dims": [128, 128, 128],
    "n_downsample": 2,
    "n_gru_layers": 3,
    "corr_levels": 2,
    "corr_radius": 4,
}


def check_options(options: Mapping[str, Any]) -> None:
    """Refuse values that no FoundationStereo can be built with.

    Args:
        options: any of the builder's keyword arguments.

    Raises:
        InputError: a value of the wrong type or outside its range.
    """
    for key, value in options.items():
        if key == "vit_size":
            _check_name(key, value, SIZES)
        elif key == "disparity_attention":
            _check_name(key, value, [str(over) for over in DisparityAttention])
        elif key in ("max_disp", "iterations"):
            _check_count(key, value, MULTIPLE if key == "max_disp" else 1)
        elif not isinstance(value, bool):
            raise InputError(f"{key} is {value!r}, expected true or false: choose one of them")


def options_from_config(path: str | Path) -> dict[str, Any]:
    """The builder's options from the ``cfg.yaml`` that lies beside a published checkpoint.

    Read are ``vit_size`` (``vitl`` where the file has none), ``max_disp``, ``valid_iters`` (as
    ``iterations``), ``mixed_precision`` and ``low_memory``; other keys concern training and are ignored.

    Returns:
        Keyword arguments for the registered builder; what the file does not say is left out.

    Raises:
        InputError: the file cannot be read, is no YAML mapping, holds a value out of range, or
            describes another network (other hidden widths, levels or radius).
    """
    config = read_yaml(Path(path), "give the cfg.yaml that lies beside the checkpoint")
    for key, built_with in _FIXED.items():
        if key in config and config[key] != built_with:
            raise InputError(
                f"{path}: {key} is {config[key]!r}, expected {built_with!r}, the only value this network "
                "is built with: use the configuration of a published FoundationStereo checkpoint"
            )
    options = {option: config[key] for key, option in _FROM_CONFIG.items() if key in config}
    options.setdefault("vit_size", _SIZE_WITHOUT_KEY)
    for switch in ("mixed_precision", "low_memory"):
        # Some configurations write switches as numbers.
        if options.get(switch) in (0, 1):
            options[switch] = bool(options[switch])
    try:
        check_options(options)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
    return options


def _check_name(key: str, value: object, allowed: Mapping[str, Any] | list[str]) -> None:
    if not isinstance(value, str) or value not in allowed:
        raise unknown_name(key, str(value), allowed)


def _check_count(key: str, value: object, multiple: int) -> None:
    if isinstance(value, bool) or not isinstance(value, int) or value < multiple or value % multiple:
        expected = "an integer of at least 1" if multiple == 1 else f"a positive multiple of {multiple}"
        raise InputError(f"{key} is {value!r}, expected {expected}: choose another value")
