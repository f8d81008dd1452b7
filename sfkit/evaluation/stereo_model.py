"""Three lines to a disparity: a network from its file, called with two images.

::

    model = sfkit.load("merged.safetensors")
    disparity = model("left.png", "right.png")     # (H, W) float32, in pixels
    depth = disparity.depth(sfkit.Calibration(focal=721.5, baseline=0.54))
"""

from __future__ import annotations

import itertools
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, overload

import numpy as np
import torch
from numpy.typing import NDArray

from sfkit.datasets.calibration import Calibration
from sfkit.datasets.images import read_image
from sfkit.datasets.videos import StereoVideo, frames
from sfkit.errors import InputError
from sfkit.evaluation.compute import check_device
from sfkit.evaluation.point_cloud import PointCloud, depth_of, point_cloud
from sfkit.evaluation.prediction import predict_together
from sfkit.merging.forward import ForwardMode
from sfkit.merging.network import LoadedNetwork, load_network

Image = NDArray[np.uint8] | str | Path
Images = list[Image] | tuple[Image, ...]
BATCH = 4  # pairs of one size that go through the network together, at most


class Disparity(np.ndarray[tuple[int, int], np.dtype[np.float32]]):
    """A disparity map: an array (H, W) of float32 in pixels of the left image, which knows its depth."""

    def depth(self, calibration: Calibration) -> NDArray[np.float32]:
        """Depth (H, W) in metres; infinite where disparity plus offset is not a finite number above 0.

        Raises:
            InputError: the calibration is of images of another size.
        """
        return depth_of(np.asarray(self), calibration)

    def point_cloud(
        self, left: NDArray[np.uint8] | str | Path, calibration: Calibration, *, farthest: float | None = None
    ) -> PointCloud:
        """Points in metres in front of the left camera, in the colours of the left image; ``.write`` it.

        Args:
            left: the left image, (H, W, 3) RGB uint8, or its file.
            calibration: of images of this size, with the principal point.
            farthest: points behind this depth in metres are left out.

        Raises:
            InputError: the principal point is not known, or image or calibration are of another size.
        """
        return point_cloud(np.asarray(self), _image(left, "left"), calibration, farthest=farthest)


class StereoModel:
    """A network on a device, as a function of two images. Open one with :func:`load`.

    Attributes:
        loaded: the network, how images become its input, and its architecture's name.
        device: where it runs.
    """

    def __init__(self, loaded: LoadedNetwork, device: str = "cpu") -> None:
        self.device = torch.device(device)
        self.loaded = replace(loaded, network=loaded.network.to(self.device))

    @overload
    def __call__(self, left: Image, right: Image) -> Disparity: ...

    @overload
    def __call__(self, left: Images, right: Images) -> list[Disparity]: ...

    def __call__(self, left: Image | Images, right: Image | Images) -> Disparity | list[Disparity]:
        """The disparity of one pair, or of each pair of two lists.

        Args:
            left: (H, W, 3) RGB uint8, a file's name, or a list or tuple of them; pairs of equal size in a
                row go through the network together.
            right: the same of the right camera.

        Raises:
            InputError: an image cannot be read, is no (H, W, 3) uint8, or the two differ in size or number.
        """
        if not isinstance(left, list | tuple):
            return next(self.stream([left], [right]))  # type: ignore[list-item] # checked where it is read
        if not isinstance(right, list | tuple) or len(left) != len(right):
            found = len(right) if isinstance(right, list | tuple) else "one image"
            raise InputError(f"right: found {found}, expected a list of {len(left)} images as left")
        pairs = [(_image(a, "left"), _image(b, "right")) for a, b in zip(left, right, strict=True)]
        # Neighbours of one size alone, so that the order stays.
        groups = itertools.groupby(pairs, key=lambda pair: pair[0].shape)
        return [
            disparity
            for _, group in groups
            for part in _batches(group, BATCH)
            for disparity in self._predict(part)
        ]

    def stream(
        self,
        left: Iterable[Image] | str | Path,
        right: Iterable[Image] | str | Path | None = None,
        *,
        layout: str | None = None,
    ) -> Iterator[Disparity]:
        """Disparities one by one, of frames that come one by one.

        Args:
            left: images, or the name of a video file.
            right: the same of the right camera, frame for frame; None where ``layout`` says where it is.
            layout: of a video of both views, ``"side-by-side"`` or ``"top-bottom"``.

        Raises:
            InputError: as a call, a video cannot be read, one side ends before the other, or a layout meets
                anything but one video.
        """
        for pair in _frames(left, right, layout):
            yield from self._predict([pair])

    def _predict(self, pairs: Sequence[tuple[NDArray[np.uint8], NDArray[np.uint8]]]) -> list[Disparity]:
        return [map_.view(Disparity) for map_ in predict_together(self.loaded, pairs)]

    def __repr__(self) -> str:
        size = sum(parameter.numel() for parameter in self.loaded.network.parameters())
        return f"StereoModel({self.loaded.name}, {size:,} parameters, on {self.device})"


def load(
    path: str | Path,
    *,
    device: str = "cpu",
    precision: str = "float32",
    channels_last: bool = False,
    architecture: str | None = None,
    options: Mapping[str, Any] | None = None,
) -> StereoModel:
    """A network from its file, ready to be called with two images.

    Args:
        path: what sfkit merged, or a checkpoint.
        device: ``"cpu"``, ``"cuda"``, ``"cuda:N"`` or ``"mps"``.
        precision: ``"float32"``, or ``"bfloat16"`` for autocast.
        channels_last: whether images enter with their channels innermost.
        architecture: for a file that does not say it.
        options: the architecture's options; those in the file are the default.

    Raises:
        InputError: as :func:`~sfkit.merging.network.load_network`, there is no such device, or
            no such precision.
    """
    check_device(device)
    mode = ForwardMode(precision, channels_last)
    return StereoModel(replace(load_network(path, name=architecture, options=options), mode=mode), device)


def _frames(
    left: Iterable[Image] | str | Path, right: Iterable[Image] | str | Path | None, layout: str | None
) -> Iterator[tuple[NDArray[np.uint8], NDArray[np.uint8]]]:
    """Both views of each frame, of videos or of whatever yields images."""
    if isinstance(left, str | Path) and (right is None or isinstance(right, str | Path)):
        yield from StereoVideo(Path(left), None if right is None else Path(right), layout).pairs()
        return
    if layout is not None or right is None:
        raise InputError("stream: found images, expected those of the right camera too, and no layout")
    lefts, rights = (frames(side) if isinstance(side, str | Path) else side for side in (left, right))
    # A shorter side must not end the stream in silence.
    for a, b in itertools.zip_longest(lefts, rights):
        if a is None or b is None:
            short = "left" if a is None else "right"
            raise InputError(f"{short}: ends before the other side, expected as many frames")
        yield _image(a, "left"), _image(b, "right")


def _image(image: Image, side: str) -> NDArray[np.uint8]:
    if isinstance(image, str | Path):
        return read_image(Path(image))
    if not isinstance(image, np.ndarray) or image.dtype != np.uint8:
        found = f"{image.dtype} values" if isinstance(image, np.ndarray) else f"a {type(image).__name__}"
        raise InputError(f"{side}: found {found}, expected an RGB image (H, W, 3) of uint8, or a file's name")
    return image


def _batches(
    pairs: Iterable[tuple[NDArray[np.uint8], NDArray[np.uint8]]], size: int
) -> Iterator[list[tuple[NDArray[np.uint8], NDArray[np.uint8]]]]:
    rest = iter(pairs)
    while part := list(itertools.islice(rest, size)):
        yield part
