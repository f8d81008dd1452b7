"""The layouts checkpoints come in, unwrapped in one place.

A training script saves its state dict bare or inside a dictionary (``state_dict``, ``model_state``,
``model``), often with the ``module.`` prefix that DataParallel adds to every key.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

from sfkit.errors import InputError

CONTAINERS = ("state_dict", "model_state", "model_state_dict", "model")
PREFIX = "module."
OWN = "sfkit"  # the outer dictionary's entry that says how sfkit made a merged file


@dataclass(frozen=True)
class Layout:
    """How a file wraps its tensors.

    Attributes:
        container: the entry of the outer dictionary that holds them, None for a bare state dict.
        prefix: what stands before every key, ``"module."`` or nothing.
        renamed: the network's key -> the file's without prefix, where they differ.
        beside: numbers and texts beside the container, such as the step that a loader prints.
    """

    container: str | None = None
    prefix: str = ""
    renamed: Mapping[str, str] = field(default_factory=dict)
    beside: Mapping[str, float | str] = field(default_factory=dict)

    def name(self, state: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        """The tensors of a network by the keys a file with this layout has."""
        return {self.prefix + self.renamed.get(key, key): tensor for key, tensor in state.items()}

    def wrap(self, state: Mapping[str, torch.Tensor]) -> dict[str, Any]:
        """The dictionary a training script with this layout would have saved."""
        named = self.name(state)
        return {self.container: named, **self.beside} if self.container else dict(named)


def unwrap(content: object, path: Path) -> tuple[dict[str, torch.Tensor], Layout]:
    """The tensors of a loaded file by their bare keys, and the layout they were found in.

    Raises:
        InputError: no state dict is found; the message lists what the file holds instead.
    """
    container, beside = None, {}
    if isinstance(content, Mapping) and content and not _is_state(content):
        container = next((name for name in CONTAINERS if _is_state(content.get(name))), None)
        if container is None:
            held = ", ".join(sorted(map(str, content))[:8])
            raise InputError(
                f"{path}: found a dictionary with {held}, expected a state dict, bare or under one of "
                f"{', '.join(CONTAINERS)}: save the network with torch.save(network.state_dict(), path)"
            )
        beside = {key: value for key, value in content.items() if _is_plain(key, value)}
        content = content[container]
    if not isinstance(content, Mapping) or not content:
        raise InputError(
            f"{path}: found {_describe(content)}, expected a state dict of named tensors: "
            "save the network with torch.save(network.state_dict(), path)"
        )
    prefix = common_prefix(content)
    tensors = {str(key)[len(prefix) :]: tensor for key, tensor in content.items()}
    return tensors, Layout(container, prefix, beside=beside)


def common_prefix(keys: Mapping[str, Any]) -> str:
    """``"module."`` where every key begins with it, else the empty string."""
    return PREFIX if keys and all(key.startswith(PREFIX) for key in keys) else ""


def _is_state(value: object) -> bool:
    return (
        isinstance(value, Mapping)
        and bool(value)
        and all(isinstance(k, str) and isinstance(v, torch.Tensor) for k, v in value.items())
    )


def _is_plain(key: object, value: object) -> bool:
    """A number or text beside the container; what sfkit itself wrote there is written anew."""
    return isinstance(key, str) and key != OWN and isinstance(value, (int, float, str))


def _describe(content: object) -> str:
    return "an empty dictionary" if isinstance(content, Mapping) else f"a {type(content).__name__}"
