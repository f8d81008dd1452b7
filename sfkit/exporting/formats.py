"""One function a format: a deployed network -> the file's bytes, and a way to run them as their user will."""

from __future__ import annotations

import importlib.util
import io
import json
import logging
import warnings
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sfkit.architectures.portable import portable
from sfkit.errors import InputError, SfkitError
from sfkit.exporting.deployed import DeployedNetwork, Sizes

Run = Callable[[torch.Tensor, torch.Tensor], NDArray[np.float32]]
Tell = Callable[[str], None]
NAMES = ("left", "right")
METADATA = "sfkit.json"
"""The extra file inside what torch writes that holds the metadata."""
TRACING = "tracing the network: its loops are unrolled, a large one takes minutes"


@dataclass(frozen=True)
class ExportedNetwork:
    """An exported network that is not written yet.

    Attributes:
        run: left and right image (1, 3, H, W) -> disparity (1, H, W), by what will run the file.
        content: metadata -> the file's bytes.
    """

    run: Run
    content: Callable[[Mapping[str, str]], bytes]


def onnx(
    network: DeployedNetwork, sizes: Sizes, left: torch.Tensor, right: torch.Tensor, tell: Tell
) -> ExportedNetwork:
    """By PyTorch's dynamo exporter; run by onnxruntime.

    Raises:
        InputError: the packages are not installed.
        SfkitError: the network does not export.
    """
    missing = [n for n in ("onnx", "onnxscript", "onnxruntime") if importlib.util.find_spec(n) is None]
    if missing:
        raise InputError(
            f"ONNX needs {', '.join(missing)}, expected them installed: pip install 'sfkit[export]'"
        )
    import onnxruntime

    with _exporting("ONNX"):
        tell(TRACING)
        program = torch.onnx.export(
            network,
            (left, right),
            dynamo=True,
            verbose=False,
            input_names=list(NAMES),
            output_names=["disparity"],
            dynamic_shapes=sizes.dynamic_shapes(),
        )
        if program is None:  # never with dynamo=True; its type says so
            raise SfkitError("ONNX: the exporter returned nothing")
        model = program.model_proto
    session = onnxruntime.InferenceSession(model.SerializeToString(), providers=["CPUExecutionProvider"])

    def run(left: torch.Tensor, right: torch.Tensor) -> NDArray[np.float32]:
        output: NDArray[np.float32] = session.run(None, {"left": left.numpy(), "right": right.numpy()})[0]
        return output

    def content(metadata: Mapping[str, str]) -> bytes:
        for key, value in metadata.items():
            model.metadata_props.add(key=key, value=value)
        written: bytes = model.SerializeToString()
        return written

    return ExportedNetwork(run, content)


def torch_export(
    network: DeployedNetwork, sizes: Sizes, left: torch.Tensor, right: torch.Tensor, tell: Tell
) -> ExportedNetwork:
    """A program of ``torch.export``, which ``torch.export.load`` opens without sfkit.

    Raises:
        SfkitError: the network does not export.
    """
    with _exporting("torch.export"):
        tell(TRACING)
        program = torch.export.export(
            network, (left, right), dynamic_shapes=sizes.dynamic_shapes(), strict=False
        )
    module = program.module()

    # Written once the check is made, whose findings are part of the file.
    def content(metadata: Mapping[str, str]) -> bytes:
        buffer = io.BytesIO()
        with _quiet():
            torch.export.save(program, buffer, extra_files={METADATA: json.dumps(dict(metadata))})
        return buffer.getvalue()

    return ExportedNetwork(_of_module(module), content)


def torchscript(
    network: DeployedNetwork, sizes: Sizes, left: torch.Tensor, right: torch.Tensor, tell: Tell
) -> ExportedNetwork:
    """A trace for ``torch.jit.load``, of one size.

    Raises:
        SfkitError: the network does not export.
    """
    with _exporting("TorchScript"):
        tell(TRACING)
        # No check by a second trace: the file is run beside the network.
        module = torch.jit.trace(network, (left, right), check_trace=False)  # type: ignore[no-untyped-call]

    def content(metadata: Mapping[str, str]) -> bytes:
        buffer = io.BytesIO()
        with _quiet():
            torch.jit.save(module, buffer, _extra_files={METADATA: json.dumps(dict(metadata))})
        return buffer.getvalue()

    return ExportedNetwork(_of_module(module), content)


def _of_module(module: Any) -> Run:
    @torch.no_grad()
    def run(left: torch.Tensor, right: torch.Tensor) -> NDArray[np.float32]:
        with _quiet():
            output: NDArray[np.float32] = module(left, right).numpy()
        return output

    return run


@contextmanager
def _exporting(what: str) -> Iterator[None]:
    """Let the network compute by plain operations, and say in one sentence where an exporter gives up."""
    try:
        with _quiet(), portable(), torch.no_grad():
            yield
    except SfkitError:
        raise
    except Exception as error:  # exporters raise whatever a network's code or their own makes them
        reason = next((line for line in str(error).splitlines() if line.strip()), "no reason given")
        raise SfkitError(
            f"{what}: this network does not export ({type(error).__name__}: {reason}); try another format"
        ) from error


_TALKATIVE = (
    "torch.__trace",  # dumps every graph where any handler listens
    "torch.onnx._internal.exporter._registration",
    "torch._export.serde.serialize",
)


@contextmanager
def _quiet() -> Iterator[None]:
    """Without what exporters say about their own code: none of it is about the network."""
    logs = [logging.getLogger(name) for name in _TALKATIVE]
    levels = [log.level for log in logs]
    for log in logs:
        log.setLevel(logging.ERROR)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            yield
    finally:
        for log, level in zip(logs, levels, strict=True):
            log.setLevel(level)
