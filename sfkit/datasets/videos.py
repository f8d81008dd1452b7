"""Stereo video: two files frame for frame, or one whose frames hold both views."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from sfkit.errors import InputError, unknown_name
from sfkit.files import fresh_beside, trouble

Image = NDArray[np.uint8]
Pair = tuple[Image, Image]

VIDEO_SUFFIXES = (".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpeg", ".mpg", ".webm", ".wmv")
LAYOUTS = ("side-by-side", "top-bottom")
"""Where the two views are in one frame: the left one is the left half, or the upper."""


@dataclass(frozen=True)
class StereoVideo:
    """A pair of video files, or one file of both views.

    Attributes:
        left: the file of the left camera, or of both.
        right: the file of the right camera; None where ``layout`` says where its view is.
        layout: one of ``LAYOUTS``; None for two files.

    Raises:
        InputError: an unknown layout, one beside two files, or neither.
    """

    left: Path
    right: Path | None = None
    layout: str | None = None

    def __post_init__(self) -> None:
        if self.layout is not None and self.layout not in LAYOUTS:
            raise unknown_name("layout", self.layout, LAYOUTS)
        if (self.right is None) == (self.layout is None):
            found = "no right video" if self.right is None else f"two videos and the layout {self.layout!r}"
            raise InputError(
                f"{self.left}: found {found}, expected a right video or a layout ({', '.join(LAYOUTS)})"
            )

    def pairs(self) -> Iterator[Pair]:
        """Left and right view of each frame, (H, W, 3) RGB uint8.

        Raises:
            InputError: a file cannot be read as a video, the views differ in size, a frame cannot be halved,
                or one file ends before the other.
        """
        if self.right is None:
            yield from map(self._halves, frames(self.left))
            return
        # Both to their ends: a shorter side must not end the other in silence.
        for left, right in itertools.zip_longest(frames(self.left), frames(self.right)):
            if left is None or right is None:
                short, long = (self.left, self.right) if left is None else (self.right, self.left)
                raise InputError(f"{short}: ends before {long}, expected as many frames")
            if left.shape != right.shape:
                raise InputError(
                    f"{self.right}: has {right.shape[1]}x{right.shape[0]} pixels, expected "
                    f"{left.shape[1]}x{left.shape[0]} as in {self.left}"
                )
            yield left, right

    def _halves(self, frame: Image) -> Pair:
        axis = 1 if self.layout == "side-by-side" else 0
        if frame.shape[axis] % 2:
            raise InputError(
                f"{self.left}: has {frame.shape[1]}x{frame.shape[0]} pixels, expected an even "
                f"{'width' if axis else 'height'} to halve ({self.layout})"
            )
        first, second = np.split(frame, 2, axis=axis)
        # Copies: half a frame is no block of memory.
        return np.ascontiguousarray(first), np.ascontiguousarray(second)

    @property
    def length(self) -> int | None:
        """Frames that the files announce, the fewer of two; None where they do not say."""
        counts = [_property(path, cv2.CAP_PROP_FRAME_COUNT) for path in (self.left, self.right) if path]
        # OpenCV answers 0 or less where it cannot tell.
        return int(min(counts)) if min(counts) >= 1 else None

    @property
    def rate(self) -> float:
        """Frames a second; 25 where the file does not say."""
        return _property(self.left, cv2.CAP_PROP_FPS) or 25.0


def frames(path: str | Path) -> Iterator[Image]:
    """The frames of a video file, each (H, W, 3) RGB uint8.

    Raises:
        InputError: there is no such file, or it cannot be read as a video.
    """
    with _opened(Path(path)) as video:
        whole, frame = video.read()
        if not whole:
            raise InputError(
                f"{path}: cannot be read as a video, expected one that OpenCV reads, or its frames"
            )
        while whole:
            yield cv2.cvtColor(frame, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)
            whole, frame = video.read()


@contextmanager
def _opened(path: Path) -> Iterator[cv2.VideoCapture]:
    if why := trouble(path):
        raise InputError(f"{path}: cannot be read ({why}), expected a video")
    _ensure_text(path, "read")
    video = cv2.VideoCapture(str(path))
    try:
        yield video
    finally:
        video.release()


def _ensure_text(path: Path, do: str) -> None:
    try:
        str(path).encode()
    except UnicodeEncodeError as error:  # OpenCV ends the process at such a name
        raise InputError(f"{path}: has a name that is no text, expected another to {do} a video") from error


def _property(path: Path, which: int) -> float:
    with _opened(path) as video:
        value = float(video.get(which))
    return value if np.isfinite(value) and value > 0 else 0.0


@contextmanager
def writing_video(path: Path, rate: float) -> Iterator[Callable[[Image], None]]:
    """Gives what appends a frame (H, W, 3), RGB uint8, to a new MP4; all have the size of the first.

    Odd sides grow by their last row or column, as the format has none. The file takes its name when the
    block ends, however it ends, with the frames it got by then.

    Args:
        path: the file; its folder is made.
        rate: frames a second.

    Raises:
        InputError: the name is no text, OpenCV cannot write frames of that size, one has another size, or not
            all of them came to the disk.
    """
    _ensure_text(path, "write")
    with fresh_beside(path) as fresh:
        file = fresh.with_name(f"{fresh.name}.mp4")  # OpenCV takes the container from the ending
        writer: cv2.VideoWriter | None = None
        first, count = (0, 0), 0

        def append(picture: Image) -> None:
            nonlocal writer, first, count
            size = (picture.shape[1], picture.shape[0])
            if writer is None:
                even_size = (size[0] + size[0] % 2, size[1] + size[1] % 2)
                made = cv2.VideoWriter(str(file), cv2.VideoWriter.fourcc(*"mp4v"), rate, even_size)
                if not made.isOpened():
                    raise InputError(f"{path}: OpenCV cannot write an MP4 of {size[0]}x{size[1]} pixels here")
                writer, first = made, size
            if size != first:
                raise InputError(f"{path}: found a frame of {size} pixels, expected {first} as the first")
            # An MP4's sides are even: OpenCV would cut the last row or column off.
            even = np.pad(picture, ((0, size[1] % 2), (0, size[0] % 2), (0, 0)), mode="edge")
            writer.write(np.ascontiguousarray(even[..., ::-1]))
            count += 1

        try:
            yield append
        finally:
            try:
                if writer is not None:
                    writer.release()
                    _ensure_whole(file, path, count)
                    file.replace(path)
            finally:
                file.unlink(missing_ok=True)


def _ensure_whole(file: Path, path: Path, count: int) -> None:
    """OpenCV says nothing where a disk is full."""
    if (held := int(_property(file, cv2.CAP_PROP_FRAME_COUNT))) != count:
        raise InputError(
            f"{path}: {held} of {count} frames could be written, is the disk full? make room, or name another"
        )
