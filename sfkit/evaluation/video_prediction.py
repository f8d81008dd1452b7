"""Predictions of a stereo video: a file for each frame, and one video to look at."""

from __future__ import annotations

import itertools
import os
from collections.abc import Container, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from sfkit.colours import range_of
from sfkit.datasets.matching import ensure_two
from sfkit.datasets.videos import StereoVideo, writing_video
from sfkit.errors import InputError
from sfkit.evaluation.prediction import Map, overview_of
from sfkit.evaluation.prediction_files import (
    KINDS,
    Outputs,
    PredictionFiles,
    ensure_free,
    predict_checked,
    warn_of_others,
    write_prediction,
)
from sfkit.files import ensure_writable

if TYPE_CHECKING:
    from sfkit.merging.network import LoadedNetwork

_SETTLE = 0.1  # share of a frame's own colour range in that of the video, so that colours do not flicker


@dataclass(frozen=True)
class VideoPlan:
    """A video that can be predicted and the files that will be written; make one with :meth:`of`.

    Attributes:
        video: both views.
        stem: where its files go, without number and ending.
        outputs: what is written of each frame.
        every: one frame in so many is predicted.
    """

    video: StereoVideo
    stem: Path
    outputs: Outputs = field(default_factory=Outputs)
    every: int = 1

    @classmethod
    def of(
        cls,
        video: StereoVideo,
        out: Path,
        outputs: Outputs | None = None,
        *,
        every: int = 1,
        overwrite: bool = False,
    ) -> VideoPlan:
        """Check all that would fail or be lost later, before a network is loaded; nothing is written.

        Args:
            video: both views; the first frame is decoded.
            out: the folder for ``NAME_000000.pfm`` and so on, and ``NAME_overview.mp4``.
            outputs: what is written of each frame.
            every: predict one frame in so many.
            overwrite: whether files that exist may be replaced; the videos themselves never are.

        Raises:
            InputError: a video that cannot be read, views of unequal size, a calibration of another size, a
                place that cannot be written to, or a file that would be overwritten.
        """
        if every < 1:
            raise InputError(f"every is {every}, expected a number of frames of at least 1")
        ensure_writable(out, out, "choose another place")
        if video.right is not None:
            ensure_two(video.left, video.right)
        plan = cls(video, out / video.left.stem, outputs or Outputs(), every)
        files = [os.path.realpath(path) for path in (video.left, video.right) if path is not None]
        if os.path.realpath(plan.overview) in files:
            raise InputError(f"{plan.overview}: is one of the videos, choose another folder for the results")
        for target in (plan.overview, *plan._left_over()):
            ensure_free(target, overwrite=overwrite)
        # The first frame alone: reading all would take as long as predicting them.
        left, _ = next(video.pairs())
        plan.outputs.check_size(left)
        return plan

    @property
    def overview(self) -> Path:
        """The video of left image, disparity and, where it is asked for, confidence side by side."""
        return self.stem.with_name(f"{self.stem.name}_overview.mp4")

    @property
    def length(self) -> int | None:
        """Frames that will be predicted, as far as the files announce them."""
        announced = self.video.length
        # Rounded up: the first frame is always predicted.
        return None if announced is None else -(-announced // self.every)

    def targets(self, number: int) -> dict[str, Path]:
        """What is written of the frame of that number, counted from 0 in the video -> its file."""
        endings = self.outputs.endings.items()
        return {what: self.stem.with_name(f"{self.stem.name}_{number:06}{end}") for what, end in endings}

    def others(self, written: Container[Path]) -> list[Path]:
        """Files of frames of an earlier prediction that are not among those written."""
        return [path for path in self._left_over(*KINDS) if path not in written]

    def _left_over(self, *more: str) -> list[Path]:
        """Files of frames that lie there already, with the endings of this plan and others."""
        if not self.stem.parent.is_dir():
            return []
        names = {path.name: path for path in self.stem.parent.iterdir()}
        head, endings = f"{self.stem.name}_", (*self.outputs.endings.values(), *more)
        return [
            path
            for name, path in sorted(names.items())
            # By the number's six digits, so that another video's name that begins alike is no match.
            if name.startswith(head) and name[len(head) : len(head) + 6].isdigit() and name.endswith(endings)
        ]


def predict_video(model: LoadedNetwork, plan: VideoPlan) -> Iterator[PredictionFiles]:
    """Predict frame after frame and write each before the next; the overview ends where this ends.

    Raises:
        InputError: one video ends before the other, or a disparity is too large for a 16-bit PNG.
        SfkitError: the network failed on a frame.
    """
    limits: tuple[float, float] | None = None
    written: set[Path] = set()
    # At the video's own speed, though frames are left out.
    rate = plan.video.rate / plan.every
    with writing_video(plan.overview, rate) as append:
        for number, (left, right) in itertools.islice(enumerate(plan.video.pairs()), 0, None, plan.every):
            where = f"{plan.video.left}, frame {number}"
            disparity, check = predict_checked(model, left, right, where, check=plan.outputs.check)
            limits = _settled(limits, disparity)
            append(overview_of(left, disparity, None if check is None else check.confidence, limits))
            targets = plan.targets(number)
            written.update(targets.values())
            yield write_prediction(disparity, left, targets, plan.outputs, check)
    warn_of_others(plan.others(written))


def _settled(limits: tuple[float, float] | None, disparity: Map) -> tuple[float, float]:
    """The video's colour range, moved a little towards this frame's."""
    own = range_of(disparity)
    # A map without a finite value has no range to move towards.
    if limits is None or not np.isfinite(disparity).any():
        return own if limits is None else limits
    return (limits[0] + _SETTLE * (own[0] - limits[0]), limits[1] + _SETTLE * (own[1] - limits[1]))
