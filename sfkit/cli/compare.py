"""``sfkit compare``: is one network better than another, and where."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sfkit.cli import tables
from sfkit.cli.foreseen import ensure_loadable
from sfkit.cli.options import (
    ArchitectureOption,
    ForceOption,
    JsonOption,
    NetworkOption,
    emit,
)
from sfkit.cli.outputs import Places
from sfkit.cli.panels import BenchmarkOptions, InlineOptions
from sfkit.cli.terminal import Bars
from sfkit.errors import InputError

if TYPE_CHECKING:
    from sfkit.analysis.disparities import DisparityPanels
    from sfkit.analysis.measured import Measured
    from sfkit.analysis.paired import Difference
    from sfkit.datasets.benchmark import Benchmark


def compare(
    first: Annotated[Path, typer.Argument(metavar="A", help="A network's file.", show_default=False)],
    second: Annotated[Path, typer.Argument(metavar="B", help="Another one's.", show_default=False)],
    data: BenchmarkOptions,
    compute: InlineOptions,
    architecture: ArchitectureOption = None,
    option: NetworkOption = None,
    maps: Annotated[
        Path | None,
        typer.Option(help="A folder for PNGs of each pair: disparities, errors, where B is better."),
    ] = None,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Say whether network B is better than A on a benchmark: the difference with its interval over pairs.

    \b
    Examples:
      sfkit compare uniform.safetensors runs/garage/merged.safetensors -b eth3d -r ~/ETH3D
      sfkit compare a.tar b.tar --architecture anynet -b pairs -r ~/pairs --metric d1,epe --maps maps
    """
    a, b = _called(first, second)
    places = Places(csv=data.csv)
    places.reads("A", first)
    places.reads("B", second)
    for file in (first, second):
        options = ensure_loadable(file, architecture, option)
    chosen, metrics = data.open_by_several()
    if maps is not None:
        if compute.engine != "inline":
            raise InputError(f"--maps: found --engine {compute.engine}, expected inline, which sees the maps")
        _claim(places, maps, chosen, force=force)
    from sfkit.analysis.networks import measure_files
    from sfkit.analysis.paired import corrected, paired_difference

    written: list[Path] = []

    def look(panels: DisparityPanels) -> None:
        if maps is not None:
            written.extend(_write(panels, a, b, maps))

    with Bars() as bars:

        def advance(done: int, total: int) -> None:
            bars(chosen.name, done, total, line=f"{chosen.name}: {done} of {total} pairs")

        measured = measure_files(
            {a: first, b: second},
            chosen,
            metrics=metrics,
            architecture=architecture,
            options=options,
            compute=compute,
            progress=advance,
            look=None if maps is None else look,
        )
    asked = tuple(one.name for one in chosen.measurable(metrics)) or (measured.metric,)
    # Several metrics are several claims.
    found = corrected([paired_difference(measured, b, a, metric=metric) for metric in asked])
    document = {
        "benchmark": chosen.describe(),
        "networks": {a: str(first), b: str(second)},
        "differences": [_entry(measured, metric, one) for metric, one in zip(asked, found, strict=True)],
        "maps": [str(file) for file in written],
    }
    emit(document, "\n".join(_lines(measured, chosen, asked, found, maps)), as_json=json)


def _called(first: Path, second: Path) -> tuple[str, str]:
    """What the two are called: by their files, by their folders too where those are named alike."""
    # By the file: two names may lead to one network.
    if first.exists() and second.exists() and first.samefile(second):
        raise InputError(f"{second}: is {first}, expected two networks to compare")
    return (first.stem, second.stem) if first.stem != second.stem else (str(first), str(second))


def _files(folder: Path, pair: str) -> dict[str, Path]:
    """Picture -> its file."""
    from sfkit.figures.differences import PICTURES

    stem = pair.replace("/", "_").replace("\\", "_")
    return {name: folder / f"{stem}_{name}.png" for name in PICTURES}


def _claim(places: Places, maps: Path, benchmark: Benchmark, *, force: bool) -> None:
    files = [file for pair in benchmark.ids for file in _files(maps, pair).values()]
    places.folder("--maps", maps, [file.name for file in files])
    held = next((file for file in files if file.exists()), None)
    if held is not None and not force:
        raise InputError(f"--maps: {held} exists, give another folder or --force")


def _write(panels: DisparityPanels, a: str, b: str, folder: Path) -> Iterable[Path]:
    import numpy as np

    from sfkit.analysis.differences import advantage_panels
    from sfkit.datasets.formats import write_png
    from sfkit.figures.differences import pair_pictures

    files = _files(folder, panels.pair)
    for name, picture in pair_pictures(advantage_panels(panels, a, b)).items():
        # OpenCV writes blue first.
        write_png(files[name], np.ascontiguousarray(picture[..., ::-1]))
        yield files[name]


def _entry(measured: Measured, metric: str, found: Difference) -> dict[str, Any]:
    return {
        "metric": metric,
        "unit": found.unit,
        "scores": {name: measured.score(name, metric=metric) for name in measured.networks},
        "difference": found.value,
        "interval": found.interval,
        "level": found.level,
        "p": found.p,
        "reason": found.reason,
        "verdict": str(found.word),
    }


def _lines(
    measured: Measured,
    benchmark: Benchmark,
    metrics: Sequence[str],
    found: Sequence[Difference],
    maps: Path | None,
) -> list[str]:
    heads = {f"{metric} [{one.unit}]": metric for metric, one in zip(metrics, found, strict=True)}
    rows: list[list[str | float | None]] = [
        [name, *(measured.score(name, metric=metric) for metric in heads.values())]
        for name in measured.networks
    ]
    where = f"protocol {benchmark.protocol} on {benchmark.name} ({benchmark.coverage})"
    return [
        f"{', '.join(metrics)} under {where}",
        *tables.lines(("network", *heads), rows, digits=dict.fromkeys(heads, 3)),
        *(f"{metric}: {one.network} is {one}" for metric, one in zip(metrics, found, strict=True)),
        *([] if maps is None else [f"maps: {maps}"]),
    ]
