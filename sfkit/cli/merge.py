"""``sfkit merge``: write the network a recipe describes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sfkit.checkpoints.writing import FileForm, check_target
from sfkit.cli.options import (
    JsonOption,
    PoolArgument,
    RecipeOption,
    SubsetFromOption,
    SubsetOption,
    emit,
    names,
    pool_of,
    recipe_of,
)
from sfkit.errors import InputError
from sfkit.merging import Pool, Recipe
from sfkit.merging.saving import read_origin, save_merged


def merge(
    pool: PoolArgument,
    out: Annotated[Path, typer.Option("--out", "-o", help="The file to write.")],
    subset: SubsetOption = None,
    recipe: RecipeOption = None,
    subset_from: SubsetFromOption = None,
    weights: Annotated[str | None, typer.Option(help="One weight a source: a=0.3,b=0.7.")] = None,
    uniform: Annotated[bool, typer.Option("--uniform", help="Merge all sources equally.")] = False,
    form: Annotated[
        FileForm, typer.Option(help="safetensors, or the original checkpoint's torch layout.")
    ] = FileForm.SAFETENSORS,
    force: Annotated[bool, typer.Option("--force", help="Replace an existing file.")] = False,
    json: JsonOption = False,
) -> None:
    """Write one merged network, in the key names of the original checkpoints.

    \b
    Examples:
      sfkit merge pool.toml --subset kitti,driving -o merged.safetensors
      sfkit merge pool.toml --recipe runs/garage/recipe.json -o merged.pth --form original
    """
    check_target(out, form, overwrite=force)
    opened = pool_of(pool)
    chosen = (
        _weighted(opened, weights)
        if weights
        else recipe_of(opened, subset, recipe, uniform=uniform, subset_from=subset_from)
    )
    written = save_merged(opened, chosen, out, form=form, overwrite=force)
    origin = read_origin(written)
    licences = origin.licences if origin else {}
    document = {"file": written, "recipe": chosen.as_dict(), "licences": licences}
    lines = [f"wrote {written}", *(f"  {name}: {licence}" for name, licence in licences.items())]
    emit(document, "\n".join(lines), as_json=json)


def _weighted(pool: Pool, text: str) -> Recipe:
    weights = {}
    for part in names(text):
        name, sign, number = part.partition("=")
        try:
            weights[name.strip()] = float(number)
        except ValueError as error:
            raise InputError(f"--weights: found {part!r}, expected NAME=NUMBER such as a=0.3") from error
        if not sign:
            raise InputError(f"--weights: found {part!r}, expected NAME=NUMBER such as a=0.3")
    pool.subset(weights)
    return Recipe.weighted(weights, pool.blocks)
