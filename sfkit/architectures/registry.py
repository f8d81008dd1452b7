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
import importlib
import inspect
import os
import types
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any, TypeVar

import torch
from torch import nn

from sfkit.architectures import code
from sfkit.architectures.calling import PLAIN, Calling
from sfkit.architectures.code import Code
from sfkit.architectures.identity import code_identity
from sfkit.architectures.inputs import InputConvention
from sfkit.architectures.module_blocks import ByNetwork, by_options, top_level_blocks
from sfkit.architectures.names import unknown_architecture
from sfkit.errors import InputError, ensure_known, unknown_name
from sfkit.files import home

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
        statistics: globs of further buffers that are merged like running means and variances.
        dead: globs of keys that influence no output: kept in files, left out of the search.
        frozen: globs of keys that fine-tuning leaves as they are; a source that differs there is pointed out.
        rename: state-dict keys as found -> as the network names them, for layouts in the wild.
        check: refuses a state dict that loads but would be read wrongly (raises InputError).
        beside: a checkpoint's path -> options that a configuration file beside it gives.
        matching: network, left, right -> its distributions over disparities or residuals, one a stage, each
            (B, D, h, w) and summing to 1 over D; None where it has none.
        stated: the version its author states; where there is none, ``identity`` stands for it.
        identity: the digest of its code as it is now in memory.
        additions: what else belongs to its version: how it is called, and the file that registered it.
        code: the user's file that registered it, None for what is imported by name.
        checkout: options -> digest of the user's checkout that it is built from; part of every key.
        places: options that name folders: they say where, not what, and are no part of keys.
        advice: globs of keys -> what to do where a checkpoint lacks them.
        by_network: how a network that is built already tells its blocks; None where ``blocks`` needs none.
    """

    name: str
    build: Callable[..., nn.Module]
    blocks: Callable[[Options], Blocks]
    inputs: Callable[[Options], InputConvention]
    defaults: Options
    stated: str | None
    identity: Callable[[], str]
    additions: tuple[str, ...] = ()
    optional: tuple[str, ...] = ()
    constants: tuple[str, ...] = ()
    statistics: tuple[str, ...] = ()
    dead: tuple[str, ...] = ()
    frozen: tuple[str, ...] = ()
    rename: Callable[[Iterable[str]], Mapping[str, str]] | None = None
    check: Callable[[Mapping[str, tuple[int, ...]], Options], None] | None = None
    beside: Callable[[Path], Options] | None = None
    matching: Matching | None = None
    code: Code | None = None
    checkout: Callable[[Options], str] | None = None
    places: tuple[str, ...] = ()
    advice: Mapping[str, str] = field(default_factory=dict)
    by_network: ByNetwork | None = None

    @property
    def version(self) -> str:
        """Changes whenever the network's output changes; part of every evaluation's key."""
        return "+".join((self.identity() if self.stated is None else self.stated, *self.additions))

    def version_of(self, options: Options) -> str:
        """The version, with the state of the checkout it is built from, if it is."""
        return self.version if self.checkout is None else f"{self.version}+{self.checkout(options)}"

    def blocks_of(self, network: nn.Module, options: Options) -> Blocks:
        """What ``blocks`` answers, by a network that is built already."""
        return self.blocks(options) if self.by_network is None else self.by_network.tell(network, options)

    def is_optional(self, key: str) -> bool:
        """True for a key a checkpoint may lack, or have though the options leave that part out."""
        return any(fnmatchcase(key, pattern) for pattern in self.optional)

    def advice_for(self, missing: Iterable[str]) -> str:
        """What to do about a checkpoint without these keys, after a semicolon; nothing where nobody knows."""
        lacking = tuple(missing)
        known = (a for glob, a in self.advice.items() if any(fnmatchcase(key, glob) for key in lacking))
        return "".join(f"; {advice}" for advice in known)

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
            ensure_known(f"option of architecture {self.name!r}", key, self.defaults)
        found = self.beside(near) if self.beside is not None and near is not None else {}
        resolved = {**self.defaults, **found, **given}
        return {**resolved, **{key: _place(resolved[key], near) for key in self.places if resolved[key]}}


def _place(text: str, near: Path | None) -> str:
    """A folder as it was written, with variables and ``~``; else from the checkpoint's."""
    path = home(os.path.expandvars(text))
    return str(path if near is None else near.absolute().parent / path)


_REGISTRY: dict[str, Architecture] = {}
_CLAIMED: dict[str, dict[str, Architecture]] = {}  # a file's identity -> what it registered


