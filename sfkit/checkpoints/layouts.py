"""The layouts checkpoints come in, unwrapped in one place.

A training script saves its state dict bare or inside a dictionary (``state_dict``, ``model_state``, ``ema``),
often with the prefix that a wrapper adds to every key: ``module.`` of DataParallel, ``_orig_mod.`` of
``torch.compile``. Prefixes that are attributes of a training class (``model.``, ``net.``) can only be told
from the network's own names, where those are known: see :mod:`sfkit.checkpoints.prefixes`.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard, TypeVar

from sfkit.checkpoints.inert import foreign
from sfkit.errors import InputError, SfkitWarning
from sfkit.outside import parse_json

if TYPE_CHECKING:
    import torch

Held = TypeVar("Held")

# In the order in which they are taken where a file has several: what was trained before its averages.
CONTAINERS = (
    *("state_dict", "model_state", "model_state_dict", "model", "net", "network", "params", "weights"),
    *("params_ema", "model_ema", "ema_state_dict", "state_dict_ema", "ema"),
)
WRAPPERS = ("module.", "_orig_mod.")
OWN = "sfkit"  # the outer dictionary's entry that says how sfkit made a merged file


@dataclass(frozen=True)
class Wrapping:
    """Where in a file a network's tensors are, as ``pool.toml`` may say it; what is None is recognised.

    Attributes:
        container: the entry that holds them, ``"ema"`` or ``"ema.module"`` for one inside another.
        prefix: what stands before the network's keys; other keys are not the network's.
    """

    container: str | None = None
    prefix: str | None = None


@dataclass(frozen=True)
class Layout:
    """How a file wraps its tensors.

    Attributes:
        container: the entry of the outer dictionary that holds them, ``"a.b"`` for one inside another; None
            for a bare state dict.
        prefix: what stands before every key of the network, such as ``"module."``, or nothing.
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
        content: dict[str, Any] = self.name(state)
        # From the inside out: a container may lie in another.
        for name in reversed(self.container.split(".") if self.container else ()):
            content = {name: content}
        return {**content, **self.beside} if self.container else content


def unwrap(
    content: object, path: Path, container: str | None = None
) -> tuple[dict[str, torch.Tensor], Layout]:
    """The tensors of a loaded file by their keys without wrappers' prefixes, and the layout that was found.

    Args:
        content: what was loaded.
        path: named in errors.
        container: the entry to take; recognised unless given.

    Warns (:class:`~sfkit.errors.SfkitWarning`) where several entries hold weights and one was taken.

    Raises:
        InputError: no state dict is found; the message lists what the file holds instead.
    """
    import torch

    tensors, layout = unwrap_any(content, path, torch.Tensor, container)
    # A file may hold parameters, which are made for training: their values are meant.
    return {key: tensor.detach() for key, tensor in tensors.items()}, layout


def unwrap_any(
    content: object, path: Path, kind: type[Held], container: str | None = None
) -> tuple[dict[str, Held], Layout]:
    """The same of a file in which values of the type ``kind`` stand where tensors do."""
    found, state = _contained(content, path, kind, container)
    beside: dict[str, float | str] = {}
    if found is not None and isinstance(content, Mapping):
        beside = {key: value for key, value in content.items() if _is_plain(key, value)}
    tensors = {str(key): value for key, value in state.items() if isinstance(value, kind)}
    prefix = common_prefix(tensors)
    return {key[len(prefix) :]: tensor for key, tensor in tensors.items()}, Layout(
        found, prefix, beside=beside
    )


