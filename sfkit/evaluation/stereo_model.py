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

import cv2
import numpy as np
import torch
from numpy.typing import NDArray

from sfkit.datasets.calibration import Calibration
from sfkit.datasets.images import read_image
from sfkit.errors import InputError
from sfkit.evaluation.compute import check_device
from sfkit.evaluation.prediction import depth_of
from sfkit.merging.network import LoadedNetwork, load_network

Image = NDArray[np.uint8] | str | Path
Images = list[Image] | tuple[Image, ...]
BATCH = 4  # pairs of one size that go through the network together, at most


class Disparity(np.ndarray[tuple[int, int], np.dtype[np.float32]]):
    """A disparity map: an array (H, W) of float32 in pixels of the left image, which knows its depth."""

    def depth(self, calibration: Calibration) -> NDArray[np.float32]:
        """Depth (H, W) in metres; infinite where disparity plus offset is not positive."""
        return depth_of(np.asarray(self), calibration)


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
        groups = itertools.groupby(pairs, key=lambda pair: pair[0].shape)
        return [
            disparity
            for _, group in groups
            for part in _batches(group, BATCH)
            for disparity in self._predict(part)
        ]

    def stream(
        self, left: Iterable[Image] | str | Path, right: Iterable[Image] | str | Path
    ) -> Iterator[Disparity]:
        """Disparities one by one, of frames that come one by one.

        Args:
            left: images, or the name of a video file.
            right: the same of the right camera, frame for frame.

        Raises:
            InputError: as a call, a video cannot be read, or one side ends before the other.
        """
        lefts, rights = (frames(s) if isinstance(s, str | Path) else s for s in (left, right))
        for a, b in itertools.zip_longest(lefts, rights):
            if a is None or b is None:
                raise InputError(
                    f"{'left' if a is None else 'right'}: ends before the other side, expected as many frames"
                )
            yield from self._predict([(_image(a, "left"), _image(b, "right"))])

    @torch.inference_mode()
    def _predict(self, pairs: Sequence[tuple[NDArray[np.uint8], NDArray[np.uint8]]]) -> list[Disparity]:
        prepared = [self.loaded.inputs.prepare(left, right) for left, right in pairs]
        left, right = (
            torch.cat([getattr(pair, side) for pair in prepared]).to(self.device)
            for side in ("left", "right")
        )
        output = self.loaded.network(left, right)
        maps = output.reshape(len(pairs), *output.shape[-2:]).float().cpu()
        return [
            pair.window.crop(map_).numpy().copy().view(Disparity)
            for pair, map_ in zip(prepared, maps, strict=True)
        ]

    def __repr__(self) -> str:
        size = sum(parameter.numel() for parameter in self.loaded.network.parameters())
        return f"StereoModel({self.loaded.name}, {size:,} parameters, on {self.device})"


def load(
    path: str | Path,
    *,
    device: str = "cpu",
    architecture: str | None = None,
    options: Mapping[str, Any] | None = None,
) -> StereoModel:
    """A network from its file, ready to be called with two images.

    Args:
        path: what sfkit merged, or a checkpoint.
        device: ``"cpu"``, ``"cuda"``, ``"cuda:N"`` or ``"mps"``.
        architecture: for a file that does not say it.
        options: the architecture's options; those in the file are the default.

    Raises:
        InputError: as :func:`~sfkit.merging.network.load_network`, or there is no such device.
    """
    check_device(device)
    return StereoModel(load_network(path, name=architecture, options=options), device)


def frames(path: str | Path) -> Iterator[NDArray[np.uint8]]:
    """The frames of a video file, each (H, W, 3) RGB uint8.

    Raises:
        InputError: there is no such file, or it cannot be read as a video.
    """
    if not Path(path).is_file():
        raise InputError(f"{path}: no such file, expected a video")
    video = cv2.VideoCapture(str(path))
    try:
        whole, frame = video.read()
        if not whole:
            raise InputError(
                f"{path}: cannot be read as a video, expected one that OpenCV reads, or its frames"
            )
        while whole:
            yield cv2.cvtColor(frame, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)
            whole, frame = video.read()
    finally:
        video.release()


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
