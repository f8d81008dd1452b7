"""A single network from its file: a merged one knows its architecture, any other is told."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch
from torch import nn

from sfkit.architectures import Architecture, InputConvention, architecture
from sfkit.checkpoints.checks import check_values
from sfkit.errors import InputError
from sfkit.merging.forward import ForwardMode
from sfkit.merging.known import undescribed
from sfkit.merging.members import PoolOpener
from sfkit.merging.origin import read_origin
from sfkit.merging.recognition import whose_keys
from sfkit.merging.tensor_specs import tensor_specs


@dataclass(frozen=True)
class LoadedNetwork:
    """A network ready to run.

    Attributes:
        network: in evaluation mode, on the CPU unless moved.
        inputs: how images become its input.
        name: its architecture's.
        options: all of its architecture's.
        mode: how its forward passes compute.
    """

    network: nn.Module
    inputs: InputConvention
    name: str
    options: Mapping[str, Any] = field(default_factory=dict)
    mode: ForwardMode = field(default_factory=ForwardMode)


def load_network(
    path: str | Path, *, name: str | None = None, options: Mapping[str, Any] | None = None
) -> LoadedNetwork:
    """Load one checkpoint strictly: merged by sfkit, or trained.

    Args:
        path: the file.
        name: the architecture, for a file that does not say it.
        options: the architecture's options; those in the file are the default.

    Raises:
        InputError: the file cannot be read, does not say its architecture, does not fit it, or holds values
            that are not finite.
    """
    path = Path(path)
    entry, chosen = _architecture(path, name, options or {})
    try:
        file = PoolOpener(entry, chosen, tensor_specs(entry, chosen)).read(path, is_base=True)
    except InputError as error:
        raise InputError(f"{error}{whose_keys(path, entry.name)}") from error
    # Keys, shapes and types are checked by now, values are not.
    for key, tensor in file.tensors.items():
        check_values(path, key, tensor)
    network = entry.build(**chosen)
    # The network's own tensors, which values are copied into.
    targets = network.state_dict(keep_vars=True)
    with torch.no_grad():
        for key, tensor in file.tensors.items():
            # Optional parts that the network, by its options, does not have.
            if key in targets:
                targets[key].copy_(tensor)
    network.eval().requires_grad_(requires_grad=False)
    return LoadedNetwork(network, entry.inputs(chosen), entry.name, chosen)


def _architecture(
    path: Path, name: str | None, options: Mapping[str, Any]
) -> tuple[Architecture, dict[str, Any]]:
    """The registry's entry and all its options: as given, else as the file says."""
    origin = read_origin(path)
    if name is None and origin is None:
        raise undescribed(path)
    stated = origin.architecture if origin else {"name": name, "options": {}}
    try:
        entry = architecture(name or stated["name"])
        # Options belong to the architecture that the file names.
        stored = stated["options"] if stated["name"] == entry.name else {}
        return entry, entry.resolve({**stored, **options}, near=path)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error
