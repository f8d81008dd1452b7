"""Options that several commands share, and how results are printed."""

from __future__ import annotations

import json
import math
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import typer

from sfkit.architectures.code import imported_files
from sfkit.cli.groups import names
from sfkit.cli.terminal import Bars, coloured, printable
from sfkit.cli.terminal import say as say
from sfkit.errors import InputError
from sfkit.outside import once, parse_json

if TYPE_CHECKING:
    from sfkit.evaluation.store import EvaluationStore
    from sfkit.merging import Pool, Recipe
    from sfkit.merging.roster import Roster

Made = TypeVar("Made")
NAMED = ("bank", "bank-slim", "bank-sharp")  # pools that come with sfkit
RENDERED = ("bank", "bank-sharp")  # collections of benchmarks that do
LARGE = 100 * 2**20  # bytes of a checkpoint that takes so long to read that one wants to see it


def _ensure_pool(path: str) -> str:
    """Refuse what is no pool.toml, or one that cannot be read, before anything is imported that opens a pool.

    A name may be one of code that ``--import`` runs.
    """
    if os.sep in path or path.endswith(".toml") or not (path in NAMED or any(imported_files())):
        from sfkit.checkpoints.spec import read_pool_spec

        naming(path, lambda: read_pool_spec(path))
    return path


