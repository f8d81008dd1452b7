"""Tables as files: read back, and as LaTeX against a table written by hand."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pandas as pd
import pytest

from sfkit import InputError
from sfkit.analysis import export_table

TABLE = pd.DataFrame(
    {
        "subset": ["a_1, b", "c"],
        "world * [%]": [12.345, 9.0],
        "mean": [3.0, float("nan")],
        "scored": [1200, 7],
    },
    index=pd.Index(["Stage 1", "Stage 1+2"], name="network"),
)
BY_HAND = r"""\begin{table}
\centering
\caption{Scores in \%}
\label{tab:main}
\begin{tabular}{llrrr}
\toprule
network & subset & world * [\%] & mean & scored \\
\midrule
Stage 1 & a\_1, b & 12.35 & 3.00 & 1\,200 \\
Stage 1+2 & c & \textbf{9.00} & -- & 7 \\
\bottomrule
\end{tabular}
\end{table}
"""


def latex(table: pd.DataFrame, folder: Path, name: str, **settings: Any) -> str:
    export_table(table, folder, name, **settings)
    return (folder / f"{name}.tex").read_text(encoding="utf-8")


def test_latex_is_what_one_would_write_by_hand(tmp_path: Path) -> None:
    text = latex(TABLE, tmp_path, "main", caption="Scores in %", lower_is_better=["world * [%]"])
    assert text == BY_HAND


def test_both_files_are_written_and_the_table_comes_back(tmp_path: Path) -> None:
    assert export_table(TABLE, tmp_path / "new", "main", caption="Scores in %") is TABLE
    read = pd.read_csv(tmp_path / "new" / "main.csv", index_col="network")
    pd.testing.assert_frame_equal(read, TABLE)
    assert (tmp_path / "new" / "main.tex").read_text().startswith(r"\begin{table}")


def test_every_network_that_prints_as_the_best_is_bold(tmp_path: Path) -> None:
    tie = pd.DataFrame({"score": [1.001, 1.004, 2.0]}, index=pd.Index(list("abc"), name="network"))
    text = latex(tie, tmp_path, "tie", lower_is_better=["score"])
    assert text.count(r"\textbf{1.00}") == 2


def test_several_levels_of_rows_and_columns_become_one(tmp_path: Path) -> None:
    rows = pd.MultiIndex.from_tuples([("bank", "own"), ("slim", "own")], names=["pool", "subset"])
    table = pd.DataFrame([[1.0], [2.0]], index=rows, columns=pd.MultiIndex.from_tuples([("mean", "low")]))
    export_table(table, tmp_path, "levels")
    assert pd.read_csv(tmp_path / "levels.csv").iloc[-1, :2].tolist() == ["slim", "own"]
    text = latex(table, tmp_path, "levels")
    assert "pool / subset & mean low" in text
    assert "bank / own & 1.00" in text


@pytest.mark.parametrize("name", ["", "a b", "../up", "-x"])
def test_names_that_are_no_file_names_are_refused(name: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="expected letters, digits, - and _"):
        export_table(TABLE, tmp_path, name)
    assert list(tmp_path.iterdir()) == []


def test_a_column_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="found no column 'maen'"):
        export_table(TABLE, tmp_path, "main", lower_is_better=["maen"])
