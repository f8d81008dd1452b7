"""Both views of a video, from two files or one, are the frames that were written."""

from __future__ import annotations

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray

from sfkit.datasets.videos import StereoVideo, frames, writing_video
from sfkit.errors import InputError

Image = NDArray[np.uint8]


def grey(level: int, size: tuple[int, int] = (32, 48)) -> Image:
    return np.full((*size, 3), level, np.uint8)


def video(path: Path, pictures: Sequence[Image], rate: float = 10.0) -> Path:
    """An AVI of pictures of one size, within a few grey levels of them."""
    height, width = pictures[0].shape[:2]
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), rate, (width, height))
    for picture in pictures:
        writer.write(picture)
    writer.release()
    return path


def levels(found: StereoVideo) -> list[tuple[int, int]]:
    return [(round(float(left.mean())), round(float(right.mean()))) for left, right in found.pairs()]


EXPECTED = [(40, 140), (80, 180), (120, 220)]


def close(found: list[tuple[int, int]]) -> bool:
    return len(found) == len(EXPECTED) and np.abs(np.array(found) - EXPECTED).max() <= 2


def test_two_files_frame_for_frame(tmp_path: Path) -> None:
    left, right = (
        video(tmp_path / f"{side}.avi", [grey(pair[side]) for pair in EXPECTED]) for side in (0, 1)
    )
    both = StereoVideo(left, right)
    assert close(levels(both))
    assert (both.length, both.rate) == (3, 10.0)


@pytest.mark.parametrize(("layout", "axis"), [("side-by-side", 1), ("top-bottom", 0)])
def test_one_file_of_both_views(tmp_path: Path, layout: str, axis: int) -> None:
    pictures = [np.concatenate([grey(a), grey(b)], axis=axis) for a, b in EXPECTED]
    both = StereoVideo(video(tmp_path / "both.avi", pictures), layout=layout)
    assert close(levels(both))
    assert next(both.pairs())[0].shape == (32, 48, 3)


def test_what_is_no_stereo_video_is_refused(tmp_path: Path) -> None:
    one = video(tmp_path / "one.avi", [grey(n) for n in (1, 2, 3)])
    short = video(tmp_path / "short.avi", [grey(1)])
    small = video(tmp_path / "small.avi", [grey(1, (16, 48))])
    for make, message in (
        (lambda: StereoVideo(one), "found no right video, expected a right video or a layout"),
        (lambda: StereoVideo(one, short, "top-bottom"), "two videos and the layout 'top-bottom'"),
        (lambda: StereoVideo(one, layout="side-by-sid"), "did you mean 'side-by-side'"),
        (lambda: list(StereoVideo(one, short).pairs()), r"short\.avi: ends before .*one\.avi"),
        (lambda: list(StereoVideo(short, one).pairs()), r"short\.avi: ends before .*one\.avi"),
        (lambda: list(StereoVideo(one, small).pairs()), r"small\.avi: has 48x16 pixels, expected 48x32"),
        (lambda: next(frames(tmp_path)), "is a folder"),
        (lambda: next(frames(tmp_path / os.fsdecode(b"caf\xe9.avi"))), "no such file"),
    ):
        with pytest.raises(InputError, match=message):
            make()


def test_an_odd_frame_has_no_halves(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sfkit.datasets.videos.frames", lambda path: iter([grey(1, (32, 49))]))
    with pytest.raises(InputError, match="49x32 pixels, expected an even width to halve"):
        list(StereoVideo(tmp_path / "odd.avi", layout="side-by-side").pairs())


def test_a_name_that_is_no_text_does_not_end_the_process(tmp_path: Path) -> None:
    path = tmp_path / os.fsdecode(b"caf\xe9.avi")
    path.write_bytes(b"anything")
    with pytest.raises(InputError, match="has a name that is no text"):
        next(frames(path))
    with (
        pytest.raises(InputError, match="is no text, expected another to write"),
        writing_video(path.with_suffix(".mp4"), 12.0) as append,
    ):
        append(grey(1))


def test_a_written_video_holds_what_it_got_when_it_ended(tmp_path: Path) -> None:
    """Odd sizes too, and when the work behind it fails: nothing that was computed is lost."""
    path = tmp_path / "new" / "o.mp4"

    def fail() -> None:
        with writing_video(path, 12.0) as append:
            for level in (40, 200):
                append(grey(level, (33, 51)))
            raise RuntimeError("later")

    with pytest.raises(RuntimeError, match="later"):
        fail()
    found = [float(frame.mean()) for frame in frames(path)]
    assert found == pytest.approx([40, 200], abs=3)
    assert next(frames(path)).shape[:2] == (34, 52)
    assert [entry.name for entry in path.parent.iterdir()] == ["o.mp4"]


def test_frames_of_a_video_have_one_size(tmp_path: Path) -> None:
    with writing_video(tmp_path / "o.mp4", 12.0) as append:
        append(grey(1, (33, 51)))
        with pytest.raises(InputError, match=r"found a frame of \(48, 32\) pixels, expected \(51, 33\)"):
            append(grey(1))


def test_no_frame_is_no_file(tmp_path: Path) -> None:
    with writing_video(tmp_path / "o.mp4", 12.0):
        pass
    assert list(tmp_path.iterdir()) == []


def test_a_video_that_did_not_come_to_the_disk_is_said_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """OpenCV writes to a full disk, and to a format it does not have, without a word."""

    def write() -> None:
        with writing_video(tmp_path / "o.mp4", 12.0) as append:
            for level in (40, 80, 120):
                append(grey(level))

    class Full:
        """Holds OpenCV's writer: to inherit from it corrupts memory, and the process dies later."""

        fourcc, make = cv2.VideoWriter.fourcc, cv2.VideoWriter

        def __init__(self, *arguments: Any) -> None:
            self.writer = self.make(*arguments)

        def isOpened(self) -> bool:  # noqa: N802 (OpenCV's)
            return self.writer.isOpened()

        def write(self, image: object) -> None:
            """Nothing."""

        def release(self) -> None:
            self.writer.release()

    class Unknown(Full):
        def isOpened(self) -> bool:  # noqa: N802 (OpenCV's)
            return False

    for writer, said in ((Full, "0 of 3 frames could be written"), (Unknown, "OpenCV cannot write an MP4")):
        with monkeypatch.context() as patched:
            patched.setattr(cv2, "VideoWriter", writer)
            with pytest.raises(InputError, match=said):
                write()
        assert list(tmp_path.iterdir()) == []
    (tmp_path / "o.mp4").mkdir()
    with pytest.raises(OSError, match=r"o\.mp4"):
        write()
    assert [path.name for path in tmp_path.iterdir()] == ["o.mp4"]
