"""The registry of architectures: how to build a network, which blocks it has, how it reads images.

Bring your own with one decorator in a notebook cell::

    @sfkit.register_architecture("my-net", blocks={"backbone": ["encoder.*"], "head": ["head.*"]})
    class MyNet(torch.nn.Module):
        def forward(self, left, right):  # (B, 3, H, W) each -> disparity (B, H, W) in pixels
            ...
"""

from __future__ import annotations

import functools
import hashlib
import inspect
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, TypeVar

import torch
from torch import nn

from sfkit.architectures.inputs import InputConvention
from sfkit.errors import InputError, unknown_name

Options = Mapping[str, Any]
Blocks = Mapping[str, Sequence[str]]
Matching = Callable[[nn.Module, torch.Tensor, torch.Tensor], Sequence[torch.Tensor]]
Builder = TypeVar("Builder", bound=Callable[..., nn.Module])


@dataclass(frozen=True)
class Architecture:
    """One entry of the registry.

    Attributes:
        name: what ``pool.toml`` calls it.
        build: keyword options -> network, whose ``forward(left, right)`` takes two (B, 3, H, W)
            tensors and returns the left image's positive disparity (B, H, W) in pixels.
        blocks: options -> block name -> glob patterns over state-dict keys; first match wins.
        inputs: options -> how images become input.
        optional: globs of keys a source may lack (its task vector there is zero).
        constants: globs of keys that are no parameters and are copied from the base (index tables).
        dead: globs of keys that influence no output: kept in files, left out of the search.
        frozen: globs of keys that fine-tuning leaves as they are; a source that differs there is pointed out.
        rename: state-dict keys as found -> as the network names them, for layouts in the wild.
        check: refuses a state dict that loads but would be read wrongly (raises InputError).
        beside: a checkpoint's path -> options that a configuration file beside it gives.
        matching: network, left, right -> its distributions over disparities or residuals, one a stage, each
            (B, D, h, w) and summing to 1 over D; None where it has none.
        version: changes whenever the network's output changes; part of every evaluation's key.
    """

    name: str
    build: Callable[..., nn.Module]
    blocks: Callable[[Options], Blocks]
    inputs: Callable[[Options], InputConvention]
    defaults: Options
    version: str
    optional: tuple[str, ...] = ()
    constants: tuple[str, ...] = ()
    dead: tuple[str, ...] = ()
    frozen: tuple[str, ...] = ()
    rename: Callable[[Iterable[str]], Mapping[str, str]] | None = None
    check: Callable[[Mapping[str, tuple[int, ...]], Options], None] | None = None
    beside: Callable[[Path], Options] | None = None
    matching: Matching | None = None

    def is_optional(self, key: str) -> bool:
        """True for a key a checkpoint may lack, or have though the options leave that part out."""
        return any(fnmatchcase(key, pattern) for pattern in self.optional)

    def is_frozen(self, key: str) -> bool:
        """True for a key that fine-tuning is known to leave as it is."""
        return any(fnmatchcase(key, pattern) for pattern in self.frozen)

    def resolve(self, options: Options | None = None, *, near: Path | None = None) -> dict[str, Any]:
        """All options: as given, else as a configuration beside the checkpoint ``near`` says, else defaults.

        Raises:
            InputError: an option the architecture does not have.
        """
        given = dict(options or {})
        for key in given:
            if key not in self.defaults:
                raise unknown_name(f"option of architecture {self.name!r}", key, self.defaults)
        found = self.beside(near) if self.beside is not None and near is not None else {}
        return {**self.defaults, **found, **given}


_REGISTRY: dict[str, Architecture] = {}


def register_architecture(
    name: str,
    *,
    blocks: Blocks | Callable[[Options], Blocks],
    inputs: InputConvention | Callable[[Options], InputConvention] | None = None,
    optional: Iterable[str] = (),
    constants: Iterable[str] = (),
    dead: Iterable[str] = (),
    frozen: Iterable[str] = (),
    rename: Callable[[Iterable[str]], Mapping[str, str]] | None = None,
    check: Callable[[Mapping[str, tuple[int, ...]], Options], None] | None = None,
    beside: Callable[[Path], Options] | None = None,
    matching: Matching | None = None,
    version: str | None = None,
) -> Callable[[Builder], Builder]:
    """Register an ``nn.Module`` class, or a function that builds one, under ``name``.

    Its keyword arguments become the architecture's options (all need defaults). Registering a name
    again replaces the entry, so a notebook cell can be run twice. Without ``version`` the digest of
    the decorated source is the version: an edited cell never meets the scores of its former self.
    """

    def decorate(builder: Builder) -> Builder:
        convention = InputConvention() if inputs is None else inputs
        _REGISTRY[name] = Architecture(
            name=name,
            build=builder,
            blocks=blocks if callable(blocks) else lambda _options: blocks,
            inputs=convention if callable(convention) else lambda _options: convention,
            defaults=_defaults(name, builder),
            version=version if version is not None else _source_digest(name, builder),
            optional=tuple(optional),
            constants=tuple(constants),
            dead=tuple(dead),
            frozen=tuple(frozen),
            rename=rename,
            check=check,
            beside=beside,
            matching=matching,
        )
        return builder

    return decorate


def architecture(name: str) -> Architecture:
    """The entry called ``name``.

    Raises:
        InputError: no such architecture; the nearest name is suggested.
    """
    if name not in _REGISTRY:
        raise unknown_name("architecture", name, _REGISTRY)
    return _REGISTRY[name]


def architectures() -> tuple[str, ...]:
    """The names of all registered architectures, sorted."""
    return tuple(sorted(_REGISTRY))


def _defaults(name: str, builder: Callable[..., nn.Module]) -> dict[str, Any]:
    parameters = inspect.signature(builder).parameters.values()
    for p in parameters:
        if p.kind in (p.VAR_POSITIONAL, p.VAR_KEYWORD) or p.default is p.empty:
            raise InputError(
                f"architecture {name!r}: argument {p.name!r} of {named(builder).__name__} has no default, "
                "expected a default for every option so that a pool can be opened without it"
            )
    return {p.name: p.default for p in parameters}


def named(builder: Callable[..., nn.Module]) -> Callable[..., nn.Module]:
    """The class or function a builder comes down to: a ``functools.partial`` has neither name nor source."""
    while isinstance(builder, functools.partial):
        builder = builder.func
    return builder


def _source_digest(name: str, builder: Callable[..., nn.Module]) -> str:
    given = ""
    while isinstance(builder, functools.partial):
        given += f"{builder.args!r}{sorted(builder.keywords.items())!r}"
        builder = builder.func
    try:
        source = _source(builder) + given
    except (OSError, TypeError) as error:
        raise InputError(
            f"architecture {name!r}: the source of {builder.__name__} cannot be read ({error}), "
            "pass version='1' and change it whenever the network's output changes"
        ) from error
    return hashlib.sha256(source.encode()).hexdigest()[:16]


def _source(builder: Callable[..., nn.Module]) -> str:
    """The builder's source; of a class in a notebook cell, which has no file, that of its methods."""
    if not inspect.isclass(builder) or builder.__module__ != "__main__":
        return inspect.getsource(builder)
    methods = [value for value in vars(builder).values() if inspect.isfunction(value)]
    if not methods:
        raise OSError("it has no methods of its own")
    return "\n".join(inspect.getsource(method) for method in methods)
