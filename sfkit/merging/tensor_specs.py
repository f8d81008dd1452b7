"""What tensors a network has and what each is to a merge, read from the module itself."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from fnmatch import fnmatchcase
from typing import Any

import torch
from torch import nn
from torch.overrides import TorchFunctionMode

from sfkit.architectures import Architecture
from sfkit.checkpoints.checks import Kind, TensorSpec

STATISTICS = ("running_mean", "running_var")
_DRAWING = ("normal_", "uniform_", "orthogonal_")  # how the functions end that fill a tensor at random


def tensor_specs(architecture: Architecture, options: Mapping[str, Any]) -> tuple[TensorSpec, ...]:
    """The state dict a checkpoint of this architecture has, in the module's order."""
    return specs_of(undrawn(architecture, options), architecture)


def undrawn(architecture: Architecture, options: Mapping[str, Any]) -> nn.Module:
    """A network without its initial values being drawn, which costs neither memory nor time.

    One whose constructor needs them is built in full.
    """
    try:
        with _Undrawn():
            return architecture.build(**options)
    except RuntimeError:
        return architecture.build(**options)


class _Undrawn(TorchFunctionMode):
    """Leaves initial values undrawn: memory that nobody has written to takes up no room.

    The meta device would do as well, but the first arithmetic on it makes torch import its compiler, which
    takes longer than opening a small pool.
    """

    def __torch_function__(
        self,
        func: Callable[..., Any],
        types: Iterable[type],
        args: tuple[Any, ...] = (),
        kwargs: dict[str, Any] | None = None,
    ) -> Any:
        """Return the tensor as it is where ``func`` would fill it with random numbers."""
        named = kwargs or {}
        if getattr(func, "__name__", "").endswith(_DRAWING):
            return args[0] if args else named["tensor"]
        return func(*args, **named)


def specs_of(network: nn.Module, architecture: Architecture) -> tuple[TensorSpec, ...]:
    """What :func:`tensor_specs` says, of a network that is built already."""
    return tuple(_specs(network, architecture))


def _specs(network: nn.Module, architecture: Architecture) -> Iterator[TensorSpec]:
    # Under all their names: which of a tied tensor's comes first is the state dict's choice.
    # Tied weights under each of their names.
    parameters = {name for name, _ in network.named_parameters(remove_duplicate=False)}
    tensors = network.state_dict(keep_vars=True)
    names_of: dict[int, list[str]] = {}
    for name, tensor in tensors.items():
        # By object: tied weights stand under several keys and are merged once.
        names_of.setdefault(id(tensor), []).append(name)
    for name, tensor in tensors.items():
        first, *aliases = names_of[id(tensor)]
        if name != first:
            continue
        kind = _kind(name, tensor, architecture, is_parameter=name in parameters)
        yield TensorSpec(
            key=name,
            shape=tuple(tensor.shape),
            kind=kind,
            aliases=tuple(aliases),
            optional=_matches(name, architecture.optional),
            tolerant=kind is Kind.CONSTANT and not _matches(name, architecture.dead),
            complex=tensor.dtype == torch.complex64 and name not in parameters,
        )


def _kind(name: str, tensor: torch.Tensor, architecture: Architecture, *, is_parameter: bool) -> Kind:
    if _matches(name, architecture.constants) or _matches(name, architecture.dead):
        return Kind.CONSTANT
    if is_parameter and tensor.is_floating_point():
        return Kind.WEIGHT
    if not tensor.is_floating_point():
        return Kind.CONSTANT
    if name.rpartition(".")[2] in STATISTICS or (
        not is_parameter and _matches(name, architecture.statistics)
    ):
        return Kind.STATISTIC
    return Kind.CONSTANT


def _matches(name: str, patterns: tuple[str, ...]) -> bool:
    return any(fnmatchcase(name, pattern) for pattern in patterns)
