"""What building a network from a checkout takes: no downloads, and arguments as attributes."""

from __future__ import annotations

import importlib
import sys
import types
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
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
    if (timm := _timm()) is not None:
        create = timm.create_model

        def create_model(*names: Any, **options: Any) -> nn.Module:
            network: nn.Module = create(*names, **{**options, "pretrained": False})
            # Newer timm activates within its norm; code from before calls act1.
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


def _timm() -> Any:
    """The package, or None: where it cannot be imported, the model that needs it says so."""
    try:
        return importlib.import_module("timm")
    except (ImportError, RuntimeError):  # the latter from a torchvision that is another PyTorch's
        return None


@contextmanager
def packages(root: Path, *names: str) -> Iterator[None]:
    """Packages below ``root`` that are entered without running what stands in their ``__init__``.

    One that imports everything (every trainer, every family) needs what few machines have.
    """
    before = {name: sys.modules.get(name) for name in names}
    for name in names:
        package = types.ModuleType(name)
        package.__path__ = [str(root.joinpath(*name.split(".")))]
        sys.modules[name] = package
    try:
        yield
    finally:
        # What was imported meanwhile goes on working; the hollow packages are forgotten.
        for name, module in before.items():
            sys.modules.pop(name, None)
            if module is not None:
                sys.modules[name] = module


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
