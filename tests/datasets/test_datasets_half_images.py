"""Half an image is none: decoders fill what is missing, and would score it."""

from __future__ import annotations

import re
from pathlib import Path

import cv2
import numpy as np
import pytest

from sfkit.datasets.images import read_image
from sfkit.errors import InputError

END = b"\xff\xd9"


def photo(size: tuple[int, int] = (120, 160)) -> np.ndarray:
    noise = np.random.default_rng(1).integers(0, 256, (*size, 3), dtype=np.uint8)
    return cv2.GaussianBlur(noise, (7, 7), 2.0)


def jpeg(pixels: np.ndarray, *flags: int) -> bytes:
    return bytes(cv2.imencode(".jpg", pixels, [cv2.IMWRITE_JPEG_QUALITY, 90, *flags])[1])


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
@pytest.mark.parametrize("ending", [b"", END, END + b"\0" * 30])
def test_half_a_jpeg_is_refused(tmp_path: Path, share: float, ending: bytes) -> None:
    whole = jpeg(photo())
    assert read_image(_written(tmp_path, whole)).shape == (120, 160, 3)
    with pytest.raises(
        InputError, match=r"x\.jpg: found (a file that ends too early|a JPEG that lacks a part)"
    ):
        read_image(_written(tmp_path, whole[: int(share * len(whole))] + ending))


@pytest.mark.parametrize("progressive", [0, 1])
def test_a_jpeg_that_ends_within_a_segment_is_refused(tmp_path: Path, progressive: int) -> None:
    """Wherever it ends: the sizes and the scans are counted by bytes that may not have come."""
    whole = jpeg(photo((16, 16)), cv2.IMWRITE_JPEG_PROGRESSIVE, progressive)
    scan = whole.rindex(b"\xff\xda")
    for length in (*range(4, whole.index(b"\xff\xda") + 16), *range(scan, scan + 16)):
        with pytest.raises(InputError, match="ends too early"):
            read_image(_written(tmp_path, whole[:length]))


def test_the_end_of_a_thumbnail_is_not_that_of_the_image(tmp_path: Path) -> None:
    """In a segment of its own at the end of what is there, within the 64 bytes that were looked at."""
    whole, small = jpeg(photo()), b"\xff\xd8" + b"\0" * 10 + END
    segment = b"\xff\xe1" + (len(small) + 2).to_bytes(2, "big") + small
    assert read_image(_written(tmp_path, whole[:2] + segment + whole[2:])).shape == (120, 160, 3)
    with pytest.raises(InputError, match="ends too early"):
        read_image(_written(tmp_path, whole[:2] + segment))


@pytest.mark.parametrize("border", [0, 114, 255])
def test_borders_and_progressive_files_are_whole(tmp_path: Path, border: int) -> None:
    pixels = photo()
    pixels[60:] = border
    assert read_image(_written(tmp_path, jpeg(pixels))).shape == (120, 160, 3)
    flags = (cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_RST_INTERVAL, 4)
    assert read_image(_written(tmp_path, jpeg(photo(), *flags))).shape == (120, 160, 3)
    assert read_image(_written(tmp_path, jpeg(photo()) + b"\0" * 40)).shape == (120, 160, 3)
    grey = jpeg(np.full((64, 64, 3), 120, np.uint8))
    assert read_image(_written(tmp_path, grey)).shape == (64, 64, 3)


