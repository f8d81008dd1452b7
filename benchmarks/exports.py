"""One network merged and exported, checked beside itself on a real pair or a part of one.

    SFKIT_REAL_DATA=~/real python benchmarks/exports.py nmrf-swint onnx --json
    SFKIT_REAL_DATA=~/real python benchmarks/exports.py anynet torch --dynamic

AnyNet is four real checkpoints merged. Published weights of the others are not at hand: the base is filled by
the rules that the golden arrays were made with, and each source is the base with every value moved by 1 %.
All layers take part. CPU seconds are those of this process, with one thread; measure one export a process,
for its peak memory. It is ended after 15 CPU minutes, and what asks for more than 18 GiB fails. The section
keeps a run under ``runs/results/exports`` as soon as it is finished: together they take many minutes.
"""

from __future__ import annotations

import json
import resource
import signal
import subprocess
import sys
import tempfile
import time
import warnings
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

import torch
from processes import RESULTS, answered, call, peak_mb, shown
from real_pairs import POOL, data
from synthetic_pool import pool_file
from tabulated import numbers

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "architectures"))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from foundation_stereo_reference import filled_state
from nmrf_fill import fill

import sfkit
from sfkit.architectures import architecture
from sfkit.datasets.images import read_image
from sfkit.errors import SfkitError
from sfkit.exporting.forms import ENDINGS, Form
from sfkit.files import write_text

MOVED = 0.01  # of each value, by which a source differs from the base
MOST_SECONDS = 900  # of CPU: what runs longer is ended by SIGXCPU
MOST_MEMORY = 18 << 30  # bytes: what asks for more fails
KEPT = RESULTS / "exports"


@dataclass(frozen=True)
class ExportCase:
    """A network, and what it sees of a real pair.

    Attributes:
        kind: its architecture.
        images: left and right one below ``pairs`` of the real data.
        size: (height, width) of the part in pixels; None for the whole pair.
        options: what keeps it short.
    """

    kind: str
    images: tuple[str, str] = ("cones/im2.png", "cones/im6.png")
    size: tuple[int, int] | None = (64, 128)
    options: Mapping[str, Any] = field(default_factory=dict)


_SHORT = {"iterations": 1, "max_disp": 64}
_MOTORCYCLE = ("motorcycle/motorcycle_left.png", "motorcycle/motorcycle_right.png")
CASES = {
    "anynet": ExportCase("anynet", _MOTORCYCLE, None),
    "nmrf-res": ExportCase("nmrf-res"),
    "nmrf-swint": ExportCase("nmrf-swint"),
    "foundation-stereo-s": ExportCase("foundation-stereo", options={"vit_size": "vits", **_SHORT}),
    "foundation-stereo-l": ExportCase("foundation-stereo", options={"vit_size": "vitl", **_SHORT}),
}
FORMS = ("onnx", "torch", "torchscript")
# The rows of the table of results: network, format, whether of any size.
WANTED = (
    *((name, form, False) for name in list(CASES)[:4] for form in FORMS),
    ("foundation-stereo-l", "torch", False),
    ("foundation-stereo-l", "torchscript", False),
    ("anynet", "onnx", True),
    ("anynet", "torch", True),
    ("nmrf-res", "onnx", True),
)


def measure(
    name: Literal["anynet", "nmrf-res", "nmrf-swint", "foundation-stereo-s", "foundation-stereo-l"],
    form: Literal["onnx", "torch", "torchscript"],
    dynamic: bool = False,
) -> dict[str, Any]:
    """Merge, export (``dynamic``: to one file for all sizes), compare.

    Returns:
        ``seconds`` of CPU, ``peak_memory_mb``, and either ``error`` or ``file_mb``, ``percentile99``,
        ``largest`` and ``mean`` in pixels.
    """
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_SECONDS, MOST_SECONDS + 60))
    resource.setrlimit(resource.RLIMIT_DATA, (MOST_MEMORY, MOST_MEMORY))
    torch.set_num_threads(1)
    case, kind = CASES[name], Form(form)
    left, right = (read_image(data() / "pairs" / file) for file in case.images)
    if case.size is not None:
        tall, wide = case.size
        left, right = (image[100 : 100 + tall, 60 : 60 + wide] for image in (left, right))
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        pool = sfkit.open_pool(POOL if case.kind == "anynet" else _pool(folder, case))
        merged = sfkit.save_merged(pool, pool.uniform(), folder / "merged.safetensors")
        out = folder / f"out{ENDINGS[kind][0]}"
        said: dict[str, Any]
        started = time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = sfkit.export_network(merged, out, form=kind, dynamic=dynamic, pair=(left, right))
            said = {key: getattr(found, key) for key in ("percentile99", "largest", "mean")}
            said["file_mb"] = round(out.stat().st_size / 1e6, 1)
        except SfkitError as error:
            said = {"error": str(error)}
        seconds = round(time.process_time() - started)
    about = {"name": name, "format": form, "dynamic": dynamic, "size": list(left.shape[:2])}
    return {**about, "seconds": seconds, "peak_memory_mb": round(peak_mb()), **said}


