"""Figures as files of their own, drawn by a real Chromium; and the sentences where that cannot be."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from pathlib import Path

import cv2
import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_notebook, new_output

from sfkit import InputError, SfkitError
from sfkit.reports import report
from sfkit.reports.page import PLOTLY_MIME
from sfkit.reports.pictures import write_pictures

LINE = {
    "data": [{"type": "scatter", "y": [1, 3, 2], "line": {"color": "#ff0000"}}],
    "layout": {"title": {"text": "Rise </script> & fall"}, "height": 300, "paper_bgcolor": "#000000"},
}
HEAT = {"data": [{"type": "heatmap", "z": [[1, 2], [3, 4]]}], "layout": {"font": {"color": "#fefefe"}}}


def executed(*figures: dict[str, object]) -> nbformat.NotebookNode:
    cells = []
    for number, figure in enumerate(figures):
        cell = new_code_cell("draw()", id=f"part-{number}")
        cell.outputs = [new_output("display_data", data={PLOTLY_MIME: figure})]
        cells += [new_code_cell("nothing()"), cell]
    return new_notebook(cells=cells)


@pytest.mark.browser
@pytest.mark.usefixtures("chromium")
def test_pictures_are_drawn_on_paper_and_named_after_their_cells(tmp_path: Path) -> None:
    (tmp_path / "03-gone.png").touch()
    (tmp_path / "mine.svg").touch()
    drawn = write_pictures(executed(LINE, HEAT), tmp_path, "svg")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["01-part-0.svg", "02-part-1.svg", "mine.svg"]
    line, heat = (ElementTree.fromstring(path.read_text(encoding="utf-8")) for path in drawn)
    assert (line.get("width"), line.get("height")) == ("1000", "300")
    assert "Rise </script> & fall" in "".join(line.itertext())
    text = drawn[0].read_text(encoding="utf-8") + drawn[1].read_text(encoding="utf-8")
    assert "rgb(255, 0, 0)" in text
    assert "#fefefe" not in text
    assert "rgb(254, 254, 254)" not in text
    assert heat.find(".//{http://www.w3.org/2000/svg}image") is not None
    links = [v for node in (*line.iter(), *heat.iter()) for k, v in node.attrib.items() if k.endswith("href")]
    assert all(link.startswith(("data:", "#")) for link in links), "a picture that asks the web for parts"


@pytest.mark.browser
@pytest.mark.usefixtures("chromium")
def test_a_png_has_twice_the_pixels(tmp_path: Path) -> None:
    (path,) = write_pictures(executed(LINE), tmp_path, "png")
    picture = cv2.imread(str(path))
    assert picture is not None
    assert picture.shape == (600, 2000, 3)
    assert picture[5, 5].tolist() == [255, 255, 255]
    assert ((picture == (0, 0, 255)).all(axis=2)).sum() > 100


@pytest.mark.browser
@pytest.mark.usefixtures("chromium")
def test_a_report_writes_them_into_a_folder_beside_it(tmp_path: Path) -> None:
    source = tmp_path / "line.ipynb"
    cell = "import plotly.graph_objects as go\ngo.Figure(go.Scatter(y=[1, 2]), layout_title_text='Up?')"
    nbformat.write(new_notebook(cells=[new_code_cell(cell, id="up")]), source)
    report(source, {}, tmp_path / "out.html", figures="svg")
    assert [path.name for path in (tmp_path / "out_figures").iterdir()] == ["01-up.svg"]


def test_without_a_figure_no_browser_is_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    fake = tmp_path / "chromium"
    fake.write_text("#!/bin/sh\nexit 3\n")
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert write_pictures(executed(), tmp_path / "out", "svg") == ()
    with pytest.raises(SfkitError, match=r"drew 0 of 1 \(exit code 3: no message\)"):
        write_pictures(executed(LINE), tmp_path / "out", "svg")


def test_without_chromium_nothing_is_run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    source = tmp_path / "line.ipynb"
    nbformat.write(new_notebook(cells=[new_code_cell("1")]), source)
    monkeypatch.setenv("PATH", str(tmp_path))
    with pytest.raises(
        InputError, match=r"found no Chromium to draw PNG files with.*the HTML file holds every"
    ):
        report(source, {}, tmp_path / "out.html", figures="png")
    with pytest.raises(InputError, match="figures: found 'pdf', expected svg or png"):
        report(source, {}, tmp_path / "out.html", figures="pdf")
    assert list(tmp_path.iterdir()) == [source]
