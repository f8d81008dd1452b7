"""Curves of trainings: read from their table, smoothed by hand's means, refused where there is none."""

from __future__ import annotations

from pathlib import Path

import pytest

from sfkit.analysis import training_curve
from sfkit.errors import InputError
from sfkit.training.places import training_folder

ROWS = "step,loss,gradient_norm,rate,validation\n1,4.0,9.0,0.001,\n2,2.0,8.0,0.002,30.5\n3,1.0,7.0,0.001,\n"


def test_losses_are_smoothed_over_the_last_steps(tmp_path: Path) -> None:
    source = tmp_path / "haze.safetensors"
    folder = training_folder(source)
    folder.mkdir()
    (folder / "training.csv").write_text(ROWS)
    curve = training_curve("haze", source, window=2)
    assert curve.steps.tolist() == [1, 2, 3]
    assert curve.smoothed.tolist() == [4.0, 3.0, 1.5]
    assert curve.rates.tolist() == [0.001, 0.002, 0.001]
    assert curve.scores == {2: 30.5}


def test_a_source_without_a_curve_is_refused(tmp_path: Path) -> None:
    source = tmp_path / "haze.safetensors"
    with pytest.raises(InputError, match=r"training\.csv: not found.*was it trained by sfkit finetune"):
        training_curve("haze", source)
    training_folder(source).mkdir()
    (training_folder(source) / "training.csv").write_text("step,loss\n1,2\n")
    with pytest.raises(InputError, match="the column 'gradient_norm' is missing"):
        training_curve("haze", source)
