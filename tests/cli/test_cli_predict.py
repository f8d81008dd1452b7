"""``sfkit predict``: what it writes and says of images, folders and videos."""

from __future__ import annotations

import shutil
from pathlib import Path

import cv2
import numpy as np
import pytest
from cli_world import Shell

from sfkit.datasets.census import CensusTarget
from sfkit.datasets.images import read_image
from sfkit.datasets.pfm import read_pfm
from sfkit.datasets.videos import frames

BASE = "pool/base.safetensors --architecture anynet --option spn=false --option ranges=[4,3,3]"


def test_predict(shell: Shell, world: Path) -> None:
    shell("merge pool --uniform -o merged.safetensors")
    images = "-l pairs/pair0/left.png -r pairs/pair0/right.png"
    line = f"predict merged.safetensors {images} --focal 100 --baseline 0.5"
    document = shell.json(f"{line} -o out")
    (row,) = document["predictions"]
    disparity = read_pfm(world / "out" / "left.pfm")
    assert row["median_px"] == pytest.approx(float(np.median(disparity)))
    assert row["nonfinite"] == 0
    depth = read_pfm(Path(row["depth"]))
    assert depth[20, 50] == pytest.approx(100 * 0.5 / disparity[20, 50], rel=1e-6)
    _, errors = shell(f"{line} -o out", code=2)
    assert "exists" in errors
    shell(f"{line} -o out --force")


def test_predict_says_both_names_and_makes_points_of_folders(shell: Shell, world: Path) -> None:
    for number in range(2):
        for side in ("left", "right"):
            (world / side).mkdir(exist_ok=True)
            shutil.copy(f"pairs/pair{number}/{side}.png", f"{side}/{side[0]}{number + 9}.png")
    (world / "K.txt").write_text("100 0 48 0 100 24 0 0 1\n0.5\n")
    line = f"predict {BASE} -l left -r right --calib K.txt --cloud --farthest 30"
    text, errors = shell(f"{line} -o out")
    assert errors.splitlines()[1:] == [
        "1 of 2: l9.png and r9.png -> out/l9.pfm",
        "2 of 2: l10.png and r10.png -> out/l10.pfm",
    ]
    _, errors = shell(f"{line.replace('--cloud', '')} -o far", code=2)
    assert "--farthest: found no --cloud" in errors
    rows = shell.json(f"{line} -o out --force")["predictions"]
    assert [(row["left"], row["right"]) for row in rows] == [
        ("left/l9.png", "right/r9.png"),
        ("left/l10.png", "right/r10.png"),
    ]
    for row in rows:
        assert f"{row['points']:,} points" in text
        near = read_pfm(Path(row["depth"])) <= 30
        assert f"element vertex {near.sum()}\n".encode() in Path(row["cloud"]).read_bytes()[:300]
        overview = cv2.imread(row["overview"])
        assert np.array_equal(overview[:, :96], cv2.imread(row["left"]))
        assert np.array_equal(overview[:, 96:], cv2.imread(row["preview"]))


def test_predict_a_video_of_both_views(shell: Shell, world: Path) -> None:
    writer = cv2.VideoWriter("drive.avi", cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (192, 48))
    pair = [cv2.imread(f"pairs/pair0/{side}.png") for side in ("left", "right")]
    for _ in range(5):
        writer.write(np.hstack(pair))
    writer.release()
    line = f"predict {BASE} -l drive.avi --layout side-by-side --every 2"
    text, errors = shell(f"{line} -o out")
    assert errors.splitlines() == [f"{n} of 3: out/drive_{2 * (n - 1):06}.pfm" for n in (1, 2, 3)]
    assert text.splitlines()[-1] == "3 frames; look at out/drive_overview.mp4"
    document = shell.json(f"{line} -o out --force")
    assert [row["frame"] for row in document["predictions"]] == [0, 2, 4]
    first = read_pfm(Path(document["predictions"][0]["disparity"]))
    assert first.shape == (48, 96)
    assert len(list(frames(document["overview"]))) == 3


def test_a_bar_on_a_terminal(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("sys.stderr.isatty", lambda: True)
    monkeypatch.setenv("TERM", "xterm")
    _, errors = shell(f"predict {BASE} -l pairs/pair0/left.png -r pairs/pair0/right.png -o out")
    assert "1 of 1: left.png and right.png -> out/left.pfm" in errors
    assert "pairs 100 % |" in errors
    assert "\x1b[" in errors


def test_predict_checks_each_by_its_pair(shell: Shell, world: Path) -> None:
    shell("merge pool --uniform -o merged.safetensors")
    pair = "-l pairs/pair0/left.png -r pairs/pair0/right.png"
    assert "confidence" not in shell.json(f"predict merged.safetensors {pair} -o plain")["predictions"][0]
    line = f"predict merged.safetensors {pair} -o out --check"
    (row,) = shell.json(line)["predictions"]
    left, right = (read_image(world / f"pairs/pair0/{side}.png") for side in ("left", "right"))
    expected = CensusTarget(left, right).residual(read_pfm(Path(row["disparity"])))
    assert row["census_percent"] == pytest.approx(expected.score, abs=1e-4)
    assert row["inside"] == pytest.approx(expected.inside)
    assert 0 <= row["consistent"] <= 1
    confidence = cv2.imread(row["confidence"], cv2.IMREAD_UNCHANGED)
    assert (confidence.shape, confidence.dtype) == (left.shape[:2], np.uint8)
    text, _ = shell(f"{line} --force")
    assert f"census {row['census_percent']:.2f} %, {100 * row['consistent']:.0f} % consistent" in text
