"""onnxruntime beside PyTorch on the CPU: the real AnyNet, as ``sfkit export --dynamic`` writes it.

CPU seconds of one thread, the shortest of several passes that take turns: on a busy machine only they repeat.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import onnxruntime
import torch
from processes import RESULTS
from processes import sfkit as command
from real_pairs import data
from tabulated import numbers

import sfkit
from sfkit.exporting.export import rendered_pair

DOCUMENT = "benchmarks/README.md"

FILE = RESULTS / "exported" / "anynet.onnx"
SIZES = ((256, 512), (384, 1248))


@dataclass(frozen=True)
class ExportTimes:
    """Both on one height x width pair.

    Attributes:
        torch_ms: CPU milliseconds of a pass by PyTorch, on AnyNet's fast route.
        onnx_ms: the same by onnxruntime.
        largest: the largest difference of their disparities in pixels.
    """

    height: int
    width: int
    torch_ms: float
    onnx_ms: float
    largest: float


def measure(base: Path, file: Path, *, repeats: int = 9) -> list[ExportTimes]:
    """Both at every size, a rendered pair each.

    Args:
        base: the checkpoint the file was exported from.
        file: an ONNX file for all sizes.
        repeats: passes of each.
    """
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(file, options, providers=["CPUExecutionProvider"])
    network = sfkit.load(base, architecture="anynet").loaded
    records = []
    try:
        for height, width in SIZES:
            images = rendered_pair((height, width))
            pair = network.inputs.prepare(*images)
            raw = {
                side: image.transpose(2, 0, 1)[None].astype(np.float32)
                for side, image in zip(("left", "right"), images, strict=True)
            }

            def by_torch(pair=pair) -> np.ndarray:  # type: ignore[no-untyped-def]
                with torch.inference_mode():
                    return network.network(pair.left, pair.right).reshape(pair.left.shape[-2:]).numpy()

            def by_onnx(raw=raw) -> np.ndarray:  # type: ignore[no-untyped-def]
                return np.asarray(session.run(["disparity"], raw)[0][0])

            largest = float(np.abs(by_torch() - by_onnx()).max())
            ours, theirs = _shortest((by_torch, by_onnx), repeats)
            records.append(ExportTimes(height, width, 1e3 * ours, 1e3 * theirs, largest))
    finally:
        torch.set_num_threads(before)
    return records


def _shortest(passes: tuple[Callable[[], object], ...], repeats: int) -> list[float]:
    best = [float("inf")] * len(passes)
    for _ in range(repeats):
        for number, call in enumerate(passes):
            started = time.process_time()
            call()
            best[number] = min(best[number], time.process_time() - started)
    return best


def section() -> str:
    """One row a size; the file is exported unless it lies there."""
    base = data() / "anynet" / "base_sceneflow.tar"
    if not FILE.is_file():
        FILE.parent.mkdir(parents=True, exist_ok=True)
        command("export", str(base), "--architecture", "anynet", "--dynamic", "-o", str(FILE))
    columns = ("height x width", "PyTorch, ms", "onnxruntime, ms", "ratio", "largest difference, px")
    rows = [
        (
            f"{r.height} x {r.width}",
            f"{r.torch_ms:.1f}",
            f"{r.onnx_ms:.1f}",
            f"{r.onnx_ms / r.torch_ms:.2f}",
            f"{r.largest:.4f}",
        )
        for r in measure(base, FILE)
    ]
    return f"""## AnyNet exported: onnxruntime beside PyTorch

The real base with its propagation stage; one ONNX file of `sfkit export --dynamic` for both sizes, rendered
pairs. CPU milliseconds of one thread, the shortest of nine passes that take turns. PyTorch runs the fast
route, and onnxruntime the plain one that an exporter can write, normalisation included.

{numbers(columns, rows)}"""
