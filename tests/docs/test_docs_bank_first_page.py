"""The report: sentences from hand-made numbers, tables, pictures, and the whole page on one pair each."""

import re
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pandas as pd
import pytest
from bank_first_page import conclusions, markdown, write_report
from bank_pictures import colours, strip, write_picture
from bank_scores import BankScores

from sfkit import bank
from sfkit.datasets import Sample


def record(base: float, source: float | None = None) -> dict[str, Any]:
    own = {"constant_guess": {"epe": 8.0, "bad3": 80.0}, "base": {"epe": base, "bad3": 9.0}}
    if source is not None:
        own["source"] = {"epe": source, "bad3": 5.0}
    return {"own_domain": own}


def hand_made(uniform: float) -> BankScores:
    """A base, two sources and their equal merge on the validation benchmark and two others."""
    networks = ["plain", "haze", "soft-focus", "uniform"]
    benchmarks = pd.DataFrame(
        {"courtyard": [9.0] * 4, "a": [20.0, 10.0, 30.0, uniform], "b": [30.0, 20.0, 40.0, uniform]},
        index=networks,
    )
    own = pd.DataFrame(
        {"plain": [5.0, 6.0, 4.0, 1.0], "haze": [9.0, 3.0, 8.0, 1.0], "soft-focus": [9.0, 8.0, 7.0, 1.0]},
        index=networks,
    )
    trainings = {"plain": record(1.6), "haze": record(2.0, 1.5), "soft-focus": record(2.0, 1.0)}
    return BankScores(benchmarks, own, own / 10, trainings)


def test_conclusions_state_what_the_numbers_say() -> None:
    base, own, single, best, uniform, span = conclusions(hand_made(26.0))
    assert "20 % of what the best constant guess costs (8.00 px)" in base
    assert "lower by 25 % (haze) to 50 % (soft-focus)" in own
    assert "the base has 25.0 % bad pixels" in single
    assert "1 of the 2 sources help: haze (15.0 %); 1 harm: soft-focus (35.0 %)" in single
    assert "2 of 3 domains" in best
    assert "plain (soft-focus)" in best
    assert "26.0 %, not below the base's 25.0 %; it beats 1 of the 2" in uniform
    assert uniform.endswith("Uniform merging suffers here.")
    assert "from 9.0 % to 40.0 %" in span


def test_a_uniform_merge_that_wins_is_not_said_to_suffer() -> None:
    uniform = list(conclusions(hand_made(12.0)))[4]
    assert "12.0 %, below the base's 25.0 %; it beats 2 of the 2" in uniform
    assert uniform.endswith("Uniform merging does not suffer here.")


def test_a_source_that_lost_at_home_is_named() -> None:
    scores = hand_made(12.0)
    scores.trainings["haze"] = record(2.0, 2.2)
    assert "haze does not (-10 %)" in list(conclusions(scores))[1]


def test_markdown_by_hand() -> None:
    table = pd.DataFrame({"a": [1.25, 2.0], "b": [3.0, 4.0]}, index=["x", "b"])
    assert markdown(table, bold=True).splitlines() == [
        "| network | a | b |",
        "| --- | --: | --: |",
        "| x | 1.2 | 3.0 |",
        "| b | 2.0 | **4.0** |",
    ]


def sample(disparity: np.ndarray[Any, Any]) -> Sample:
    image = np.full((*disparity.shape, 3), 90, np.uint8)
    return Sample("a", image, image, disparity.astype(np.float32))


def test_a_strip_has_five_parts_and_shows_the_error() -> None:
    truth = np.full((40, 80), 20.0)
    prediction = truth.astype(np.float32)
    prediction[:, 40:] += 3.0
    picture = strip(sample(truth), prediction)
    height, width = picture.shape[0], picture.shape[1] // 5
    assert picture.shape == (26, 5 * 52, 3)
    error = picture[:, 4 * width :]
    assert (error[height // 2, 5] == 0).all()
    assert (error[height // 2, -5] == 128).all()  # 3 of 6 pixels


def test_scan_lines_survive_shrinking() -> None:
    truth = np.full((60, 120), np.nan)
    truth[::3, ::2] = 10.0
    picture = strip(sample(truth), np.full((60, 120), 10.0, np.float32))
    shown = picture[:, 2 * 78 : 3 * 78].any(axis=2)
    assert shown.mean() > 0.9


def test_colours_are_black_without_truth() -> None:
    painted = colours(np.array([[np.nan, 0.0, 10.0]], np.float32), 10.0)
    assert painted[0, 0].tolist() == [0, 0, 0]
    assert painted[0, 1, 2] > painted[0, 1, 0]  # bluish at 0
    assert painted[0, 2, 0] > painted[0, 2, 2]  # reddish at the largest


def test_pictures_are_rgb_files(tmp_path: Path) -> None:
    red = np.zeros((16, 16, 3), np.uint8)
    red[..., 0] = 200
    write_picture(tmp_path / "deep" / "red.jpg", red)
    read = cv2.imread(str(tmp_path / "deep" / "red.jpg"))
    assert read[8, 8, 2] == pytest.approx(200, abs=8)
    assert read[8, 8, 0] == pytest.approx(0, abs=8)


@pytest.mark.slow
def test_the_page_names_every_network_and_links_existing_pictures(tmp_path: Path) -> None:
    text = write_report(tmp_path, pairs=1).read_text()
    linked = re.findall(r"!\[[^]]*\]\(([^)]+)\)", text)
    assert len(linked) == 16
    assert all((tmp_path / path).stat().st_size > 1000 for path in linked)
    for name in (*bank.domains(), *bank.benchmarks(), "uniform"):
        assert name in text
    assert "nan" not in text
