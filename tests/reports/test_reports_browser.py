"""A report in a real browser without a network: everything is there, and nothing is asked for."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import nbformat
import pytest
from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook

from sfkit.reports import ReportError, report

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

pytestmark = pytest.mark.browser

FIGURE = """
import plotly.graph_objects as go
heat = go.Figure(go.Heatmap(z=[[1, 2], [3, 4]]), layout={"paper_bgcolor": "white", "font_color": "black"})
heat.update_layout(title_text="</script><b>Heat</b>", template="plotly_white")
heat.show()
go.Figure(go.Scatter(y=[1, 3, 2]), layout_title_text="Line")
"""
IMAGE = """
import cv2, numpy as np
from IPython.display import Image
Image(cv2.imencode(".png", np.full((30, 50, 3), 128, np.uint8))[1].tobytes())
"""
TABLE = "import pandas as pd\npd.DataFrame({'error': [1.5], 'name': ['<img src=http://example.org/x.png>']})"
WEB = "![remote](http://example.org/remote.png)"


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """One report of a notebook that runs through, one of a notebook that fails."""
    folder = tmp_path_factory.mktemp("reports")
    cells = [new_markdown_cell("# Sample"), *map(new_code_cell, (FIGURE, IMAGE, TABLE))]
    nbformat.write(new_notebook(cells=cells), folder / "good.ipynb")
    nbformat.write(
        new_notebook(cells=[*cells[:2], new_code_cell("lost = 1 / 0"), new_code_cell("'after'")]),
        folder / "bad.ipynb",
    )
    good = report(folder / "good.ipynb", {}, folder / "ran.html")
    bad = folder / "failed.html"
    with pytest.raises(ReportError):
        report(folder / "bad.ipynb", {}, bad)
    return {"good": good, "bad": bad}


@pytest.fixture(scope="module", params=["light", "dark"])
def pages(
    request: pytest.FixtureRequest, browser: Browser, reports: dict[str, Path]
) -> Iterator[dict[str, Page]]:
    """The reports, open and drawn without a network; by the end they were quiet and asked for nothing."""
    context = browser.new_context(
        offline=True, color_scheme=request.param, viewport={"width": 1000, "height": 800}
    )
    noise: list[str] = []
    requests: list[str] = []
    opened = {}
    for name, path in reports.items():
        page = context.new_page()
        page.on("console", lambda message: noise.append(f"{message.type}: {message.text}"))
        page.on("pageerror", lambda error: noise.append(str(error)))
        page.on("request", lambda request: requests.append(request.url))
        page.goto(path.as_uri())
        page.wait_for_function(
            """[...document.querySelectorAll(".plot")].every((plot) => plot.querySelector(".gtitle")
                && plot.querySelector(".heatmaplayer image, .scatterlayer path.js-line"))"""
        )
        opened[name] = page
    yield opened
    context.close()
    assert noise == []
    asked = [url for url in requests if not url.startswith(("data:", "blob:"))]
    assert asked == [path.as_uri() for path in reports.values()]


def luminance(colour: str) -> float:
    """Relative luminance (WCAG 2) of a CSS ``rgb(r, g, b)``."""
    channels = [int(value) / 255 for value in re.findall(r"\d+", colour)[:3]]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in channels]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


def contrast(first: str, second: str) -> float:
    """Contrast ratio of two CSS colours, 1 to 21 (WCAG 2)."""
    low, high = sorted((luminance(first), luminance(second)))
    return (high + 0.05) / (low + 0.05)


def test_figures_image_and_table_are_there(pages: dict[str, Page]) -> None:
    page = pages["good"]
    assert page.locator(".plot svg.main-svg .scatterlayer path.js-line").count() == 1
    assert page.locator(".plot svg.main-svg .heatmaplayer image").count() == 1
    titles = page.locator(".plot .gtitle").all_text_contents()
    assert titles == ["</script>Heat", "Line"]
    image = page.locator("main img")
    assert image.count() == 1, "the table's text is no picture"
    assert image.evaluate("i => [i.naturalWidth, i.naturalHeight]") == [50, 30]
    assert page.locator("table.dataframe td").all_inner_texts() == [
        "1.5",
        "<img src=http://example.org/x.png>",
    ]


def test_a_report_with_figures_takes_about_five_megabytes(reports: dict[str, Path]) -> None:
    assert 4_000_000 < reports["good"].stat().st_size < 6_000_000


def test_figures_and_text_can_be_read_in_both_schemes(pages: dict[str, Page]) -> None:
    page = pages["good"]
    fill = "e => getComputedStyle(e).fill"
    for figure in page.locator(".plot").all():
        paper = figure.locator("svg.main-svg").first.evaluate("e => getComputedStyle(e).backgroundColor")
        for text in figure.locator(".gtitle, .xtick text, .ytick text").all():
            assert contrast(text.evaluate(fill), paper) >= 4.5
    ink, paper = page.evaluate("(s => [s.color, s.backgroundColor])(getComputedStyle(document.body))")
    assert contrast(ink, paper) >= 7


def test_code_shows_on_request(pages: dict[str, Page]) -> None:
    page = pages["good"]
    code = page.locator(".code_cell .input").first
    assert not code.is_visible()
    page.get_by_label("Show code").check()
    code.wait_for()


def test_the_failing_cell_is_in_view_and_linked(pages: dict[str, Page]) -> None:
    page = pages["bad"]
    alert = page.get_by_role("alert")
    assert "ZeroDivisionError: division by zero" in alert.inner_text()
    target = alert.get_by_role("link").get_attribute("href")
    assert target is not None
    failing = page.locator(".celltag_failed")
    assert failing.get_attribute("id") == target.removeprefix("#")
    assert failing.locator(".input").is_visible(), "its code is shown unasked"
    assert "lost = 1 / 0" in failing.locator(".input").inner_text()
    assert "ZeroDivisionError" in failing.locator(".output_error").inner_text()
    assert page.locator(".plot svg.main-svg").count() > 0, "what ran before is still drawn"
