"""A video's frames are predicted as images are; what was done stays when the rest fails."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from torch import nn

from sfkit.architectures import InputConvention
from sfkit.datasets.calibration import Calibration
from sfkit.datasets.pfm import read_pfm
from sfkit.datasets.videos import StereoVideo, frames
from sfkit.errors import InputError, SfkitError, SfkitWarning
from sfkit.evaluation.prediction import predict
from sfkit.evaluation.prediction_files import Outputs, PredictionFiles
from sfkit.evaluation.video_prediction import VideoPlan, predict_video
from sfkit.merging.network import LoadedNetwork

SIZE = (32, 48)


class Brightness(nn.Module):
    """Says how bright the left image is, where the right one is black; fails at a white left one."""

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        if left.mean() > 240:
            raise RuntimeError("too bright")
        return (left - right).mean(dim=1) + 1


MODEL = LoadedNetwork(Brightness(), InputConvention(scale=1.0, mean=(0.0,) * 3, std=(1.0,) * 3), "brightness")


@pytest.fixture
def video(tmp_path: Path) -> StereoVideo:
    """Five frames, left 10, 60, ... above right 0."""
    path = tmp_path / "drive.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (SIZE[1], 2 * SIZE[0]))
    for level in (10, 60, 110, 160, 250):
        frame = np.zeros((2 * SIZE[0], SIZE[1], 3), np.uint8)
        frame[: SIZE[0]] = level
        writer.write(frame)
    writer.release()
    return StereoVideo(path, layout="top-bottom")


def test_each_frame_has_its_files_and_the_overview_shows_all(video: StereoVideo, tmp_path: Path) -> None:
    cameras = Calibration(100.0, 0.5, centre=(24.0, 16.0), size=(48, 32))
    outputs = Outputs(calibration=cameras, check=True, cloud=True)
    plan = VideoPlan.of(video, tmp_path / "out", outputs, every=2)
    assert plan.length == 3
    found: list[PredictionFiles] = []
    with pytest.raises(SfkitError, match=r"drive\.avi, frame 4: the network failed \(RuntimeError: too"):
        keep_into(found, plan)
    names = ("pfm", "confidence.png", "depth.pfm", "cloud.ply")
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == sorted(
        [f"drive_{n:06}{'.' if name == 'pfm' else '_'}{name}" for n in (0, 2) for name in names]
        + ["drive_overview.mp4"]
    )
    pairs = list(video.pairs())
    for number, written in zip((0, 2), found, strict=True):
        assert np.array_equal(read_pfm(written.disparity), predict(MODEL, *pairs[number]))
    seen = list(frames(tmp_path / "out" / "drive_overview.mp4"))
    assert [frame.shape for frame in seen] == [(32, 3 * 48, 3)] * 2, "left, disparity and confidence"
    assert [frame[:, :40].mean() for frame in seen] == pytest.approx([10, 110], abs=6)


def keep_into(found: list[PredictionFiles], plan: VideoPlan) -> None:
    """Keeps what comes before an error."""
    for written in predict_video(MODEL, plan):
        found.append(written)


def test_frames_of_an_earlier_prediction_are_named(video: StereoVideo, tmp_path: Path) -> None:
    """Of a longer video, of one with depth, or of every frame: what lies there is no part of this one."""
    out = tmp_path / "out"
    out.mkdir()
    for name in ("000000.pfm", "000001.pfm", "000009_depth.pfm", "notes.txt"):
        (out / f"drive_{name}").write_bytes(b"mine")
    plan = VideoPlan.of(video, out, every=3, overwrite=True)
    with pytest.warns(SfkitWarning, match=r"drive_000001\.pfm and 1 more: of an earlier prediction"):
        assert len(list(predict_video(MODEL, plan))) == 2
    assert (out / "drive_000001.pfm").read_bytes() == b"mine", "nothing is deleted"


def test_what_would_be_lost_or_fail_is_refused_first(video: StereoVideo, tmp_path: Path) -> None:
    out = tmp_path / "out"
    out.mkdir()
    (out / "drive_000003.pfm").touch()
    with pytest.raises(InputError, match=r"drive_000003\.pfm: the file exists"):
        VideoPlan.of(video, out)
    VideoPlan.of(video, out, overwrite=True)
    VideoPlan.of(video, out, Outputs("png16"))
    (out / "drive_overview.mp4").touch()
    with pytest.raises(InputError, match=r"drive_overview\.mp4: the file exists"):
        VideoPlan.of(video, out, Outputs("png16"))
    with pytest.raises(InputError, match="every is 0, expected"):
        VideoPlan.of(video, tmp_path / "new", every=0)
    with pytest.raises(InputError, match="is of images of 9x9 pixels, found 48x32"):
        VideoPlan.of(video, tmp_path / "new", Outputs(calibration=Calibration(1.0, 1.0, size=(9, 9))))
    with pytest.raises(InputError, match="are one and the same"):
        VideoPlan.of(StereoVideo(video.left, video.left), tmp_path / "new")
    assert not (tmp_path / "new").exists()


def test_outputs_are_checked_where_they_are_made() -> None:
    for make, message in (
        (lambda: Outputs("png8"), "did you mean 'png16'"),
        (lambda: Outputs(cloud=True), "a point cloud and no calibration"),
        (lambda: Outputs(cloud=True, calibration=Calibration(1.0, 1.0)), "needs the principal point"),
        (lambda: Outputs(farthest=0.0), "farthest is 0, expected metres"),
    ):
        with pytest.raises(InputError, match=message):
            make()