def register_architecture(
    name: str,
    *,
    blocks: Blocks | Callable[[Options], Blocks] | ByNetwork,
    inputs: InputConvention | Callable[[Options], InputConvention] | None = None,
    optional: Iterable[str] = (),
    constants: Iterable[str] = (),
    statistics: Iterable[str] = (),
    dead: Iterable[str] = (),
    frozen: Iterable[str] = (),
    rename: Callable[[Iterable[str]], Mapping[str, str]] | None = None,
    check: Callable[[Mapping[str, tuple[int, ...]], Options], None] | None = None,
    beside: Callable[[Path], Options] | None = None,
    matching: Matching | None = None,
    call: str = "pair",
    keywords: Mapping[str, Any] | Callable[[Options], Mapping[str, Any]] | None = None,
    output: str | Sequence[str] = "tensor",
    resolution: int = 1,
    checkout: Callable[[Options], str] | None = None,
    places: Iterable[str] = (),
    advice: Mapping[str, str] | None = None,
    version: str | None = None,
) -> Callable[[Builder], Builder]:
    """Register an ``nn.Module`` class, or a function that builds one, under ``name``.

    Its keyword arguments become the architecture's options (all need defaults). Registering a name
    again replaces the entry, so a notebook cell can be run twice. Without ``version`` the version is a
    digest of the code that the network reaches (:mod:`sfkit.architectures.identity`): an edited cell, helper,
    base or class attribute never meets the scores of its former self.

    Buffers that are no running mean or variance are the base's in every merge; a pool warns where a source
    has others. ``statistics`` names those that are merged like running statistics (a moving average, say),
    ``constants`` those that do not matter.

    A network that is called otherwise than ``forward(left, right)``, or returns something else than a
    disparity in pixels, is described by ``call``, ``keywords``, ``output`` and ``resolution``: the four of
    :class:`~sfkit.architectures.calling.Calling`.

    Raises:
        InputError: an option has no default, a word is unknown, or the code reaches something whose state
            cannot be told and no ``version`` is given.
    """
    steps = (output,) if isinstance(output, str) else tuple(output)
    further = keywords if callable(keywords) else None
    calling = Calling(call, {} if callable(keywords) else dict(keywords or {}), steps, resolution)

    def decorate(builder: Builder) -> Builder:
        if version is None:
            code_identity(name, builder, further)  # refused here rather than when a pool is opened
        convention = InputConvention() if inputs is None else inputs
        by_network = blocks if isinstance(blocks, ByNetwork) else None
        _REGISTRY[name] = Architecture(
            name=name,
            build=builder if calling == PLAIN and further is None else _adapted(builder, calling, further),
            blocks=by_options(blocks, builder),
            inputs=convention if callable(convention) else lambda _options: convention,
            defaults=_defaults(name, builder),
            stated=version,
            identity=functools.partial(code_identity, name, builder, further),
            additions=() if calling == PLAIN else (_digest(repr(calling)),),
            optional=tuple(optional),
            constants=tuple(constants),
            statistics=tuple(statistics),
            dead=tuple(dead),
            frozen=tuple(frozen),
            rename=rename,
            check=check,
            beside=beside,
            matching=matching,
            checkout=checkout,
            places=tuple(places),
            advice=dict(advice or {}),
            by_network=by_network,
        )
        return builder

    return decorate


def architecture(name: str) -> Architecture:
    """The entry called ``name``: registered here, in a file that --import named, or by an installed package.

    Raises:
        InputError: no such architecture; the nearest name is suggested.
    """
    if name not in _REGISTRY:
        for path in code.imported_files():
            run(path, trusted=True)
    if name not in _REGISTRY and ":" in name:
        _from_run_files(name)
    # Its package may have registered it while it was imported.
    if name not in _REGISTRY and (found := code.declared(name)) is not None and name not in _REGISTRY:
        _register_plainly(name, found)
    if name not in _REGISTRY:
        raise unknown_architecture(name, architectures())
    return _REGISTRY[name]


def architectures() -> tuple[str, ...]:
    """The names of all registered architectures and of those that installed packages declare, sorted."""
    return tuple(sorted({*_REGISTRY, *code.declared_names()}))


def run(path: Path, *, trusted: bool = False) -> types.ModuleType:
    """Run a file of the user's that registers architectures; what it registers carries the file's identity.

    Raises:
        InputError: as :func:`sfkit.architectures.code.run_file`.
    """
    before = dict(_REGISTRY)
    ran, module = code.run_file(path, trusted=trusted)
    _claim(ran, before)
    return module


