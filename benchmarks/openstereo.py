"""A model of a fetched OpenStereo checkout through sfkit: open, merge, evaluate on a real pair, search.

    SFKIT_OPENSTEREO=~/OpenStereo SFKIT_REAL_DATA=~/real python benchmarks/openstereo.py PSMNet --json

Weights are random: base and two sources that differ from it a little, in files as OpenStereo's trainer
writes them. They tell what such a pool takes and that every step runs, not how good a merge is. CPU seconds
are those of this process, with one thread; measure one model a process, for its peak memory. What the
checkout itself requires (timm) must be installed.
"""

from __future__ import annotations

import sys
import tempfile
import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager, redirect_stdout
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal

import cv2
import numpy as np
import torch
from processes import answered, call, folder_of, peak_mb, shown
from real_pairs import data
from synthetic_pool import pool_file
from tabulated import markdown_lines

import sfkit
from sfkit.architectures import architecture

CHECKOUT = "SFKIT_OPENSTEREO"
EVALUATIONS = 4  # of Stage 2, the first of which is the one subset of Stage 1
MOVED = 0.01  # of a tensor's standard deviation, by which a source differs from the base


@dataclass(frozen=True)
class ModelCase:
    """A model and the part of the real pair it sees: random weights make IGEV's updates slow.

    Attributes:
        cfg: its configuration below ``cfgs/``.
        size: (height, width) of the part, in pixels; PSMNet pools over 64 x 64 cells of 4 pixels.
    """

    cfg: str
    size: tuple[int, int]


CASES = {
    "LightStereo-S": ModelCase("lightstereo/lightstereo_s_sceneflow.yaml", (352, 448)),
    "IGEV": ModelCase("igev/igev_sceneflow_amp.yaml", (64, 96)),
    "PSMNet": ModelCase("psmnet/psmnet_sceneflow.yaml", (256, 256)),
}


def measure(name: Literal["LightStereo-S", "IGEV", "PSMNet"]) -> dict[str, Any]:
    """Walk one model's road: :func:`walk` with one of :data:`CASES` from a checkout of OpenStereo."""
    case = CASES[name]
    options = {"root": str(folder_of(CHECKOUT)), "cfg": case.cfg}
    return {"name": name, **walk("openstereo", options, case.size)}


def walk(kind: str, options: Mapping[str, Any], size: tuple[int, int]) -> dict[str, Any]:
    """From opening a pool to a tiny search, in a folder that is removed after.

    Args:
        kind: an architecture.
        options: its options.
        size: (height, width) of the part of the real pair.

    Returns:
        ``parameters``, ``blocks``, ``size``; CPU seconds as ``open``, ``merge``, ``evaluate`` and ``search``;
        ``evaluations``, all different ones; ``peak_memory_mb``.

    Raises:
        InputError: the checkout or the pair is not there.
    """
    torch.set_num_threads(1)
    spent = dict[str, float]()
    # What a checkout prints is not the document.
    with tempfile.TemporaryDirectory() as folder, redirect_stdout(sys.stderr):
        path = write_pool(Path(folder), kind, options)
        pairs = write_pair(Path(folder) / "pairs", size)
        with _timed(spent, "open"):
            pool = sfkit.open_pool(path)
        recipe = pool.uniform()
        with _timed(spent, "merge"):
            merged = sfkit.save_merged(pool, recipe, Path(folder) / "merged.safetensors")
        scorer = sfkit.Evaluator(
            pool, sfkit.open_benchmark("pairs", pairs, coding="png8:4", metric="bad-3.0")
        )
        with _timed(spent, "evaluate"):
            (outcome,) = scorer([recipe])
        with _timed(spent, "search"):
            which = sfkit.SubsetSearch(
                pool.names, pool.blocks, scorer, sfkit.SubsetSettings(population=3, generations=1)
            ).run()
            how = sfkit.RoutingSearch(
                pool.names, pool.blocks, scorer, sfkit.RoutingSettings(evaluations=EVALUATIONS)
            ).run()
        evaluated = len(list(scorer.store))
        origin = sfkit.read_origin(merged)
        assert origin is not None
        assert origin.recipe == recipe
        assert np.isfinite([outcome.score, which.score, how.score]).all()
        network = pool.merge(recipe).network
    return {
        "size": list(size),
        "parameters": sum(parameter.numel() for parameter in network.parameters()),
        "blocks": list(pool.blocks),
        **{key: round(seconds, 1) for key, seconds in spent.items()},
        "evaluations": evaluated,
        "peak_memory_mb": round(peak_mb()),
    }


