"""A merged network as a file that runs without sfkit, checked against the network before it is written."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sfkit.architectures.inputs import PreparedPair
from sfkit.checkpoints.fingerprints import fingerprint, tensor_digest
from sfkit.checkpoints.reading import read_checkpoint
from sfkit.checkpoints.targets import FileForm
from sfkit.checkpoints.writing import write_checkpoint
from sfkit.datasets.synthetic import domains, synthetic_pair
from sfkit.errors import InputError, SfkitError, SfkitWarning, member_of
from sfkit.evaluation.prediction import predict
from sfkit.exporting import formats
from sfkit.exporting.deployed import DeployedNetwork, Sizes
from sfkit.exporting.forms import (
    SEEN,
    Form,
    called,
    check_dynamic,
    check_export,
    check_size,
    kind_of,
    untried,
)
from sfkit.files import write_bytes
from sfkit.merging.network import LoadedNetwork, load_network
from sfkit.merging.origin import stated_metadata
from sfkit.merging.saving import write_beside

Pair = tuple[NDArray[np.uint8], NDArray[np.uint8]]
SIZE = (384, 1248)  # KITTI's images, padded
TOLERANCE = 1e-3
"""Pixels: what rounding may move the 99th percentile."""


MAKERS: dict[
    Form,
    Callable[[DeployedNetwork, Sizes, torch.Tensor, torch.Tensor, formats.Tell], formats.ExportedNetwork],
] = {
    Form.ONNX: formats.onnx,
    Form.TORCH: formats.torch_export,
    Form.TORCHSCRIPT: formats.torchscript,
}


@dataclass(frozen=True)
class Exported:
    """What was written, and how far its disparities are from the network's on one pair.

    Attributes:
        path: the file.
        form: its kind.
        size: (height, width) of the images it takes; None for any that ``multiple`` divides.
        multiple: see ``size``.
        pair: (height, width) of the pair both were run on.
        largest: the largest difference in pixels.
        percentile99: the 99th percentile of the differences in pixels.
        mean: their mean in pixels.
    """

    path: Path
    form: Form
    size: tuple[int, int] | None
    multiple: int
    pair: tuple[int, int]
    largest: float
    percentile99: float
    mean: float

    @property
    def agrees(self) -> bool:
        """Whether 99 % of the pixels are within 1e-3 px of the network's."""
        return self.percentile99 <= TOLERANCE


def export_network(
    path: str | Path,
    out: str | Path,
    *,
    form: Form | str = Form.ONNX,
    size: tuple[int, int] | None = None,
    dynamic: bool = False,
    pair: Pair | None = None,
    architecture: str | None = None,
    options: Mapping[str, Any] | None = None,
    overwrite: bool = False,
    progress: Callable[[str], None] | None = None,
) -> Exported:
    """Export a network, run the result beside it on a pair, and write it with its recipe and licences.

    The file takes RGB images of 0 .. 255 and normalises them itself. Images of a fixed size it pads and crops
    too; with ``dynamic`` height and width must be multiples of what the architecture asks for, and its
    metadata ``sfkit.export`` say how to pad. ``pth`` is a checkpoint instead: tensors under the names that
    the base's training code reads.

    Args:
        path: what sfkit merged, or a checkpoint.
        out: the file to write.
        form: ``onnx``, ``torch`` (for ``torch.export.load``), ``torchscript`` or ``pth``.
        size: (height, width) of the images, by default that of ``pair``, else 384 x 1248.
        dynamic: whether the file takes any size.
        pair: (H, W, 3) RGB uint8 images to check the file on; a rendered pair unless given.
        architecture: for a file that does not say it.
        options: the architecture's options; those in the file are the default.
        overwrite: whether an existing file may be replaced.
        progress: told what is done next, one line each.

    Warns (:class:`~sfkit.errors.SfkitWarning`) before what nobody has seen to its end (:func:`untried`).

    Raises:
        InputError: an argument does not fit, or the network cannot be loaded.
        SfkitError: the network does not export to this format.
    """
    path, form = Path(path), member_of(Form, "format", form)
    out = check_export(out, form, overwrite=overwrite)
    if dynamic:
        check_dynamic(form, size)
    check_size(size, pair)
    loaded = load_network(path, name=architecture, options=options)
    kind = kind_of(loaded)
    if (reason := SEEN.get(kind, {}).get((form, dynamic))) is not None:
        raise InputError(f"{path}: {kind} does not export to {called(form, dynamic=dynamic)}: {reason}")
    if (what := untried(kind, form, dynamic=dynamic)) is not None:
        warnings.warn(
            f"{what} was never run to its end with {kind}: it may take long or fail; the check on the "
            "pair decides",
            SfkitWarning,
            stacklevel=2,
        )
    tell = progress or (lambda _line: None)
    pair = pair or rendered_pair(size or SIZE)
    seen = (pair[0].shape[0], pair[0].shape[1])
    sizes = Sizes(None if dynamic else seen, loaded.inputs.multiple)
    tell(f"running the network on a pair of {seen[0]}x{seen[1]}")
    expected = predict(loaded, *pair)
    if form is Form.PTH:
        _write_checkpoint(path, out, overwrite=overwrite)
        found = predict(load_network(out, name=loaded.name, options=options or _stated_options(path)), *pair)
        return _compared(out, form, sizes, found, expected)
    network = DeployedNetwork(loaded.network, loaded.inputs, sizes).eval()
    example = sizes.fed(*rendered_pair(_example_size(sizes, seen)), loaded.inputs)
    made = MAKERS[form](network, sizes, example.left, example.right, tell)
    tell("running the file beside the network")
    fed = sizes.fed(*pair, loaded.inputs)
    exported = _compared(out, form, sizes, fed.window.crop(_run(made, fed, kind))[0], expected)
    write_bytes(out, made.content(_metadata(path, loaded, exported)))
    return exported


