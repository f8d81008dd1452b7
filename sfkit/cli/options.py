"""Options that several commands share, and how results are printed."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from sfkit.datasets.benchmark import Benchmark, open_benchmark
from sfkit.errors import InputError
from sfkit.evaluation.store import EvaluationStore
from sfkit.merging import Pool, Recipe, open_pool
from sfkit.merging.saving import read_recipe
from sfkit.search import transfer

PoolArgument = Annotated[
    str, typer.Argument(help="A pool.toml, or the folder that holds one.", show_default=False)
]
BenchmarkOption = Annotated[
    str, typer.Option("--benchmark", "-b", help="eth3d, kitti2012, kitti2015, middlebury, or pairs.")
]
RootOption = Annotated[Path | None, typer.Option("--root", "-r", help="The benchmark's folder.")]
ProtocolOption = Annotated[
    str | None, typer.Option("--protocol", help="openstereo, raft, igev, nmrf or all-valid.")
]
MetricOption = Annotated[
    str | None, typer.Option("--metric", help="bad-1.0 (any threshold in pixels), d1 or epe.")
]
ResolutionOption = Annotated[str | None, typer.Option("--resolution", help="Middlebury: F, H or Q.")]
PairsOption = Annotated[
    Path | None,
    typer.Option("--csv", help="For pairs: a CSV with left,right,disparity[,mask][,coding][,id]."),
]
StoreOption = Annotated[
    Path | None, typer.Option("--store", help="Evaluation store (SQLite) to read and extend.")
]
JsonOption = Annotated[bool, typer.Option("--json", help="Print one JSON document.")]
DeviceOption = Annotated[str, typer.Option("--device", help="cpu, cuda or cuda:N.")]
SubsetOption = Annotated[
    str | None, typer.Option("--subset", "-s", help="Sources to merge with equal weights: a,b,c.")
]
RecipeOption = Annotated[
    Path | None, typer.Option("--recipe", help="A recipe as JSON, or a merged network to take it from.")
]
SubsetFromOption = Annotated[
    Path | None,
    typer.Option("--subset-from", help="A recipe or merged network of another pool: merge the same sources."),
]


def names(text: str) -> tuple[str, ...]:
    """``"a, b"`` -> ``("a", "b")``."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def benchmark_of(
    name: str,
    root: Path | None,
    protocol: str | None,
    metric: str | None,
    resolution: str | None,
    csv: Path | None,
) -> Benchmark:
    """The benchmark the options describe, ready to be scored.

    Raises:
        InputError: as :func:`sfkit.datasets.open_benchmark`, or where no folder is named.
    """
    if root is None:
        raise InputError(f"--root is missing, expected the folder of benchmark {name!r}")
    benchmark = open_benchmark(name, root, protocol=protocol, metric=metric, resolution=resolution, table=csv)
    benchmark.ensure_scorable()
    return benchmark


def recipe_of(
    pool: Pool,
    subset: str | None,
    recipe: Path | None,
    *,
    uniform: bool = False,
    subset_from: Path | None = None,
) -> Recipe:
    """The one recipe the options describe.

    Raises:
        InputError: none or several are given, a name is unknown, or the file holds no recipe.
    """
    if sum((subset is not None, recipe is not None, uniform, subset_from is not None)) != 1:
        raise InputError("expected exactly one of --subset, --subset-from, --recipe and --uniform")
    if subset_from is not None:
        return pool.equal(*transfer(read_recipe(subset_from), pool.names))
    if recipe is not None:
        found = read_recipe(recipe)
        pool.check_recipe(found)
        return found
    if subset is None:
        return pool.uniform()
    chosen = names(subset)
    if not chosen:
        raise InputError("--subset is empty, expected source names such as a,b,c")
    return pool.equal(*chosen)


def device_of(name: str) -> str:
    """A device name torch accepts and this machine has.

    Raises:
        InputError: it is unknown, or not there.
    """
    import torch

    kind, _, number = name.partition(":")
    if kind not in ("cpu", "cuda") or (number and not number.isdigit()):
        raise InputError(f"--device: found {name!r}, expected cpu, cuda or cuda:N")
    if kind == "cuda" and int(number or 0) >= torch.cuda.device_count():
        raise InputError(
            f"--device: {name} is not there, found {torch.cuda.device_count()} CUDA devices; use cpu"
        )
    return name


def store_of(path: Path | None) -> EvaluationStore:
    """The store at ``path``, or one that keeps nothing."""
    return EvaluationStore(path if path is not None else ":memory:")


def pool_of(path: str) -> Pool:
    """Open a pool, saying so on standard error."""
    return open_pool(path)


def say(text: str) -> None:
    """A line of progress on standard error."""
    typer.echo(text, err=True)


def emit(document: Mapping[str, Any], text: str, *, as_json: bool) -> None:
    """Print a result: the document as JSON, or the text."""
    typer.echo(json.dumps(_plain(document), indent=2, allow_nan=False) if as_json else text)


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
