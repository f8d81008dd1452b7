"""The identity of a network's code: a digest of everything of the user's that decides what it computes.

It follows names from the builder: methods, bases, class attributes, functions and classes they call,
defaults, closures and constants, in the state in which they are in memory, so that an edited cell or a
reloaded module counts at once and a file that was edited but not reloaded does not. Of installed packages
the version counts, unless the builder itself belongs to one. Names that only ``getattr``, ``globals()`` or
``sys.modules`` find are not seen, nor what a network reads from files and the environment when it runs:
``version`` is for those.
"""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import dis
import enum
import functools
import hashlib
import importlib
import inspect
import logging
import re
import sys
import sysconfig
import types
import typing
from collections.abc import Callable, Iterable
from importlib import metadata
from pathlib import Path, PurePath
from typing import Any

import numpy as np
import torch
from torch import nn

from sfkit.errors import InputError

_SILENT = {"torch", "torchvision", "numpy"}  # as everywhere in keys, their versions do not count
_CLASS_NOISE = {
    *("__dict__", "__weakref__", "__doc__", "__annotations__", "__module__", "__qualname__"),
    *("__firstlineno__", "__static_attributes__", "__parameters__", "__orig_bases__", "_abc_impl"),
    *("__abstractmethods__", "__annotate__", "__annotate_func__", "__annotations_cache__", "__slotnames__"),
}
_PLACES = tuple(
    Path(sysconfig.get_path(name)).resolve() for name in ("purelib", "platlib", "stdlib", "platstdlib")
)
_PLAIN = (type(None), bool, int, float, complex, str, bytes, type(...), type(NotImplemented))
_WITHOUT_STATE = (
    *(logging.Logger, types.BuiltinFunctionType, types.MethodDescriptorType, types.WrapperDescriptorType),
    *(types.GetSetDescriptorType, types.MemberDescriptorType, types.MethodWrapperType, types.GenericAlias),
    *(types.UnionType, typing.TypeVar, types.ClassMethodDescriptorType, np.ufunc),
)
_FIELDS = {
    property: ("fget", "fset", "fdel"),
    functools.cached_property: ("func",),
    functools.partial: ("func", "args", "keywords"),
    functools.partialmethod: ("func", "args", "keywords"),
    staticmethod: ("__func__",),
    classmethod: ("__func__",),
    types.MethodType: ("__func__", "__self__"),
}
_born_empty: dict[int, object] = {}
_LOOKING = {"get", "items", "keys", "values", "index", "count", "copy"}


def code_identity(architecture: str, builder: Callable[..., nn.Module], *further: object) -> str:
    """The digest of what ``builder`` (and ``further`` functions) reach, as it is now.

    A list, dictionary or set that was empty when it was first met counts as what a run fills (a cache or a
    counter), and never changes the digest, unless all code that is reached only looks things up in it: then
    it is a setting. Other data counts by content.

    Raises:
        InputError: something is reached whose state cannot be told; it is named.
    """
    walk = _Walk(architecture, _package(getattr(_innermost(builder), "__module__", "")))
    for root in (builder, *further):
        walk.take(root, "builder")
    walk.settle()
    return walk.digest.hexdigest()[:16]


def _innermost(builder: Callable[..., nn.Module]) -> Any:
    while isinstance(builder, functools.partial):
        builder = builder.func
    return inspect.unwrap(builder)


