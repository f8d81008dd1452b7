"""One network merged and exported, checked beside itself on a real pair or a part of one.

    SFKIT_REAL_DATA=~/real python benchmarks/exports.py nmrf-swint onnx --json
    SFKIT_REAL_DATA=~/real python benchmarks/exports.py anynet torch --dynamic

AnyNet is four real checkpoints merged. Published weights of the others are not at hand: the base is filled by
the rules that the golden arrays were made with, and each source is the base with every value moved by 1 %.
All layers take part. CPU seconds
are those of this process, with one thread; measure one export a process, for its peak memory. It is ended
after 15 CPU minutes, and what asks for more than 18 GiB fails.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import sys
import tempfile
import time
import warnings
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import torch

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "architectures"))
sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
from foundation_stereo_reference import filled_state
from nmrf_fill import fill

import sfkit
from sfkit.architectures import architecture
from sfkit.datasets.images import read_image
from sfkit.errors import SfkitError
from sfkit.evaluation.estimating import peak_memory
from sfkit.exporting.forms import ENDINGS, Form

REAL = "SFKIT_REAL_DATA"
MOVED = 0.01  # of each value, by which a source differs from the base
MOST_SECONDS = 900  # of CPU: what runs longer is ended by SIGXCPU
MOST_MEMORY = 18 << 30  # bytes: what asks for more fails


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


# The rows of the table of results: network, format, whether of any size.
WANTED = (
    *(
        (name, form, False)
        for name in ("anynet", "nmrf-res", "nmrf-swint", "foundation-stereo-s")
        for form in ("onnx", "torch", "torchscript")
    ),
    ("foundation-stereo-l", "torch", False),
    ("foundation-stereo-l", "torchscript", False),
    ("anynet", "onnx", True),
    ("anynet", "torch", True),
    ("nmrf-res", "onnx", True),
)


def measure(name: str, form: Form, dynamic: bool, real: Path) -> dict[str, Any]:
    """Merge, export, compare.

    Args:
        name: one of :data:`CASES`.
        form: what to export to.
        dynamic: whether to any size.
        real: the folder of real pairs.

    Returns:
        ``seconds`` of CPU, ``peak_memory_mb``, and either ``error`` or ``file_mb``, ``percentile99``,
        ``largest`` and ``mean`` in pixels.
    """
    torch.set_num_threads(1)
    case = CASES[name]
    left, right = (read_image(real / "pairs" / file) for file in case.images)
    if case.size is not None:
        tall, wide = case.size
        left, right = (image[100 : 100 + tall, 60 : 60 + wide] for image in (left, right))
    with tempfile.TemporaryDirectory() as folder:
        merged = _merged_anynets(Path(folder)) if case.kind == "anynet" else _merged(Path(folder), case)
        out = Path(folder) / f"out{ENDINGS[form][0]}"
        said: dict[str, Any]
        started = time.process_time()
        try:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                found = sfkit.export_network(merged, out, form=form, dynamic=dynamic, pair=(left, right))
            said = {key: getattr(found, key) for key in ("percentile99", "largest", "mean")}
            said["file_mb"] = round(out.stat().st_size / 1e6, 1)
        except SfkitError as error:
            said = {"error": str(error)}
        seconds = round(time.process_time() - started)
    about = {"name": name, "format": form.value, "dynamic": dynamic, "size": list(left.shape[:2])}
    return {**about, "seconds": seconds, "peak_memory_mb": round(peak_memory() / (1 << 20)), **said}


def _merged_anynets(folder: Path) -> Path:
    pool = sfkit.open_pool(Path(__file__).parents[1] / "tests" / "pools" / "anynet_real.toml")
    return sfkit.save_merged(pool, pool.uniform(), folder / "merged.safetensors")


def _merged(folder: Path, case: ExportCase) -> Path:
    """Base and two sources in files, and all of them mixed equally."""
    base = _filled(case)
    torch.save(base, folder / "base.pth")
    for number, name in enumerate("ab"):
        moved = {key: _moved(key, tensor, number) for key, tensor in base.items()}
        torch.save(moved, folder / f"{name}.pth")
    said = "".join(f"{key} = {json.dumps(value)}\n" for key, value in case.options.items())
    sources = "".join(f'[sources.{name}]\nfile = "{name}.pth"\n' for name in "ab")
    text = (
        f'name = "pool"\narchitecture = "{case.kind}"\n[options]\n{said}[base]\nfile = "base.pth"\n{sources}'
    )
    (folder / "pool.toml").write_text(text, encoding="utf-8")
    pool = sfkit.open_pool(folder / "pool.toml")
    return sfkit.save_merged(pool, pool.uniform(), folder / "merged.safetensors")


def _moved(key: str, tensor: torch.Tensor, number: int) -> torch.Tensor:
    """Every value by about 1 %; what two keys name is one tensor, and moves as one."""
    if not tensor.is_floating_point() or not tensor.numel() or key.endswith((".mean", ".std")):
        return tensor
    drawn = torch.Generator().manual_seed(zlib.crc32(tensor.numpy().tobytes(), number))
    return tensor * (1 + MOVED * torch.randn(tensor.shape, generator=drawn))


def _filled(case: ExportCase) -> dict[str, torch.Tensor]:
    if case.kind == "foundation-stereo":
        return filled_state(str(case.options["vit_size"]))
    network = architecture(case.kind).build()
    fill(network, "A")
    return {key: tensor.clone() for key, tensor in network.state_dict().items()}


def main() -> None:
    """Measure what the command line names, and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("name", choices=CASES)
    parser.add_argument("form", choices=[form.value for form in Form])
    parser.add_argument("--dynamic", action="store_true", help="one file for all sizes")
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    options = parser.parse_args()
    if not os.environ.get(REAL):
        raise SystemExit(f"{REAL}: not set, expected the folder's path")
    real = Path(os.environ[REAL]).expanduser()
    resource.setrlimit(resource.RLIMIT_CPU, (MOST_SECONDS, MOST_SECONDS + 60))
    resource.setrlimit(resource.RLIMIT_DATA, (MOST_MEMORY, MOST_MEMORY))
    result = measure(options.name, Form(options.form), options.dynamic, real)
    lines = "\n".join(f"{key}: {value}" for key, value in result.items())
    print(json.dumps(result) if options.json else lines)


if __name__ == "__main__":
    main()
