"""The paper's tables: their shape, sums and marks; with the paper's source at hand, every number."""

from __future__ import annotations

import re
from pathlib import Path

import pandas as pd
import pytest

from sfkit.errors import InputError
from sfkit.published import (
    BENCHMARKS,
    LABELS,
    SOURCES,
    published,
    published_table,
)

ROOT = Path(__file__).parents[2]

SHAPES = {
    "tab:fusion_compare": (6, 4),
    "tab:computational_cost": (5, 2),
    "tab:merging_comparison": (14, 5),
    "tab:zero_shot": (19, 5),
    "tab:individual_datasets": (8, 13),
    "tab:benchmark_results": (8, 14),
    "tab:ablation_1": (4, 5),
    "tab:validation_subset_robustness": (3, 6),
    "tab:s1_vs_s2": (2, 5),
    "tab:ablation_2": (4, 5),
}


def test_every_table_is_there_with_all_its_cells() -> None:
    assert {label: published(label).shape for label in LABELS} == SHAPES
    for label in LABELS:
        frame = published(label)
        assert frame.notna().all(axis=None)
        assert frame.index.is_unique
        assert frame.columns.is_unique


def test_numbers_read_off_the_paper_by_eye() -> None:
    assert published("tab:merging_comparison").loc[("FoundationStereo", "DARE"), "middlebury"] == 7.76
    assert published("tab:individual_datasets").loc[("NMRF", "eth3d"), "VirtualKITTI2"] == 73.78
    assert published("tab:benchmark_results").loc[("NMRF", "kitti2012"), "disparity to middlebury"] == 2.98
    assert published("tab:computational_cost").loc["Stage 2 (h)", "FoundationStereo"] == 1.1
    assert published("tab:validation_subset_robustness").loc["Middlebury", "subset"] == "0,2,3,9,10"
    assert published("tab:fusion_compare").loc["Ours (Stage 1+2)", "selection"] == "EA+CMA-ES"
    assert SOURCES[10] == "FoundationStereo"


def numbers_of_the_source(text: str, label: str) -> list[float]:
    """All decimal numbers in the cells of the table with this label, in reading order."""
    tables = re.findall(r"\\begin\{table\*?\}.*?\\end\{table\*?\}", text, flags=re.DOTALL)
    (source,) = [table for table in tables if rf"\label{{{label}}}" in table]
    body = source[source.index(r"\begin{tabular}") : source.index(r"\end{tabular}")]
    body = body[body.index(r"\hline\hline") :]
    body = re.sub(r"(?m)^\s*%.*$", "", body)
    # Citations, colours, rules and row heads hold digits that are no cells.
    body = re.sub(r"\\(cite|rowcolor|multicolumn)(\[\w+\])?\{[^}]*\}(\{[^}]*\}\{[^\n]*\})?", "", body)
    cells = [cell.strip() for row in re.split(r"\\\\", body) for cell in row.split("&")[1:]]
    found = [re.sub(r"\\(textbf|underline)|[{}\s]", "", cell) for cell in cells]
    return [float(cell) for cell in found if re.fullmatch(r"\d+(\.\d+)?", cell)]


@pytest.mark.parametrize("label", [label for label in LABELS if label != "tab:fusion_compare"])
def test_every_number_is_that_of_the_papers_source(goldens: Path, label: str) -> None:
    text = (goldens / "stereofactory.tex").read_text(encoding="utf-8")
    frame = published(label).drop(columns="subset", errors="ignore")
    cells = frame.to_numpy(float)
    if label == "tab:merging_comparison":  # the paper has both architectures side by side
        cells = cells.reshape(2, 7, 5).transpose(1, 0, 2)
    assert numbers_of_the_source(text, label) == cells.ravel().tolist()


def test_every_printed_mean_is_that_of_its_row() -> None:
    with_means = [label for label in LABELS if "mean" in published(label)]
    assert len(with_means) == 6
    for label in with_means:
        frame = published(label)
        by_hand = frame[list(BENCHMARKS)].astype(float).sum(axis=1) / 4
        assert (by_hand - frame["mean"].astype(float)).abs().max() < 0.0051, label
    total = published("tab:computational_cost")
    parts = total.loc["Stage 1 (h)"] + total.loc["Stage 2 (h)"]
    pd.testing.assert_series_equal(parts, total.loc["Total (h)"], check_names=False)


def test_bold_and_underlined_cells_are_the_best_and_second_best() -> None:
    marks = published_table("tab:individual_datasets").marks
    assert (marks == "best").sum(axis=None) == 8
    assert (marks == "second").sum(axis=None) == 8


def test_frames_are_fresh_and_labels_are_checked() -> None:
    mine = published("tab:ablation_1")
    mine.iloc[0, 0] = 0.0
    assert published("tab:ablation_1").iloc[0, 0] == 3.04
    with pytest.raises(InputError, match="did you mean 'tab:ablation_1'"):
        published("tab:ablation1")