def _pool(folder: Path, case: ExportCase) -> Path:
    """Base and two sources in files."""
    if case.kind == "foundation-stereo":
        base = filled_state(str(case.options["vit_size"]))
    else:
        network = architecture(case.kind).build()
        fill(network, "A")
        base = {key: tensor.clone() for key, tensor in network.state_dict().items()}
    torch.save(base, folder / "base.pth")
    for number, name in enumerate("ab"):
        moved = {key: _moved(key, tensor, number) for key, tensor in base.items()}
        torch.save(moved, folder / f"{name}.pth")
    return pool_file(folder / "pool.toml", case.kind, case.options, "ab")


def _moved(key: str, tensor: torch.Tensor, number: int) -> torch.Tensor:
    """Every value by about 1 %; what two keys name is one tensor, and moves as one."""
    if not tensor.is_floating_point() or not tensor.numel() or key.endswith((".mean", ".std")):
        return tensor
    drawn = torch.Generator().manual_seed(zlib.crc32(tensor.numpy().tobytes(), number))
    return tensor * (1 + MOVED * torch.randn(tensor.shape, generator=drawn))


HEAD = f"""## Merged networks exported

`{shown("exports.py", "NAME", "FORMAT")}`, with `--dynamic` for a file of all sizes. AnyNet is
four real checkpoints merged uniformly, propagation included, on Middlebury's whole Motorcycle (500 x 741
pixels). The others are merged from two copies of a base with every value moved by 1 %; the base's weights are
filled by the rule its golden arrays were made with, since published ones are not at hand. All layers take
part, of FoundationStereo (s: ViT-S, l: ViT-L) one update and 64 disparities; their pair is a part of
Middlebury's Cones of 64 x 128 pixels. CPU seconds are of one thread; after 900 a run is stopped."""
COLUMNS = ("network", "file", "sizes", "99 % within, px", "largest, px", "CPU s", "peak, MB", "file, MB")


def section() -> str:
    """One row an export, each made in a process of its own unless it is kept."""
    records = [_kept(*wanted) for wanted in WANTED]
    told = [f"- {' '.join(_about(record))}: {record['error']}" for record in records if "error" in record]
    table = numbers(COLUMNS, map(_row, records), 3)
    return "\n\n".join((HEAD, table, *(("The command's words:", "\n".join(told)) if told else ())))


def _kept(name: str, form: str, dynamic: bool) -> dict[str, Any]:
    """What the run printed, or that its time was over."""
    words = [name, form, *(["--dynamic"] if dynamic else [])]
    path = KEPT / f"{'_'.join(words)}.json"
    if not path.is_file():
        try:
            found = call("exports.py", *words, "--json")
        except subprocess.CalledProcessError as error:
            if error.returncode != -signal.SIGXCPU:
                raise
            found = {"name": name, "format": form, "dynamic": dynamic, "stopped": MOST_SECONDS}
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(found))
    record: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return record


def _about(record: dict[str, Any]) -> tuple[str, str, str]:
    return record["name"], record["format"], "any" if record["dynamic"] else "one"


def _row(record: dict[str, Any]) -> tuple[str, ...]:
    about = _about(record)
    if "stopped" in record:
        return (*about, "stopped", "", f"> {record['stopped']}", "", "")
    took = (str(record["seconds"]), f"{record['peak_memory_mb']:,}")
    if "error" in record:
        return (*about, "does not export", "", *took, "")
    off = (f"{record[key]:.2g}" for key in ("percentile99", "largest"))
    return (*about, *off, *took, f"{record['file_mb']:.1f}")


if __name__ == "__main__":
    answered(measure)
