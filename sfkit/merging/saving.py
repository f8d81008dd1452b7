"""Merged networks as files that carry their recipe, their origin and their licences."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import Any

from sfkit.checkpoints.reading import is_checkpoint_name, read_checkpoint
from sfkit.checkpoints.writing import FileForm, form_of, write_checkpoint
from sfkit.errors import InputError
from sfkit.files import write_text
from sfkit.merging.members import Checked
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe

_ENTRIES = ("recipe", "pool", "architecture", "blocks", "base", "sources", "sfkit")
_MEMBER = ("file", "fingerprint", "licence")


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


def origin_metadata(pool: Pool, recipe: Recipe) -> dict[str, str]:
    """The text entries a merged file carries; :func:`read_origin` reads them back."""
    signed = pool.signed(recipe)
    weighing = [n for e, n in enumerate(recipe.sources) if any(row[e] for row in recipe.weights)]
    members = {origin.name: origin for name in weighing for origin in pool.origins[name]}
    described = pool.describe()
    values = {
        "recipe": signed.as_dict(),
        "pool": pool.name,
        "architecture": {**{key: described[key] for key in ("name", "version")}, "options": pool.options},
        "blocks": dict(zip(pool.blocks, map(list, pool.partition.patterns), strict=True)),
        "base": _member(pool.base),
        "sources": {name: _member(member) for name, member in members.items()},
        "sfkit": version("sfkit"),
    }
    return {f"sfkit.{key}": json.dumps(value) for key, value in values.items()}


def _member(member: Checked) -> dict[str, str]:
    return {"file": member.path.name, "fingerprint": member.fingerprint, "licence": member.licence}


def save_merged(
    pool: Pool,
    recipe: Recipe,
    path: str | Path,
    *,
    form: FileForm | str = FileForm.SAFETENSORS,
    overwrite: bool = False,
) -> Path:
    """Write the network a recipe describes, in the key names of the base's file.

    A bare torch state dict has no room for metadata, so there the recipe lies beside it as
    ``NAME.recipe.json``.

    Raises:
        InputError: the recipe does not suit the pool, a file of the pool has changed, or the target is
            refused (:func:`~sfkit.checkpoints.writing.check_target`).
    """
    metadata = origin_metadata(pool, recipe)
    state, layout = pool.state_dict(recipe), pool.base.layout
    written = write_checkpoint(path, state, layout=layout, metadata=metadata, form=form, overwrite=overwrite)
    try:
        pool.ensure_unchanged()
    except InputError:
        written.unlink()  # its tensors come from before and after a change
        raise
    if form_of(form) is FileForm.ORIGINAL and layout.container is None:
        sidecar = written.with_name(written.name + ".recipe.json")
        write_text(sidecar, json.dumps(metadata, indent=2))
    return written


def read_origin(path: str | Path) -> Origin | None:
    """How a merged file was made; None where it was not made by sfkit.

    Raises:
        InputError: the file cannot be read, or its metadata is malformed.
    """
    path = Path(path)
    metadata: object = read_checkpoint(path).metadata
    sidecar = path.with_name(path.name + ".recipe.json")
    if not metadata and sidecar.is_file():
        path, metadata = sidecar, _json(sidecar, sidecar.read_text(encoding="utf-8", errors="replace"))
    if not isinstance(metadata, Mapping) or "sfkit.recipe" not in metadata:
        return None
    missing = [entry for entry in _ENTRIES if f"sfkit.{entry}" not in metadata]
    if missing:
        raise InputError(f"{path}: its sfkit metadata lacks {', '.join(missing)}, was it edited?")
    values = {entry: _json(path, metadata[f"sfkit.{entry}"]) for entry in _ENTRIES}
    recipe = Recipe.from_dict(_mapping(path, "recipe", values.pop("recipe")), where=str(path))
    origin = Origin(recipe, **values)
    _check_origin(path, origin)
    return origin


def _json(path: Path, text: object) -> Any:
    try:
        return json.loads(str(text))
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: its sfkit metadata is no JSON ({error}), was it edited?") from error


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
        return origin.recipe
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected a recipe as JSON or a merged network")
    return Recipe.from_json(path.read_text(encoding="utf-8", errors="replace"), where=str(path))
