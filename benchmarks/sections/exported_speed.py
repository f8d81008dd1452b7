"""onnxruntime beside PyTorch on the CPU: the real AnyNet, as ``sfkit export --dynamic`` writes it.

CPU seconds of one thread, the shortest of several passes that take turns: on a busy machine only they repeat.
"""

from __future__ import annotations

import time
from collections.abc import Callable
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


def measure(base: Path, file: Path, repeats: int = 9) -> list[tuple[str, ...]]:
    """A row a size, on a rendered pair: passes by PyTorch and onnxruntime, and how far apart their maps are.

    Args:
        base: the checkpoint the file was exported from.
        file: an ONNX file for all sizes.
        repeats: passes of each.
    """
    torch.set_num_threads(1)
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    session = onnxruntime.InferenceSession(file, options, providers=["CPUExecutionProvider"])
    network = sfkit.load(base, architecture="anynet").loaded
    rows = []
    for size in SIZES:
        images = rendered_pair(size)
        pair = network.inputs.prepare(*images)
        left, right = (image.transpose(2, 0, 1)[None].astype(np.float32) for image in images)
        given = {"left": left, "right": right}
        maps: dict[str, np.ndarray] = {}

        def by_torch(pair=pair, maps=maps) -> None:  # type: ignore[no-untyped-def]
            with torch.inference_mode():
                found = network.network(pair.left, pair.right)
                maps["torch"] = found.reshape(pair.left.shape[-2:]).numpy()

        def by_onnx(given=given, maps=maps) -> None:  # type: ignore[no-untyped-def]
            maps["onnx"] = np.asarray(session.run(["disparity"], given)[0][0])

        ours, theirs = _shortest((by_torch, by_onnx), repeats)
        largest = float(np.abs(maps["torch"] - maps["onnx"]).max())
        times = (f"{1e3 * ours:.1f}", f"{1e3 * theirs:.1f}", f"{theirs / ours:.2f}")
        rows.append(("{} x {}".format(*size), *times, f"{largest:.4f}"))
    return rows


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
    return f"""## AnyNet exported: onnxruntime beside PyTorch

The real base with its propagation stage; one ONNX file of `sfkit export --dynamic` for both sizes, rendered
pairs. CPU milliseconds of one thread, the shortest of nine passes that take turns. PyTorch runs the fast
route, and onnxruntime the plain one that an exporter can write, normalisation included.

{numbers(columns, measure(base, FILE))}"""