class _Walk:
    def __init__(self, architecture: str, own: str) -> None:
        self.architecture = architecture
        self.own = own
        # Bytecode is another in every version of Python.
        self.digest = hashlib.sha256(f"python {sys.version_info[0]}.{sys.version_info[1]}".encode())
        self.seen: dict[int, int] = {}
        self.held: list[object] = []  # so that no id is used twice
        self.looked: set[str] = set()  # names that code looks things up in
        self.other: set[str] = set()  # names that it does something else with
        self.undecided: list[
            tuple[str, Any]
        ] = []  # containers that were empty once, by how they were reached

    def say(self, *words: object) -> None:
        self.digest.update("\0".join(map(str, words)).encode("utf-8", "surrogatepass") + b"\n")

    def take(self, value: Any, path: str) -> None:
        """Add one object; ``path`` is how it was reached."""
        if isinstance(value, _PLAIN):
            return self.say(type(value).__name__, repr(value))
        if id(value) in self.seen:
            return self.say("again", self.seen[id(value)])
        if not isinstance(value, tuple | frozenset):  # equal constants may be one object or two
            self.seen[id(value)] = len(self.seen)
            self.held.append(value)
        if isinstance(value, types.ModuleType):
            return self.say("module", value.__name__, self.installed(value.__name__))
        if isinstance(value, types.FunctionType):
            return self.function(value, path)
        if isinstance(value, types.CodeType):
            return self.code(value, {}, path)
        if isinstance(value, type):
            return self.type(value, path)
        if isinstance(value, torch.Tensor):
            # Views that negate or conjugate lazily share the bytes of another value.
            flat = value.detach().cpu().resolve_conj().resolve_neg().contiguous().reshape(-1)
            raw = flat.view(torch.uint8) if flat.numel() else flat
            self.say("tensor", value.dtype, tuple(value.shape), hashlib.sha256(raw.numpy().data).hexdigest())
            return None
        if isinstance(value, np.ndarray | np.generic):
            return self.array(np.asarray(value), path)
        if isinstance(value, list | tuple | set | frozenset | dict | types.MappingProxyType):
            return self.container(value, path)
        return self.instance(value, path)

    def function(self, function: types.FunctionType, path: str) -> None:
        if self.foreign(function.__module__, "function", function.__qualname__):
            return
        self.take(function.__defaults__, f"{path}'s defaults")
        self.take(function.__kwdefaults__, f"{path}'s defaults")
        for name, cell in zip(function.__code__.co_freevars, function.__closure__ or (), strict=False):
            try:
                content = cell.cell_contents
            except ValueError:  # not bound yet, such as a class's own name in its body
                continue
            self.take(content, name)
        self.code(function.__code__, function.__globals__, path)

    def code(self, code: types.CodeType, names: dict[str, Any], path: str) -> None:
        self.say("code", code.co_name, code.co_code.hex(), code.co_names, code.co_varnames, code.co_freevars)
        self.say(
            code.co_exceptiontable.hex(),
            code.co_argcount,
            code.co_kwonlyargcount,
            code.co_posonlyargcount,
            code.co_flags,
        )
        looked, other = _uses(code)
        self.looked |= looked
        self.other |= other
        for constant in code.co_consts:
            if isinstance(constant, types.CodeType):
                self.code(constant, names, f"{path}.{constant.co_name}")
            else:
                self.take(constant, path)
        for name in _read_names(code):
            if name in names and name not in _import_names(code):
                self.named(name, names[name], code.co_names)
            elif name in _import_names(code) and (module := _imported(name, names)) is not None:
                self.named(name, module, code.co_names)

    def named(self, name: str, value: Any, attributes: Iterable[str]) -> None:
        """Something code calls by name; of the user's modules, the attributes that the same code calls."""
        self.say("name", name)
        self.take(value, name)
        if isinstance(value, types.ModuleType) and not self.installed(value.__name__):
            for attribute in attributes:
                # Not None, which is a value.
                inner = vars(value).get(attribute, self)
                if inner is self:
                    continue
                if isinstance(inner, types.ModuleType) and id(inner) not in self.seen:
                    self.named(f"{name}.{attribute}", inner, attributes)
                else:
                    self.say("name", f"{name}.{attribute}")
                    self.take(inner, f"{name}.{attribute}")

    def type(self, kind: type, path: str) -> None:
        if self.foreign(kind.__module__, "class", kind.__qualname__):
            return
        self.say("class", kind.__qualname__)
        for base in kind.__bases__:
            self.take(base, base.__name__)
        # A metaclass of its own decides how a class behaves.
        if type(kind) is not type:
            self.take(type(kind), type(kind).__name__)
        if issubclass(kind, enum.Enum):
            self.say(*((member.name, repr(member.value)) for member in kind))
        for name, value in sorted(vars(kind).items()):
            if name not in _CLASS_NOISE and not (issubclass(kind, enum.Enum) and name.startswith("_")):
                self.say("attribute", name)
                self.take(value, f"{kind.__qualname__}.{name}")

    def array(self, array: np.ndarray[Any, Any], path: str) -> None:
        if array.dtype.hasobject:
            raise self.unknown(array, path)
        self.say("array", array.dtype.str, array.shape, hashlib.sha256(array.tobytes()).hexdigest())

    def container(self, values: Any, path: str) -> None:
        self.say(type(values).__name__)
        if not values and isinstance(values, list | set | dict):
            _born_empty.setdefault(id(values), values)
        if id(values) in _born_empty:
            self.undecided.append((path, values))
            return
        self.content(values, path)

    def settle(self) -> None:
        """Take in what was empty once and is only looked up in: a setting that was made later.

        Decided at the end, when all code is known.
        """
        while self.undecided:
            path, values = self.undecided.pop(0)
            name = path.rpartition(".")[2]
            if values and name in self.looked and name not in self.other:
                self.say("set later", path)
                self.content(values, path)

    def content(self, values: Any, path: str) -> None:
        if isinstance(values, set | frozenset):
            try:
                # A set has no order of its own.
                values = sorted(values, key=lambda value: (type(value).__name__, repr(value)))
            except TypeError as error:
                raise self.unknown(values, path) from error
        if isinstance(values, dict | types.MappingProxyType):
            values = [part for pair in values.items() for part in pair]
        self.say(len(values))
        for value in values:
            self.take(value, path)

    def instance(self, value: Any, path: str) -> None:
        kind = type(value)
        self.say("instance", kind.__module__, kind.__qualname__)
        if kind in _FIELDS:
            for name in _FIELDS[kind]:
                self.take(getattr(value, name), f"{path}.{name}")
        elif isinstance(value, PurePath | re.Pattern | torch.dtype | torch.device | torch.memory_format):
            self.say(value)
        elif isinstance(value, enum.Enum):
            self.say(value.name, repr(value.value))
            self.take(kind, kind.__qualname__)
        elif isinstance(value, dataclasses.Field):
            for name in ("name", "default", "default_factory", "init", "kw_only"):
                self.take(getattr(value, name), f"{path}.{name}")
        elif kind.__module__ == "dataclasses":  # what is missing, and how the class was made
            self.say(repr(value) if hasattr(value, "frozen") else "")
        elif kind.__module__ == "_collections":  # a named tuple's fields
            self.say(repr(value))
        elif isinstance(value, torch.utils._contextlib._DecoratorContextManager):  # no_grad and its like
            self.say(getattr(value, "mode", ""))
        elif isinstance(value, torch.autocast):
            self.say(value.device, value.fast_dtype, value._enabled)
        elif isinstance(value, argparse.Namespace | types.SimpleNamespace):
            self.take(dict(sorted(vars(value).items())), path)
        elif isinstance(value, torch.jit.ScriptFunction):
            self.say(value.code)
        elif inspect.isfunction(inner := getattr(value, "__wrapped__", None)):  # lru_cache and its like
            self.take(inner, path)
        elif isinstance(value, nn.Module):
            self.take(kind, kind.__qualname__)
            for name, tensor in value.state_dict().items():
                self.say(name)
                self.take(tensor, f"{path}.{name}")
            # Strides and paddings stand in no tensor.
            for name, child in value.named_modules():
                self.say(name, child.extra_repr())
                self.take(type(child), type(child).__qualname__)
        elif isinstance(value, _WITHOUT_STATE) or kind.__module__ in ("_thread", "typing", "__future__"):
            self.say(getattr(value, "__name__", ""))
        elif self.installed(kind.__module__) or not hasattr(value, "__dict__"):
            raise self.unknown(value, path)
        else:
            self.take(kind, kind.__qualname__)
            for name, held in sorted(vars(value).items()):
                self.say(name)
                self.take(held, f"{path}.{name}")

    def foreign(self, module: str | None, *words: str) -> bool:
        """Note something of an installed package, of which name and version are enough."""
        version = self.installed(module or "")
        if version:
            self.say(*words, module, version)
        return bool(version)

    def installed(self, module: str) -> str:
        """What is said of a module that is not the user's, its package's version; empty for the user's."""
        package = _package(module)
        return "" if package == self.own and package != "sfkit" else _installed(package)

    def unknown(self, value: object, path: str) -> InputError:
        kind = type(value)
        return InputError(
            f"architecture {self.architecture!r}: its code uses {path}, a {kind.__module__}."
            f"{kind.__qualname__} whose state cannot be told, so that a change of it would go unseen: pass "
            "version='1' to register_architecture and change it whenever the network's output changes"
        )


