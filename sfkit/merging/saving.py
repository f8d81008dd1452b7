"""Merged networks as files that carry their recipe, their origin and their licences."""

from __future__ import annotations

import json
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

import torch

from sfkit.checkpoints.layouts import Layout
from sfkit.checkpoints.reading import content_of, read_checkpoint
from sfkit.checkpoints.targets import FileForm, check_target
from sfkit.checkpoints.writing import write_checkpoint
from sfkit.errors import InputError, member_of
from sfkit.files import write_text
from sfkit.merging.members import Checked
from sfkit.merging.origin import BELONGS, sidecar_of
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe


def origin_metadata(pool: Pool, recipe: Recipe) -> dict[str, str]:
    """The text entries a merged file carries; :func:`read_origin` reads them back."""
    signed = pool.signed(recipe)
    described = pool.describe()
    values = {
        "recipe": signed.as_dict(),
        "pool": pool.name,
        "architecture": {**{key: described[key] for key in ("name", "version")}, "options": pool.options},
        "blocks": dict(zip(pool.blocks, map(list, pool.partition.patterns), strict=True)),
        "base": _member(pool.base),
        "sources": {name: _member(member) for name, member in pool.taking_part(recipe).items()},
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
    ``NAME.recipe.json``, which is written first and names the weights it belongs to.

    Raises:
        InputError: the recipe does not suit the pool, a file of the pool has changed, or the target is
            refused (:func:`~sfkit.checkpoints.writing.check_target`).
    """
    metadata = origin_metadata(pool, recipe)
    # Merged before anything is written: what this type cannot hold is refused here.
    state, layout = pool.state_dict(recipe), pool.base.layout
    path = check_target(path, form, overwrite=overwrite)
    # First, so that no weights lie there without their recipe.
    write_beside(path, layout, metadata, form, state=state, overwrite=overwrite)
    written = write_checkpoint(path, state, layout=layout, metadata=metadata, form=form, overwrite=overwrite)
    try:
        pool.ensure_unchanged()
    except InputError:
        written.unlink()  # its tensors come from before and after a change
        raise
    return written


def write_beside(
    path: Path,
    layout: Layout,
    metadata: Mapping[str, str],
    form: FileForm | str = FileForm.ORIGINAL,
    *,
    state: Mapping[str, torch.Tensor] | None = None,
    overwrite: bool = True,
) -> None:
    """Metadata that a bare torch state dict has no room for, as ``NAME.recipe.json``, bound to its weights.

    Args:
        path: of the torch file.
        layout: its layout; one with a container needs nothing beside it.
        metadata: what to write; nothing where it is empty.
        form: of the file.
        state: the weights that are about to be written there; those that are there unless given.
        overwrite: whether a recipe of sfkit's that lies there may be replaced.

    Raises:
        InputError: a file of that name is there and is the user's, or may not be replaced.
    """
    if (
        member_of(FileForm, "form", form) is not FileForm.ORIGINAL
        or layout.container is not None
        or not metadata
    ):
        return
    sidecar = sidecar_of(path)
    # A file of that name may be the user's own.
    ours = sidecar.exists() and "sfkit.recipe" in sidecar.read_text(encoding="utf-8", errors="replace")
    if sidecar.exists() and not (overwrite and ours):
        raise InputError(
            f"{sidecar}: exists and would hold the recipe of {path.name}, give another name or move it away"
        )
    named = read_checkpoint(path).tensors if state is None else layout.name(state)
    write_text(sidecar, json.dumps({**metadata, BELONGS: content_of(named)}, indent=2))