def write_pool(folder: Path, kind: str, options: Mapping[str, Any]) -> Path:
    """Base and two sources with random weights, as OpenStereo's trainer saves them, and their pool.toml."""
    torch.manual_seed(0)
    entry = architecture(kind)
    network = entry.build(**entry.resolve(options))
    base = {key: tensor.clone() for key, tensor in network.state_dict().items()}
    for number, name in enumerate(("base", "a", "b")):
        drawn = torch.Generator().manual_seed(number)
        state = {
            key: tensor + MOVED * number * tensor.std() * torch.randn(tensor.shape, generator=drawn)
            if tensor.ndim > 1
            else tensor
            for key, tensor in base.items()
        }
        torch.save({"model_state": state, "optimizer_state": {}, "epoch": 1}, folder / f"{name}.pth")
    return pool_file(folder / "pool.toml", kind, options, "ab")


def write_pair(root: Path, size: tuple[int, int]) -> Path:
    """The middle of Middlebury's Cones as a folder of one pair; disparities stay PNGs of a quarter pixel."""
    names = {"left.png": "im2.png", "right.png": "im6.png", "disp.png": "disp2.png"}
    (root / "cones").mkdir(parents=True)
    for name, original in names.items():
        image = cv2.imread(str(data() / "pairs" / "cones" / original), cv2.IMREAD_UNCHANGED)
        top, left = ((image.shape[axis] - size[axis]) // 2 for axis in (0, 1))
        cv2.imwrite(str(root / "cones" / name), image[top : top + size[0], left : left + size[1]])
    return root


@contextmanager
def _timed(spent: dict[str, float], name: str) -> Iterator[None]:
    started = time.process_time()
    yield
    spent[name] = time.process_time() - started


def section() -> str:
    """One row a model, each measured in a process of its own."""
    return f"""## Networks of an OpenStereo checkout

`{shown("openstereo.py", "MODEL")}` with `SFKIT_OPENSTEREO` naming a checkout of
XiandaGuo/OpenStereo (May 2026), whose code runs as it stands, and timm 1.0. Base and two sources
have random weights, in files as its trainer writes them; the pair is a part of Middlebury's Cones
of the size that the table names. So this says that each step runs and what it takes, not how well
such networks merge. CPU seconds of one thread, opening with everything imported; the search is
Stage 1 over the one subset of two sources, which was scored before, and three mixtures more in Stage 2.

{table(call("openstereo.py", name, "--json") for name in CASES)}"""


def table(results: Iterable[dict[str, Any]]) -> str:
    """What ``walk`` of ``benchmarks/openstereo.py`` found, a network a row."""
    steps = {"open": "open", "merge": "merge, write", "evaluate": "one evaluation", "search": "search"}
    cells = []
    for r in results:
        first = (r["name"], f"{r['parameters']:,}", "{} x {}".format(*r["size"]), ", ".join(r["blocks"]))
        cells.append((*first, *(f"{r[step]} s" for step in steps), f"{r['peak_memory_mb']:,}"))
    heads = ("model", "parameters", "size", "blocks", *steps.values(), "peak MB")
    return markdown_lines(heads, cells, [False, True, True, False, *[True] * 5])


if __name__ == "__main__":
    answered(measure)