def _package(module: str) -> str:
    return module.partition(".")[0]


@functools.cache
def _installed(package: str) -> str:
    """``"standard"``, a version, or nothing for what lies outside Python's folders: the user's code."""
    if package in sys.stdlib_module_names or package == "builtins":
        return "" if package == "__main__" else "standard"
    if package in _SILENT:
        return "installed"
    place = getattr(sys.modules.get(package), "__file__", None)
    if package != "sfkit" and (place is None or not any(p in Path(place).resolve().parents for p in _PLACES)):
        return ""
    names = metadata.packages_distributions().get(package, [package])
    try:
        return metadata.version(names[0])
    except metadata.PackageNotFoundError:
        return "installed"


@functools.cache
def _uses(code: types.CodeType) -> tuple[frozenset[str], frozenset[str]]:
    """Names that code only looks things up in, and those that it does anything else with.

    ``C.get(k)``, ``C[k]`` of a plain key, ``k in C`` and a loop over ``C`` change nothing; whatever else
    follows (a store, another method, an argument, another name) may fill what the name stands for.
    """
    steps = list(dis.get_instructions(code))
    looked: set[str] = set()
    other: set[str] = set()
    # The last one, a return, stands in for what follows it.
    for step, *after in zip(steps, [*steps[1:], steps[-1]], [*steps[2:], *steps[-1:] * 2], strict=True):
        if step.opname.startswith("LOAD_") and step.opname != "LOAD_CONST" and isinstance(step.argval, str):
            following, second = after
            alone = following.opname in ("GET_ITER", "CONTAINS_OP") or (
                following.opname in ("LOAD_METHOD", "LOAD_ATTR") and following.argval in _LOOKING
            )
            subscript = following.opname.startswith("LOAD_") and second.opname == "BINARY_SUBSCR"
            (looked if alone or subscript else other).add(step.argval)
    return frozenset(looked), frozenset(other)


