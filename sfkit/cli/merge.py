"""``sfkit merge``: write the network a recipe describes."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from sfkit.checkpoints.targets import FileForm, check_target, ensure_room
from sfkit.cli.foreseen import roster_of
from sfkit.cli.options import (
    DtypeOption,
    ForceOption,
    JsonOption,
    PoolArgument,
    RecipeOption,
    SubsetFromOption,
    SubsetOption,
    choosers,
    emit,
    pool_of,
    prepared,
)
from sfkit.cli.outputs import Places
from sfkit.errors import InputError


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
    dtype: DtypeOption = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Write one merged network, in the key names of the original checkpoints.

    \b
    Examples:
      sfkit merge pool.toml --subset kitti,driving -o merged.safetensors
      sfkit merge pool.toml --recipe runs/garage/recipe.json -o merged.pth --form original
    """
    check_target(out, form, overwrite=force)
    Places(recipe=recipe, subset_from=subset_from).claim("--out", out)
    roster = roster_of(pool, dtype=dtype)
    asked = choosers(
        pool=roster, subset=subset, subset_from=subset_from, recipe=recipe, weights=weights, uniform=uniform
    )
    if len(asked) != 1:
        raise InputError(
            "expected exactly one of --subset, --subset-from, --recipe, --weights and --uniform, "
            f"found {len(asked)}"
        )
    from sfkit.merging.origin import read_origin
    from sfkit.merging.saving import save_merged

    opened = pool_of(pool, dtype=dtype)
    for member in (opened.base, *opened.sources):
        # By the file, not by its name: a link leads to the pool's own, too.
        if out.exists() and out.samefile(member.path):
            raise InputError(f"--out: {out} is the pool's own {member.name!r}, give another name")
    # A merge is as large as its base.
    ensure_room(out, opened.base.path.stat().st_size)
    ((name, choose),) = asked.items()
    chosen = choose(opened)
    written = save_merged(prepared(name, opened, chosen), chosen, out, form=form, overwrite=force)
    origin = read_origin(written)
    licences = origin.licences if origin else {}
    document = {"file": written, "recipe": chosen.as_dict(), "licences": licences}
    note = [] if weights is None else weight_note(sum(chosen.weights[0]))
    if note:
        document["note"] = note[0]
    lines = [f"wrote {written}", *note, *(f"  {name}: {licence}" for name, licence in licences.items())]
    emit(document, "\n".join(lines), as_json=json)


def weight_note(total: float) -> list[str]:
    """What weights that do not sum to 1 mean: base + total * the weighted mean of task vectors."""
    # Ten times 0.1 is not quite 1.
    if abs(total - 1.0) < 1e-6:
        return []
    kind = "short of" if total < 1 else "beyond"
    return [
        f"  the weights sum to {total:g}, not to 1: the network lies {total:g} times as far from the base "
        f"as the weighted mean of its sources, {kind} it; running statistics are never carried beyond"
    ]
