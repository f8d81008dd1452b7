"""What a network can be exported to, and what of it was run to its end with the large ones."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING

from sfkit.checkpoints.headers import WRITTEN_SUFFIXES
from sfkit.checkpoints.targets import check_file
from sfkit.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from sfkit.merging.network import LoadedNetwork


class Form(StrEnum):
    """What an exported network becomes."""

    ONNX = "onnx"
    TORCH = "torch"  # torch.export
    TORCHSCRIPT = "torchscript"
    PTH = "pth"  # the layout of the base's checkpoint


ENDINGS = {
    Form.ONNX: (".onnx",),
    Form.TORCH: (".pt2",),
    Form.TORCHSCRIPT: (".pt", ".ts"),
    Form.PTH: WRITTEN_SUFFIXES,
}
_MOST = 2**26  # pixels of an image: more than any camera of a pair has
_RESIZES = (
    "its monocular branch resizes every image by a factor that the file would keep from the size it was made "
    "at; give a size"
)
_WINDOWS = (
    "whether its windows are padded depends on the size of the images, and the file would keep what was "
    "right at the size it was made at; give a size"
)
_NMRF: dict[tuple[Form, bool], str | None] = {
    (Form.ONNX, False): None,
    (Form.TORCH, False): None,
    (Form.TORCHSCRIPT, False): None,
    (Form.TORCH, True): _WINDOWS,
}
# Of the large networks that come with sfkit: format, and whether of any size -> why not, None where it holds.
# What stands here was run whole (docs/how_to/export.md), or its part that does not export was.
SEEN: dict[str, dict[tuple[Form, bool], str | None]] = {
    "foundation-stereo vits": {
        (Form.ONNX, False): None,
        (Form.TORCH, False): None,
        (Form.TORCHSCRIPT, False): None,
        (Form.ONNX, True): _RESIZES,
        (Form.TORCH, True): _RESIZES,
    },
    "foundation-stereo vitb": {(Form.ONNX, True): _RESIZES, (Form.TORCH, True): _RESIZES},
    "foundation-stereo vitl": {
        (Form.TORCH, False): None,
        (Form.TORCHSCRIPT, False): None,
        (Form.ONNX, True): _RESIZES,
        (Form.TORCH, True): _RESIZES,
    },
    "nmrf-res": {**_NMRF, (Form.ONNX, True): None},
    "nmrf-swint": _NMRF,
}


def called(form: Form, *, dynamic: bool) -> str:
    """A request as the command line says it."""
    return f"{form.value}{' with --dynamic' if dynamic else ''}"


def check_export(out: str | Path, form: Form, *, overwrite: bool) -> Path:
    """Refuse a target before any work is done for it.

    Raises:
        InputError: as :func:`sfkit.checkpoints.targets.check_file`.
    """
    return check_file(Path(out), f"format {form.value!r}", ENDINGS[form], overwrite=overwrite)


def check_dynamic(form: Form, size: tuple[int, int] | None) -> None:
    """Refuse what cannot take images of any size.

    Raises:
        InputError: a size was given too, or the format holds one.
    """
    if size is not None:
        raise InputError("size: found a size beside dynamic, expected one of the two")
    if form is Form.TORCHSCRIPT:
        raise InputError(
            "TorchScript: a trace holds one size, found dynamic sizes; give a size, or another format"
        )


def check_size(size: tuple[int, int] | None, pair: tuple[NDArray[np.uint8], ...] | None = None) -> None:
    """Refuse a (height, width) that no image has, or that is not that of ``pair``; None says nothing.

    Raises:
        InputError: what was found, and the limits.
    """
    if size is None:
        return
    height, width = size
    if pair is not None and pair[0].shape[:2] != tuple(size):
        high, wide = pair[0].shape[:2]
        raise InputError(f"size: found {height}x{width} and a pair of {high}x{wide}, expected the same")
    if min(size) < 16:
        raise InputError(f"size: found {height}x{width}, expected at least 16 pixels")
    if height * width > _MOST:
        raise InputError(f"size: found {height}x{width}, expected at most {_MOST:,} pixels, as 8192x8192 has")


def kind_of(loaded: LoadedNetwork) -> str:
    """The architecture and, where it comes in sizes, which."""
    return " ".join((loaded.name, *(loaded.options[key] for key in ("vit_size",) if key in loaded.options)))


def untried(kind: str, form: Form, *, dynamic: bool) -> str | None:
    """What of a request nobody has seen to its end with a network of :data:`SEEN`; None where it is known.

    Exporters take minutes for the large networks that come with sfkit; what was measured is in
    ``docs/how_to/export.md``.
    """
    if form is Form.PTH or kind not in SEEN or (form, dynamic) in SEEN[kind]:
        return None
    return f"export to {called(form, dynamic=dynamic)}"