@functools.cache
def _read_names(code: types.CodeType) -> tuple[str, ...]:
    """The globals code reads and does not set: a counter that a run moves is none of its identity.

    Attributes are none, though a global may have the same name: ``self.pool`` reads no ``pool``.
    """
    steps = list(dis.get_instructions(code))
    stored = {step.argval for step in steps if step.opname == "STORE_GLOBAL"}
    reads = {"LOAD_GLOBAL", "LOAD_NAME", "LOAD_FROM_DICT_OR_GLOBALS", "LOAD_CLASSDEREF", "IMPORT_NAME"}
    read = {step.argval for step in steps if step.opname in reads}
    return tuple(name for name in code.co_names if name in read and name not in stored)


@functools.cache
def _import_names(code: types.CodeType) -> frozenset[str]:
    """What an import statement in code names; attributes of that spelling are none."""
    return frozenset(s.argval for s in dis.get_instructions(code) if s.opname == "IMPORT_NAME")


def _imported(name: str, names: dict[str, Any]) -> types.ModuleType | None:
    """A module that code imports where it runs; imported now, so that the digest does not wait for a run."""
    package = names.get("__package__")
    full = [name, f"{package}.{name}"] if package else [name]
    for module in full:
        if module in sys.modules:
            return sys.modules[module]
    for module in full:
        with contextlib.suppress(ImportError, ValueError):  # "from . import x" names nothing
            return importlib.import_module(module)
    return None
