"""What building a network from a checkout takes: no downloads, and arguments as attributes."""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import torch
from torch import nn

from sfkit.errors import InputError


class Arguments(dict[str, Any]):
    """Options as attributes and as entries, also inside each other, as argparse and EasyDict give them."""

    def __init__(self, values: Mapping[str, Any]) -> None:
        super().__init__({key: _arguments(value) for key, value in values.items()})

    def __getattr__(self, name: str) -> Any:
        """The option of that name."""
        if name not in self:
            raise AttributeError(name)
        return self[name]


def _arguments(value: Any) -> Any:
    if isinstance(value, Mapping):
        return Arguments(value)
    return [_arguments(entry) for entry in value] if isinstance(value, list) else value


@contextmanager
def without_downloads() -> Iterator[None]:
    """Backbones are built with random weights: those that count come from the checkpoint.

    ``timm.create_model`` is told so, and gives its networks the attribute ``act1`` that newer versions have
    merged into ``bn1``; torch's hub fetches nothing.
    """
    fetch = torch.hub.load_state_dict_from_url
    undo: list[tuple[Any, str, Any]] = [(torch.hub, "load_state_dict_from_url", fetch)]
    torch.hub.load_state_dict_from_url = lambda *_, **__: {}
    if importlib.util.find_spec("timm") is not None:
        import timm  # type: ignore[import-not-found,unused-ignore]  # the checkout's own requirement

        create = timm.create_model

        def create_model(*names: Any, **options: Any) -> nn.Module:
            network: nn.Module = create(*names, **{**options, "pretrained": False})
            if hasattr(network, "bn1") and not hasattr(network, "act1"):
                network.act1 = nn.Identity()
            return network

        undo.append((timm, "create_model", create))
        timm.create_model = create_model
    try:
        yield
    finally:
        for module, name, value in undo:
            setattr(module, name, value)


def ensure_root(root: str, name: str, page: str) -> str:
    """Refuse an architecture whose checkout is not named.

    Raises:
        InputError: ``root`` is empty.
    """
    if not root:
        raise InputError(
            f"architecture {name!r}: the option root is missing, expected your checkout of {page}"
        )
    return root