def _contained(
    content: object, path: Path, kind: type[Any], container: str | None
) -> tuple[str | None, Mapping[Any, Any]]:
    if container:
        inner = content
        for name in container.split("."):
            if not isinstance(inner, Mapping) or name not in inner:
                held = (
                    ", ".join(sorted(map(str, inner))[:8]) if isinstance(inner, Mapping) else describe(inner)
                )
                raise InputError(f"{path}: has no entry {name!r} (container {container!r}), found {held}")
            inner = inner[name]
        if not _is_state(inner, kind):
            raise InputError(f"{path}: {container!r} is {describe(inner)}, expected a state dict")
        return container, inner
    if _is_state(content, kind):
        return None, content
    if not isinstance(content, Mapping) or not content:
        raise InputError(
            f"{path}: found {describe(content)}, expected a state dict of named tensors: "
            "save the network with torch.save(network.state_dict(), path)"
        )
    candidates = list(_candidates(content, kind))
    if not candidates:
        held = ", ".join(_named(key, content[key]) for key in sorted(content, key=str)[:8])
        raise InputError(
            f"{path}: found a dictionary with {held}, expected a state dict, bare or under one of "
            f'{", ".join(CONTAINERS)}: name its entry (container = "..." in pool.toml), or save the network '
            "with torch.save(network.state_dict(), path)"
        )
    name, state = candidates[0]
    if len(candidates) > 1:
        others = ", ".join(other for other, _ in candidates[1:])
        warnings.warn(
            f'{path}: holds weights under {name} and {others}, {name} was read: say container = "..." in '
            "pool.toml where another is meant",
            SfkitWarning,
            stacklevel=5,
        )
    return name, state


def _candidates(
    content: Mapping[Any, Any], kind: type[Any], outer: str = ""
) -> Iterator[tuple[str, Mapping[Any, Any]]]:
    """Entries that hold a state dict, those in an entry that is a container itself last."""
    known = [name for name in CONTAINERS if isinstance(content.get(name), Mapping)]
    for name in known:
        if _is_state(content[name], kind):
            yield outer + name, content[name]
    for name in () if outer else known:
        inner = content[name]
        if not _is_state(inner, kind):
            wrapped = inner.get("module")
            if _is_state(wrapped, kind):
                yield f"{name}.module", wrapped
            yield from _candidates(inner, kind, f"{name}.")


def own_texts(path: Path, content: object) -> dict[str, str]:
    """What :mod:`sfkit.checkpoints.writing` put beside the weights of a torch file."""
    held = content.get(OWN) if isinstance(content, Mapping) else None
    if not isinstance(held, str):
        return {}
    values = parse_json(held, f"{path}: its sfkit entry", "was it edited?")
    return {str(k): str(v) for k, v in values.items()} if isinstance(values, dict) else {}


def common_prefix(keys: Mapping[str, Any]) -> str:
    """What wrappers put before every key: ``"module."``, ``"_orig_mod."``, several of them, or nothing."""
    prefix = ""
    while keys:
        longer = [prefix + w for w in WRAPPERS if all(key.startswith(prefix + w) for key in keys)]
        if not longer:
            break
        prefix = longer[0]
    return prefix


def _is_state(value: object, kind: type[Any]) -> TypeGuard[Mapping[str, Any]]:
    """Named tensors, beside which numbers, texts and foreign objects may stand, but nothing nested."""
    if not isinstance(value, Mapping) or not all(isinstance(key, str) for key in value):
        return False
    others = [entry for entry in value.values() if not isinstance(entry, kind)]
    plain = all(entry is None or isinstance(entry, int | float | str) or foreign(entry) for entry in others)
    # Counters and names may lie among tensors, but not alone.
    return len(others) < len(value) and plain


def _is_plain(key: object, value: object) -> bool:
    """A number or text beside the container; what sfkit itself wrote there is written anew."""
    return isinstance(key, str) and key != OWN and isinstance(value, (int, float, str))


def _named(key: object, value: object) -> str:
    return f"{key} ({describe(value)})" if foreign(value) else str(key)


def describe(value: object) -> str:
    """An entry of a file as a sentence names it."""
    if name := foreign(value):
        return f"an object of {name}, whose code sfkit does not run"
    if isinstance(value, Mapping):
        return f"a dictionary of {len(value)}" if value else "an empty dictionary"
    return f"a {type(value).__name__}"
