"""How a merged network was made, as its file tells."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sfkit.checkpoints.headers import SAFETENSORS, is_checkpoint_name, read_texts
from sfkit.checkpoints.stored import stored_file
from sfkit.errors import InputError, SfkitWarning
from sfkit.merging.recipe import Recipe
from sfkit.outside import parse_json, read_json, table

_ENTRIES = ("recipe", "pool", "architecture", "blocks", "base", "sources", "sfkit")
_MEMBER = ("file", "fingerprint", "licence")
BELONGS = "sfkit.weights"  # in a recipe beside a torch file: the fingerprint of its tensors


@dataclass(frozen=True)
class Origin:
    """How a merged file was made, as its metadata tells.

    Attributes:
        recipe: rebuilds the network from its pool.
        pool: the pool's name.
        architecture: name, version and options.
        blocks: block name -> key patterns.
        base: file name, fingerprint and licence of the base.
        sources: the same of each source with a weight, or that one with a weight was made from, by name.
        sfkit: the version that wrote it.
    """

    recipe: Recipe
    pool: str
    architecture: Mapping[str, Any]
    blocks: Mapping[str, Any]
    base: Mapping[str, str]
    sources: Mapping[str, Mapping[str, str]]
    sfkit: str

    @property
    def licences(self) -> dict[str, str]:
        """Member -> licence as ``pool.toml`` states it; weights trained on restricted data stay so."""
        members = {"base": self.base, **self.sources}
        return {name: member["licence"] or "not stated" for name, member in members.items()}


def read_origin(path: str | Path) -> Origin | None:
    """How a merged file was made; None where it was not made by sfkit.

    Warns (:class:`~sfkit.errors.SfkitWarning`) where the recipe beside a torch file belongs to other weights.

    Raises:
        InputError: the file cannot be read, or its metadata is malformed.
    """
    path = Path(path)
    metadata = stated_metadata(path)
    if metadata is None:
        return None
    values = {entry: _json(path, metadata[f"sfkit.{entry}"]) for entry in _ENTRIES}
    recipe = Recipe.from_dict(_mapping(path, "recipe", values.pop("recipe")), where=str(path))
    origin = Origin(recipe, **values)
    _check_origin(path, origin)
    return origin


def stated_metadata(path: Path) -> dict[str, str] | None:
    """The text entries of a merged file, or of the file beside it; None where sfkit did not make it.

    Raises:
        InputError: the file cannot be read, or an entry is missing.
    """
    metadata: object = stated_texts(path)
    if not metadata and (sidecar := sidecar_of(path)).is_file():
        metadata = read_json(sidecar, "was it edited?")
        belongs = metadata.get(BELONGS) if isinstance(metadata, Mapping) else None
        # A torch file has no room for its recipe: an exchanged one would keep the former one beside it.
        if belongs is not None and belongs != _content(path):
            warnings.warn(
                f"{sidecar}: belongs to other weights than those of {path.name} and is not believed: "
                "move it away, or write the network again",
                SfkitWarning,
                stacklevel=2,
            )
            return None
        path = sidecar
    # Other tools write metadata, too: only what has a recipe was merged here.
    if not isinstance(metadata, Mapping) or "sfkit.recipe" not in metadata:
        return None
    missing = [entry for entry in _ENTRIES if f"sfkit.{entry}" not in metadata]
    if missing:
        raise InputError(f"{path}: its sfkit metadata lacks {', '.join(missing)}, was it edited?")
    return {f"sfkit.{entry}": str(metadata[f"sfkit.{entry}"]) for entry in _ENTRIES}


def sidecar_of(path: Path) -> Path:
    """Where the recipe of a torch file lies that has no room for it."""
    return path.with_name(path.name + ".recipe.json")


def _content(path: Path) -> str:
    from sfkit.checkpoints.reading import content_of, read_checkpoint

    return content_of(read_checkpoint(path).tensors)


def stated_texts(path: Path) -> Mapping[str, str]:
    """The text entries of a checkpoint; only one in which something is unusual needs torch."""
    if path.suffix.lower() == SAFETENSORS and path.is_file():
        return read_texts(path)
    if stored := stored_file(path):
        return stored.metadata
    from sfkit.checkpoints.reading import read_checkpoint

    return read_checkpoint(path).metadata


def _json(path: Path, text: object) -> Any:
    return parse_json(str(text), f"{path}: its sfkit metadata", "was it edited?")


def _check_origin(path: Path, origin: Origin) -> None:
    """Refuse metadata that was edited into another form before anything relies on it."""
    described = _mapping(path, "architecture", origin.architecture, "name", "version", "options")
    _mapping(path, "options", described["options"])
    _mapping(path, "blocks", origin.blocks)
    _mapping(path, "base", origin.base, *_MEMBER)
    for name, member in _mapping(path, "sources", origin.sources).items():
        _mapping(path, f"source {name!r}", member, *_MEMBER)


def _mapping(path: Path, what: str, value: object, *keys: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping) or any(key not in value for key in keys):
        expected = f"an object with {', '.join(keys)}" if keys else "an object"
        raise InputError(f"{path}: its sfkit metadata is malformed at {what}, expected {expected}")
    return value


def read_recipe(path: str | Path) -> Recipe:
    """A recipe from its JSON file, or from a merged network's metadata.

    Raises:
        InputError: no such file, or no recipe in it.
    """
    path = Path(path)
    if is_checkpoint_name(path):
        origin = read_origin(path)
        if origin is None:
            raise InputError(
                f"{path}: carries no recipe, expected a file that sfkit merged or a recipe as JSON"
            )
        members = {"base": origin.base, **origin.sources}
        known = {name: str(member["fingerprint"]) for name, member in members.items()}
        return replace(origin.recipe, merged_from=known)
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected a recipe as JSON or a merged network")
    values = table(read_json(path, "expected what Recipe.to_json writes"), str(path))
    return Recipe.from_dict(values, where=str(path))