PoolArgument = Annotated[
    str,
    typer.Argument(
        help="A pool.toml, the folder that holds one, or bank.", show_default=False, callback=_ensure_pool
    ),
]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace files that exist.")]
StoreOption = Annotated[
    Path | None, typer.Option("--store", help="Evaluation store (SQLite) to read and extend.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]
SubsetOption = Annotated[
    str | None, typer.Option("--subset", "-s", help="Sources to merge with equal weights: a,b,c.")
]
RecipeOption = Annotated[
    Path | None, typer.Option("--recipe", help="A recipe as JSON, or a merged network to take it from.")
]
DtypeOption = Annotated[
    str | None,
    typer.Option(
        "--dtype",
        help="Of the written network: float32, float16 or bfloat16; the base's own where it loses nothing.",
    ),
]
ArchitectureOption = Annotated[
    str | None, typer.Option(help="For a checkpoint that does not say its architecture.")
]
NetworkOption = Annotated[
    list[str] | None,
    typer.Option("--option", help="An option of the architecture, such as spn=false.", metavar="NAME=VALUE"),
]
SubsetFromOption = Annotated[
    Path | None,
    typer.Option("--subset-from", help="A recipe or merged network of another pool: merge the same sources."),
]


Chooser = Callable[["Pool"], "Recipe"]
"""Makes the recipe that was asked for, once the pool is open."""


def choosers(
    *,
    pool: Roster | None = None,
    subset: str | None = None,
    subset_from: Path | None = None,
    recipe: Path | None = None,
    weights: str | None = None,
    uniform: bool = False,
) -> dict[str, Chooser]:
    """The recipes the options ask for, by row name; files and lists are read before any pool is opened.

    Raises:
        InputError: an option cannot be read, a file holds no recipe, or a source is none of ``pool``.
    """
    from sfkit.merging.origin import read_recipe
    from sfkit.merging.recipe import Recipe
    from sfkit.search import subset_of, transfer

    found: dict[str, Chooser] = {}
    if uniform:
        found["uniform"] = lambda pool: pool.uniform()
    if subset is not None:
        chosen = source_names("--subset", subset)
        if pool is not None:
            pool.subset(chosen)
        found["+".join(chosen)] = lambda pool: pool.equal(*chosen)
    if weights is not None:
        mixture = _weights(weights)
        if pool is not None:
            pool.subset(mixture)
        found[weights] = lambda pool: Recipe.weighted(_known(pool, mixture), pool.blocks)
    if subset_from is not None:
        other = subset_of(read_recipe(subset_from))
        if pool is not None:
            names = pool.names
            naming(subset_from, lambda: transfer(other, names))
        found[f"sources of {subset_from}"] = lambda pool: pool.equal(
            *naming(subset_from, lambda: transfer(other, pool.names))
        )
    if recipe is not None:
        read = recipe_of(recipe)
        if pool is not None:
            # A name of its own, of which the lambda below knows that it is not None.
            early = pool
            naming(recipe, lambda: early.check_recipe(read))
        found[str(recipe)] = lambda pool: naming(recipe, lambda: _checked(pool, read))
    return found


def recipe_of(path: Path) -> Recipe:
    """A recipe from its JSON file or a merged network; a word where it does not say which networks it means.

    Raises:
        InputError: there is no recipe in it.
    """
    from sfkit.merging.origin import read_recipe

    read = read_recipe(path)
    if read.merged_from is None:
        say(f"warning: {path}: does not say which networks it was made with; they are taken by name")
    return read


def prepared(name: str, pool: Pool, recipe: Recipe) -> Pool:
    """The pool a recipe is for, made by its steps where it has any.

    Args:
        name: of the recipe: its file, if it was read from one.
        pool: as it was opened.
        recipe: whose steps are done.

    Raises:
        InputError: as :func:`sfkit.merging.prepare.prepared_for`; the sentence names the file.
    """
    from sfkit.merging.prepare import prepared_for

    return naming(name, lambda: prepared_for(pool, recipe))


def network_options(texts: list[str] | None) -> dict[str, Any]:
    """``["spn=false"]`` -> ``{"spn": False}``; a value is JSON, or a text.

    Raises:
        InputError: one is no ``NAME=VALUE``, is named twice, or has a value that no option takes.
    """
    return once("--option", map(_option, texts or []))


def _option(text: str) -> tuple[str, Any]:
    name, sign, value = text.partition("=")
    if not sign or not name:
        raise InputError(f"--option: found {text!r}, expected NAME=VALUE such as spn=false")
    try:
        return name, parse_json(value, f"--option {name}", "expected a value such as false or [12, 3, 3]")
    except InputError as error:
        if isinstance(error.__cause__, json.JSONDecodeError):
            return name, value  # a text
        raise


def source_names(argument: str, text: str) -> tuple[str, ...]:
    """``"a, b"`` -> ``("a", "b")``.

    Raises:
        InputError: there is no name in it.
    """
    if not names(text):
        raise InputError(f"{argument} is empty, expected source names such as a,b,c")
    return names(text)


def _weights(text: str) -> dict[str, float]:
    found: dict[str, float] = {}
    for part in source_names("--weights", text):
        name, _, number = (piece.strip() for piece in part.partition("="))
        try:
            value = float(number)
        except ValueError as error:
            raise InputError(f"--weights: found {part!r}, expected NAME=NUMBER such as a=0.3") from error
        if not (math.isfinite(value) and value >= 0):
            raise InputError(f"--weights: found {part!r}, expected a finite number of at least 0")
        if name in found:
            raise InputError(f"--weights: found {name!r} more than once, expected each source once")
        found[name] = value
    return found


def _known(pool: Pool, weights: dict[str, float]) -> dict[str, float]:
    # Refuses a name that the pool has not.
    pool.subset(weights)
    return weights


def _checked(pool: Pool, recipe: Recipe) -> Recipe:
    if not recipe.preparation:  # else it is checked against the pool its steps make
        pool.check_recipe(recipe)
    return recipe


def store_of(path: Path | None) -> EvaluationStore:
    """The store at ``path``, or one that keeps nothing."""
    from sfkit.evaluation.store import EvaluationStore

    return EvaluationStore(path if path is not None else ":memory:")


def pool_of(path: str, blocks: str | None = None, dtype: str | None = None) -> Pool:
    """Open a pool, under its own partition or one made from the network; every error names a file.

    ``dtype`` is what its merged networks are written and scored as, see
    :func:`~sfkit.merging.dtypes.written_as`.
    """
    from sfkit.merging import open_pool
    from sfkit.merging.dtypes import written_as

    with Bars(keep=False) as bars:

        def read(file: Path, done: int, total: int) -> None:
            if file.stat().st_size > LARGE:
                line = f"reading: {done} of {total} networks, {file.name}"
                bars("reading", done, total, file.name, line=line)

        return naming(path, lambda: written_as(open_pool(path, blocks=blocks, progress=read), dtype))


def naming(path: str | Path, make: Callable[[], Made]) -> Made:
    """Make something, and put the file's name before an error that names no file yet."""
    try:
        return make()
    except InputError as error:
        if str(path) in str(error) or str(error).startswith(os.sep):  # members are named by whole paths
            raise
        raise InputError(f"{path}: {error}") from error


def emit(document: Mapping[str, Any], text: str, *, as_json: bool) -> None:
    """Print a result: the document as JSON, or the text."""
    if as_json:
        # Whatever NaN were left would be no JSON: better an error.
        typer.echo(json.dumps(_plain(document), indent=2, allow_nan=False))
    else:
        typer.echo(coloured(printable(text), sys.stdout))


def _plain(value: Any) -> Any:
    """JSON has no NaN or infinity: they become null and a word."""
    if isinstance(value, float) and not math.isfinite(value):
        return None if math.isnan(value) else ("inf" if value > 0 else "-inf")
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(entry) for entry in value]
    if isinstance(value, Path):
        return str(value)
    return value