@pytest.mark.parametrize("share", [0.1, 0.3, 0.5])
@pytest.mark.parametrize("grey", [False, True])
def test_half_a_progressive_jpeg_is_refused_though_all_of_it_is_there_blurred(
    tmp_path: Path, share: float, grey: bool
) -> None:
    pixels = cv2.cvtColor(photo(), cv2.COLOR_BGR2GRAY) if grey else photo()
    whole = jpeg(pixels, cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
    read_image(_written(tmp_path, whole))
    half = whole[: int(share * len(whole))].rstrip(b"\xff") + END
    blurred = cv2.imdecode(np.frombuffer(half, np.uint8), cv2.IMREAD_UNCHANGED)
    assert blurred.shape == pixels.shape, "a decoder takes it"
    assert np.abs(blurred.astype(int) - pixels).mean() > 1, "and gives another image"
    with pytest.raises(InputError, match=r"x\.jpg: found a file that ends too early"):
        read_image(_written(tmp_path, half))


@pytest.mark.parametrize("cut", [20, 0.1, 0.5])
@pytest.mark.parametrize("zeros", [False, True])
@pytest.mark.parametrize("progressive", [0, 1])
def test_a_jpeg_cut_within_its_last_scan_is_refused(
    tmp_path: Path, cut: float, zeros: bool, progressive: int
) -> None:
    """All scans begin, the file has an end and no colour is filled in: libjpeg alone knows."""
    pixels = photo()
    pixels[100:] = 0  # a border, as of rectification, which would hide what is filled in
    whole = jpeg(pixels, cv2.IMWRITE_JPEG_PROGRESSIVE, progressive)
    scan = whole.rindex(b"\xff\xda")
    start = scan + 2 + int.from_bytes(whole[scan + 2 : scan + 4], "big")
    if zeros and not progressive:
        whole = whole[: start - 3] + bytes(3) + whole[start:]
    read_image(_written(tmp_path, whole))
    gone = int(cut * (len(whole) - start)) if cut < 1 else int(cut)
    half = whole[:-gone].rstrip(b"\xff") + END
    taken = cv2.imdecode(np.frombuffer(half, np.uint8), cv2.IMREAD_UNCHANGED)
    assert taken.shape == pixels.shape, "a decoder takes it"
    with pytest.raises(InputError, match=r"x\.jpg: found a JPEG that lacks a part \(Corrupt JPEG data: prem"):
        read_image(_written(tmp_path, half))


def test_noise_in_a_scan_is_refused(tmp_path: Path) -> None:
    """As of a disk that lost a sector; what the decoder makes of it would be scored."""
    whole = jpeg(photo())
    middle = len(whole) // 2
    noise = np.random.default_rng(0).integers(0, 255, 600, dtype=np.uint8).tobytes()
    with pytest.raises(InputError, match=r"lacks a part \(Corrupt JPEG data: "):
        read_image(_written(tmp_path, whole[:middle] + noise + whole[middle + 600 :]))


def test_bytes_that_are_gone_between_restarts_are_missed(tmp_path: Path) -> None:
    """What is left over before the next restart is the first that libjpeg warns of, and the last."""
    whole = jpeg(photo(), cv2.IMWRITE_JPEG_RST_INTERVAL, 4)
    read_image(_written(tmp_path, whole))
    start = len(whole) // 3
    for gone in range(60, 600, 60):
        with pytest.raises(InputError, match=r"lacks a part \(Corrupt JPEG data: "):
            read_image(_written(tmp_path, whole[:start] + whole[start + gone :]))


def test_bytes_left_over_of_a_scan_are_a_trace_of_others_in_its_place(tmp_path: Path) -> None:
    """Of the first of several scans, too; before, those alone before a restart were."""
    whole = jpeg(photo(), cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
    scan = whole.index(b"\xff\xda") + 20
    for start in (scan, scan + 60, scan + 150):
        with pytest.raises(InputError, match=r"lacks a part \(Corrupt JPEG data: .* convert them to PNG"):
            read_image(_written(tmp_path, whole[:start] + bytes(40) + whole[start + 40 :]))


def test_a_progressive_jpeg_without_one_of_its_scans_is_refused(tmp_path: Path) -> None:
    """Whichever it is: a later scan can refine what never came, and ends at the last bit all the same."""
    whole = jpeg(photo(), cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
    starts = [at.start() for at in re.finditer(b"\xff[\xc4\xda]", whole)]
    scans = [at for at in starts if whole[at + 1] == 0xDA]
    for scan in scans:
        after = next((at for at in starts if at > scan), len(whole) - 2)
        for end in {after, next((at for at in scans if at > scan), len(whole) - 2)}:  # its tables gone too
            with pytest.raises(
                InputError, match=r"x\.jpg: found (a file that ends|a JPEG that lacks|no image)"
            ):
                read_image(_written(tmp_path, whole[:scan] + whole[end:]))


def test_what_lies_before_the_first_scan_hides_no_loss(tmp_path: Path) -> None:
    """Only the first is warned of, such as strange bytes in front, which lose nothing."""
    whole = jpeg(photo())
    strange = whole[:2] + whole[2:20].replace(b"JFIF\0\1", b"JFIF\0\3") + b"\0\1\2" + whole[20:]
    assert np.array_equal(read_image(_written(tmp_path, strange)), read_image(_written(tmp_path, whole))), (
        "nothing is lost"
    )
    with pytest.raises(InputError, match=r"lacks a part \(Corrupt JPEG data: prem"):
        read_image(_written(tmp_path, strange[: len(strange) // 2] + END))


def test_zeros_before_the_end_are_padding(tmp_path: Path) -> None:
    whole = jpeg(photo())
    read_image(_written(tmp_path, whole[:-2] + bytes(20) + END))
    with pytest.raises(InputError, match=r"lacks a part \(Corrupt JPEG data: \d+ extraneous bytes"):
        read_image(_written(tmp_path, whole[:-2] + bytes(range(20)) + END))


def test_colours_may_come_in_scans_of_their_own(tmp_path: Path) -> None:
    """As of a camera that does not interleave: three scans, each of one colour."""
    flags = (cv2.IMWRITE_JPEG_PROGRESSIVE, 1, cv2.IMWRITE_JPEG_SAMPLING_FACTOR, 0x111111)
    whole = jpeg(photo(), *flags)
    assert whole.count(b"\xff\xda") > 6
    read_image(_written(tmp_path, whole))


def test_zeros_that_decoders_look_over_are_looked_over(tmp_path: Path) -> None:
    """Old programs say of the one scan of a plain JPEG that it brings frequency 0 alone; libjpeg warns."""
    whole = jpeg(photo())
    scan = whole.index(b"\xff\xda")
    end = scan + 2 + int.from_bytes(whole[scan + 2 : scan + 4], "big")
    assert whole[end - 3 : end] == b"\x00\x3f\x00"
    zeros = _written(tmp_path, whole[: end - 3] + bytes(3) + whole[end:])
    found = read_image(zeros)
    assert np.array_equal(found, read_image(_written(tmp_path, whole)))


def _written(folder: Path, content: bytes) -> Path:
    (folder / "x.jpg").write_bytes(content)
    return folder / "x.jpg"
