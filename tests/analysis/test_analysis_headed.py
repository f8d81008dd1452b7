"""Tables as pages show them: two lines of heads, marks, LaTeX behind a fold; laid out as a browser would."""

from __future__ import annotations

from html.parser import HTMLParser
from pathlib import Path

import pandas as pd
import pytest

from sfkit.analysis import ComparedColumn, publish_table, score_grid, score_rows, shown_table
from sfkit.analysis.headed import with_means

COLUMNS = (
    ComparedColumn("eth3d", "openstereo", "bad-1.0", "%", validation=True),
    ComparedColumn("kitti2015", "openstereo", "d1", "%", validation=False),
    ComparedColumn("far", "all-valid", "epe", "px", validation=False),
)


def table() -> pd.DataFrame:
    values = {
        COLUMNS[0].label: [2.0, 1.004, 1.0],
        COLUMNS[1].label: [7.0, -3.0, 5.0],
        "note": ["<i>", "b", None],
        "images": [1200, 8, 3],
    }
    return pd.DataFrame(values, index=pd.Index(["base", "a & b", "c"], name="method"))


class Tags(HTMLParser):
    """What stands in which element, with its class."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.open: list[tuple[str, str]] = []
        self.found: list[tuple[str, str, str]] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.open.append((tag, dict(attrs).get("class") or ""))

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop()[0] == tag, "elements close in order"

    def handle_data(self, data: str) -> None:
        if data.strip():
            self.found.append((*self.open[-1], data.strip()))


class Cells(HTMLParser):
    """Every line of the table, a cell that spans several written into each of them."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.lines: list[dict[int, str]] = []
        self.row, self.place = -1, (0, 0, 0, 0)
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = dict(attrs)
        if tag == "tr":
            self.row += 1
        if tag in ("th", "td"):
            down, across = (int(values.get(name) or 1) for name in ("rowspan", "colspan"))
            while len(self.lines) < self.row + down:
                self.lines.append({})
            first = next(n for n in range(100) if n not in self.lines[self.row])
            self.place = (self.row, down, first, across)
            self.write("")

    def handle_data(self, data: str) -> None:
        if self.row >= 0 and data.strip() and self.lasttag in ("th", "td", "b", "u"):
            self.write(data.strip())

    def write(self, text: str) -> None:
        row, down, first, across = self.place
        for line in self.lines[row : row + down]:
            line.update(dict.fromkeys(range(first, first + across), text))

    def grid(self) -> list[list[str]]:
        return [[line[n] for n in sorted(line)] for line in self.lines]


def test_a_benchmark_stands_over_its_metric_once_and_cells_are_those_of_the_frame() -> None:
    html = shown_table(table(), COLUMNS, caption="All & more", note="below")._repr_html_()
    assert Cells(html.partition("<details>")[0]).grid() == [
        ["method", "eth3d *", "kitti2015", "note", "images"],
        ["method", "bad-1.0 (%)", "D1 (%)", "note", "images"],
        ["base", "2.00", "7.00", "<i>", "1,200"],
        ["a & b", "1.00", "−3.00", "b", "8"],
        ["c", "1.00", "5.00", "–", "3"],
    ]
    found = Tags(html).found
    assert ("caption", "", "All & more") in found
    assert ("p", "note", "below") in found
    assert ("td", "text", "<i>") in found, "text of a cell is text"
    assert ("td", "", "1,200") in found
    assert ("td", "text", "–") in found


def test_best_is_bold_by_what_is_printed_and_second_underlined() -> None:
    found = Tags(shown_table(table(), COLUMNS)._repr_html_()).found
    marked = [(tag, text) for tag, _, text in found if tag in ("b", "u")]
    assert marked == [("u", "2.00"), ("b", "1.00"), ("b", "−3.00"), ("b", "1.00"), ("u", "5.00")]
    guided = [text for tag, kind, text in found if tag in ("th", "td") and "guided" in kind]
    assert guided == ["eth3d *", "bad-1.0 (%)"], "marked numbers stand in an element of their own"


@pytest.mark.parametrize(("name", "metric"), [("guided by", ""), ("fitness", " d1"), ("method", "")])
def test_of_rows_with_guides_of_their_own_the_guides_cell_is_tinted(name: str, metric: str) -> None:
    rows = pd.Index([f"far{metric}", f"kitti2015{metric}"], name=name)
    guides = pd.DataFrame({"kitti2015": [1.0, 2.0], "far": [3.0, 4.0]}, index=rows)
    found = Tags(shown_table(guides, COLUMNS, best=[])._repr_html_()).found
    tinted = [text for tag, kind, text in found if "guided" in kind]
    assert tinted == ([] if name == "method" else ["3.00", "2.00"])


def test_along_a_row_and_without_an_index() -> None:
    plain = pd.DataFrame({"a": [1.0, 4.0], "b": [2.0, 3.0]})
    html = shown_table(plain, along="row", best=["a", "b"])._repr_html_()
    assert [(tag, text) for tag, _, text in Tags(html).found if tag in ("b", "u")] == [
        *(("b", "1.00"), ("u", "2.00"), ("u", "4.00"), ("b", "3.00"))
    ]
    assert Cells(html.partition("<details>")[0]).grid()[0] == ["a", "b"], "no column of row numbers"


def test_the_latex_has_the_same_marks(tmp_path: Path) -> None:
    shown = publish_table(table(), "all", "All", COLUMNS, folder=tmp_path)
    assert r"eth3d * bad-1.0 (\%)" in shown.latex
    assert r"a \& b & \textbf{1.00} & \textbf{-3.00}" in shown.latex
    assert (tmp_path / "all.tex").is_file()
    assert pd.read_csv(tmp_path / "all.csv")[COLUMNS[1].label].tolist() == [7.0, -3.0, 5.0]


def test_means_need_one_unit() -> None:
    scores = pd.DataFrame({"eth3d": [1.0], "kitti2015": [4.0], "far": [9.0]})
    found = with_means(scores, COLUMNS, ["kitti2015"])
    assert found["mean"].isna().all(), "percent and pixels have no mean"
    assert found["mean of the unseen"].tolist() == [4.0]
    both = with_means(scores, COLUMNS[:2], ["kitti2015"])
    assert both["mean"].tolist() == [2.5]


def test_a_table_becomes_a_grid_to_draw() -> None:
    grid = score_grid(score_rows(table(), COLUMNS))
    assert grid.networks == ("base", "a & b", "c")
    assert [(c.benchmark, c.metric, c.validation) for c in grid.columns] == [
        ("eth3d", "bad-1.0", True),
        ("kitti2015", "d1", False),
    ]
    assert grid.values[:, 1].tolist() == pytest.approx([7.0, -3.0, 5.0])
