"""The layouts checkpoints come in, unwrapped in one place.

A training script saves its state dict bare or inside a dictionary (``state_dict``, ``model_state``,
``model``), often with the ``module.`` prefix that DataParallel adds to every key.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from sfkit.errors import InputError

CONTAINERS = ("state_dict", "model_state", "model_state_dict", "model")
PREFIX = "module."


@dataclass(frozen=True)
class Layout:
    """How a file wraps its tensors.

    Attributes:
        container: the entry of the outer dictionary that holds them, None for a bare state dict.
        prefix: what stands before every key, ``"module."`` or nothing.
    """

    container: str | None = None
    prefix: str = ""

    def wrap(self, state: Mapping[str, torch.Tensor]) -> dict[str, Any]:
        """The dictionary a training script with this layout would have saved."""
        prefixed = {self.prefix + key: tensor for key, tensor in state.items()}
        return {self.container: prefixed} if self.container else prefixed


def unwrap(content: object, path: Path) -> tuple[dict[str, torch.Tensor], Layout]:
    """The tensors of a loaded file by their bare keys, and the layout they were found in.

    Raises:
        InputError: no state dict is found; the message lists what the file holds instead.
    """
    container = None
    if isinstance(content, Mapping) and content and not _is_state(content):
        container = next((name for name in CONTAINERS if _is_state(content.get(name))), None)
        if container is None:
            held = ", ".join(sorted(map(str, content))[:8])
            raise InputError(
                f"{path}: found a dictionary with {held}, expected a state dict, bare or under one of "
                f"{', '.join(CONTAINERS)}: save the network with torch.save(network.state_dict(), path)"
            )
        content = content[container]
    if not isinstance(content, Mapping) or not content:
        raise InputError(
            f"{path}: found {_describe(content)}, expected a state dict of named tensors: "
            "save the network with torch.save(network.state_dict(), path)"
        )
    prefix = common_prefix(content)
    return {str(key)[len(prefix) :]: tensor for key, tensor in content.items()}, Layout(container, prefix)


def common_prefix(keys: Mapping[str, Any]) -> str:
    """``"module."`` where every key begins with it, else the empty string."""
    return PREFIX if keys and all(key.startswith(PREFIX) for key in keys) else ""


def _is_state(value: object) -> bool:
    return (
        isinstance(value, Mapping)
        and bool(value)
        and all(isinstance(k, str) and isinstance(v, torch.Tensor) for k, v in value.items())
    )


def _describe(content: object) -> str:
    return "an empty dictionary" if isinstance(content, Mapping) else f"a {type(content).__name__}"
