"""Pictures of benchmarks: plotly figures as small PNG files beside the README that shows them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import plotly.graph_objects as go
from playwright.sync_api import sync_playwright
from processes import chromium

from sfkit.figures.theme import finish, series_style

IMAGES = Path(__file__).parent / "images"
WIDTH = 900


def lines(
    curves: Mapping[str, tuple[Sequence[float], Sequence[float]]],
    *,
    title: str,
    subtitle: str,
    x: str,
    y: str,
    logarithmic: bool = False,
) -> go.Figure:
    """A line a name, from its (x, y) values; ``logarithmic`` is about the x axis."""
    figure = go.Figure()
    for number, (name, (across, up)) in enumerate(curves.items()):
        style = series_style(number)
        figure.add_scatter(x=list(across), y=list(up), name=name, mode="lines", line=style)
    figure.update_xaxes(title_text=x, type="log" if logarithmic else "linear")
    figure.update_yaxes(title_text=y, rangemode="tozero")
    return finish(figure, theme="light", title=title, subtitle=subtitle, height=460, width=WIDTH)


def bars(values: Mapping[str, Mapping[str, float]], *, title: str, subtitle: str, x: str) -> go.Figure:
    """Horizontal bars: label -> series -> value."""
    series = list(dict.fromkeys(name for row in values.values() for name in row))
    figure = go.Figure()
    for number, name in enumerate(series):
        figure.add_bar(
            y=list(values),
            x=[row.get(name) for row in values.values()],
            name=name,
            orientation="h",
            marker={"color": series_style(number)["color"]},
            texttemplate="%{x:.2f}",
            textposition="outside",
            cliponaxis=False,
        )
    figure.update_xaxes(title_text=x)
    figure.update_yaxes(autorange="reversed")
    height = 190 + 24 * len(values) * max(1, len(series))
    return finish(figure, theme="light", title=title, subtitle=subtitle, height=height, width=WIDTH)


def picture(figure: go.Figure, name: str, alt: str) -> str:
    """Write ``images/NAME.png``, drawn by Chromium, and return the Markdown that shows it."""
    IMAGES.mkdir(exist_ok=True)
    figure.update_layout(paper_bgcolor="#ffffff", plot_bgcolor="#ffffff")
    page_text = figure.to_html(include_plotlyjs=True, config={"displayModeBar": False, "staticPlot": True})
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=chromium(), args=["--no-sandbox", "--disable-gpu"]
        )
        page = browser.new_page(viewport={"width": WIDTH + 20, "height": int(figure.layout.height) + 20})
        page.set_default_timeout(180_000)  # milliseconds; a busy machine is slow to draw
        page.set_content(page_text)
        page.wait_for_selector(".main-svg")
        page.locator(".plot-container").first.screenshot(path=str(IMAGES / f"{name}.png"))
        browser.close()
    return f"![{alt}](images/{name}.png)"