def _run(made: formats.ExportedNetwork, fed: PreparedPair, kind: str) -> NDArray[np.float32]:
    """What the file returns of a pair.

    Raises:
        SfkitError: it does not run at this size, as one of any size may that holds on to that of its making.
    """
    try:
        return made.run(fed.left, fed.right)
    except Exception as error:  # whatever runs the file raises
        reason = next((line for line in str(error).splitlines() if line.strip()), "no reason given")
        height, width = fed.left.shape[-2:]
        raise SfkitError(
            f"the exported {kind} does not run on images of {height}x{width} ({type(error).__name__}: "
            f"{reason}); nothing was written: export it for one size, or to another format"
        ) from error


def rendered_pair(size: tuple[int, int]) -> Pair:
    """A synthetic pair of (height, width), to run a network on where no real one is at hand.

    Raises:
        InputError: a size below 16 pixels, or of more than 2**26 pixels.
    """
    check_size(size)
    height, width = size
    rendered = synthetic_pair(next(iter(domains().values())), 0, split="held-out", height=height, width=width)
    return rendered.left, rendered.right


def _example_size(sizes: Sizes, seen: tuple[int, int]) -> tuple[int, int]:
    """What the exporter sees: a dynamic file is made at another size than it is checked at."""
    if sizes.fixed is not None:
        return sizes.fixed
    height, width = (sizes.multiple * max(2, -(-n // sizes.multiple)) for n in (128, 256))
    return (height, width) if (height, width) != seen else (height, width + sizes.multiple)


def _compared(
    out: Path, form: Form, sizes: Sizes, found: NDArray[np.float32], expected: NDArray[np.float32]
) -> Exported:
    difference = np.abs(found.astype(np.float64) - expected)
    return Exported(
        path=out,
        form=form,
        size=sizes.fixed,
        multiple=sizes.multiple,
        pair=(expected.shape[0], expected.shape[1]),
        largest=float(difference.max()),
        percentile99=float(np.percentile(difference, 99)),
        mean=float(difference.mean()),
    )


def _metadata(path: Path, loaded: LoadedNetwork, exported: Exported) -> dict[str, str]:
    """Recipe, origin and licences as the merged file has them; the network's identity; what was exported."""
    inputs = loaded.inputs.describe()
    described = {
        "format": exported.form.value,
        "inputs": "left, right: RGB images (1, 3, height, width) of 0 .. 255, float32",
        "output": "disparity of the left image (1, height, width) in pixels, float32",
        "normalised_inside": {key: inputs[key] for key in ("scale", "mean", "std")},
        "size": exported.size or f"height and width are multiples of {exported.multiple}",
        "padding": "inside"
        if exported.size
        else f"by the caller: edge values at {loaded.inputs.sides.value}",
        "checked": {key: value for key, value in asdict(exported).items() if key in _CHECKED},
        "torch": torch.__version__,
    }
    network = {"architecture": loaded.name, "fingerprint": _fingerprint(path), "file": path.name}
    own = {"sfkit.export": json.dumps(described), "sfkit.network": json.dumps(network)}
    return {**(stated_metadata(path) or {}), **own}


_CHECKED = ("pair", "largest", "percentile99", "mean")


def _fingerprint(path: Path) -> str:
    return fingerprint({key: tensor_digest(t) for key, t in read_checkpoint(path).tensors.items()})


def _write_checkpoint(path: Path, out: Path, *, overwrite: bool) -> None:
    file, metadata = read_checkpoint(path), stated_metadata(path) or {}
    form = FileForm.ORIGINAL
    write_beside(out, file.layout, metadata, state=file.tensors, overwrite=overwrite)
    write_checkpoint(out, file.tensors, layout=file.layout, metadata=metadata, form=form, overwrite=overwrite)


def _stated_options(path: Path) -> Mapping[str, Any] | None:
    stated = stated_metadata(path)
    return None if stated is None else json.loads(stated["sfkit.architecture"])["options"]