def run_text(ran: Code) -> None:
    """The same in a worker, from the text that another process ran."""
    before = dict(_REGISTRY)
    code.run_text(ran)
    _claim(ran, before)


def _claim(ran: Code, before: Mapping[str, Architecture]) -> None:
    """Mark what a file registered; a file that was run before has its entries again."""
    if ran.identity not in _CLAIMED:
        fresh = {name: entry for name, entry in _REGISTRY.items() if before.get(name) is not entry}
        _CLAIMED[ran.identity] = {name: _marked(entry, ran) for name, entry in fresh.items()}
    _REGISTRY.update(_CLAIMED[ran.identity])


def _marked(entry: Architecture, ran: Code) -> Architecture:
    return replace(entry, code=ran, additions=(*entry.additions, ran.identity))


def entry_for(name: str, module: Path | None = None, near: Path | None = None) -> Architecture:
    """The architecture a ``pool.toml`` describes.

    Args:
        name: its name, or ``"my_net:MyNet"``: a class or function of a module.
        module: the file that registers it.
        near: the folder of ``pool.toml``, where a module may lie.

    Raises:
        InputError: it is not registered there, or its code is not trusted or fails.
    """
    if module is not None:
        run(module)
        if ":" not in name and name not in _REGISTRY:
            raise InputError(f"{module}: does not register the architecture {name!r}, expected that name")
        if ":" in name and name not in _REGISTRY:
            _from_run_files(name)
    if ":" in name and name not in _REGISTRY:
        _from_module(name, near)
    return architecture(name)


def _from_module(name: str, near: Path | None) -> None:
    """Register ``module:Class``, where it is a file beside ``pool.toml`` or a module that can be imported."""
    module_name, _, attribute = name.partition(":")
    file = near / f"{module_name.replace('.', '/')}.py" if near is not None else None
    if file is not None and file.is_file():
        run(file)
        _from_run_files(name)
        return
    code.ensure_module_trusted(module_name)
    try:
        module = importlib.import_module(module_name)
    except code.FAILURES as error:
        raise InputError(f"architecture {name!r}: {module_name} cannot be imported ({error})") from error
    _register_plainly(name, _attribute(name, module, attribute))


def _from_run_files(name: str) -> None:
    """Register ``module:Class`` from a file of that name that was run already."""
    module_name, _, attribute = name.partition(":")
    for ran, module in code.run_modules():
        if ran.path.stem == module_name.rpartition(".")[2]:
            before = dict(_REGISTRY)
            _register_plainly(name, _attribute(name, module, attribute))
            if name in _REGISTRY and before.get(name) is not _REGISTRY[name]:
                _REGISTRY[name] = _marked(_REGISTRY[name], ran)
                _CLAIMED.setdefault(ran.identity, {})[name] = _REGISTRY[name]


def _attribute(name: str, module: types.ModuleType, attribute: str) -> object:
    if not hasattr(module, attribute):
        raise unknown_name(f"name in {name.partition(':')[0]}", attribute, vars(module))
    return getattr(module, attribute)


def _register_plainly(name: str, found: object) -> None:
    """Register a class or builder that has no decorator; its blocks are its top-level modules.

    One that was decorated keeps what its decorator declared, under this name too.
    """
    if not callable(found):
        return  # an entry point that names a module: importing it has registered what it has
    same = next((entry for entry in _REGISTRY.values() if _inner(entry.build) is found), None)
    if same is not None:
        _REGISTRY[name] = replace(same, name=name)
        return
    modules = ByNetwork(lambda network, _options: top_level_blocks(network))
    register_architecture(name, blocks=modules)(found)


def _inner(builder: Callable[..., nn.Module]) -> object:
    return getattr(builder, "__wrapped__", builder)


def _adapted(
    builder: Callable[..., nn.Module],
    calling: Calling,
    further: Callable[[Options], Mapping[str, Any]] | None,
) -> Callable[..., nn.Module]:
    @functools.wraps(builder)
    def build(**options: Any) -> nn.Module:
        chosen = calling if further is None else replace(calling, keywords=further(options))
        return chosen.adapt(builder(**options))

    return build


def _digest(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()[:8]


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


# The networks that come with sfkit register themselves: whoever has the registry has them. They import it in
# their turn, so that this stands below all they need.
for _shipped in ("adapters", "anynet", "foundation_stereo", "nmrf"):
    importlib.import_module(f"sfkit.architectures.{_shipped}")
