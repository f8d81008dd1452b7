"""One HTML page from an executed notebook: no request leaves it, and it reads in light and in dark."""

from __future__ import annotations

import copy
import html
import json
import logging
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from importlib import metadata, resources
from typing import Any

from nbconvert import HTMLExporter
from nbconvert.preprocessors import CoalesceStreamsPreprocessor
from nbformat import NotebookNode
from papermill.execute import ERROR_MARKER_TAG
from plotly.offline import get_plotlyjs
from pygments.formatters import HtmlFormatter

from sfkit.reports.widgets import STILL, VIEW_MIME, SavedWidgets

PLOTLY_MIME = "application/vnd.plotly.v1+json"

# Whatever a notebook puts in, the page asks no one for anything, and runs its own scripts alone, with what
# these import: they carry a number that nothing in the notebook can know. plotly draws some traces with code
# that it compiles on the spot, hence unsafe-eval.
CONTENT_POLICY = (
    "default-src 'none'; base-uri 'none'; form-action 'none'; img-src data: blob:; font-src data:; "
    "media-src data:; frame-src data:; style-src 'unsafe-inline'; "
    "script-src 'nonce-{nonce}' 'unsafe-eval'; worker-src blob:"
)

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<meta http-equiv="Content-Security-Policy" content="{policy}">
<link rel="icon" href="data:,">
<title>{title}</title>
<style>{style}</style>
</head>
<body>
<header>
{summary}
<label><input type="checkbox" id="show-code"> Show code</label>
</header>
<main>
{body}
</main>
{drawing}
</body>
</html>
"""


@dataclass(frozen=True)
class Failure:
    """Why a run ended early.

    Attributes:
        cell: position among all cells of the executed notebook; None where no cell had started.
        error: kind and message.
    """

    cell: int | None
    error: str


@dataclass(frozen=True)
class NotebookRun:
    """What the page says above the notebook.

    Attributes:
        notebook: file name.
        started: when, with time zone.
        seconds: how long it took.
        parameters: the values that were given.
        failure: None where all cells ran.
    """

    notebook: str
    started: datetime
    seconds: float
    parameters: Mapping[str, Any]
    failure: Failure | None


def render_page(notebook: NotebookNode, run: NotebookRun) -> str:
    """The whole page as text.

    Code is hidden until the reader asks for it, but for the cell that failed. Figures stay plotly figures,
    drawn by one copy of plotly.js inside the page (about 5 MB, left out where there is no figure). Widgets
    show their last state.
    """
    shown = copy.deepcopy(notebook)
    shown.cells = [cell for cell in shown.cells if ERROR_MARKER_TAG not in cell.metadata.get("tags", [])]
    failed = shown.cells[run.failure.cell] if run.failure and run.failure.cell is not None else None
    if failed is not None:
        failed.metadata["tags"] = [*failed.metadata.get("tags", []), "failed"]
    outputs = [output for cell in shown.cells for output in cell.get("outputs", [])]
    widgets = SavedWidgets(shown)
    figures = [_as_markup(output.data, widgets) for output in outputs if "data" in output]
    shown.metadata.pop("widgets", None)
    body, _ = _exporter().from_notebook_node(shown)
    files = resources.files("sfkit.reports")
    drawing = [get_plotlyjs(), files.joinpath("page.js").read_text(encoding="utf-8")] if any(figures) else []
    nonce = secrets.token_hex(16)
    scripts = [f'<script nonce="{nonce}">{script}</script>' for script in (*drawing, *widgets.scripts())]
    return PAGE.format(
        policy=CONTENT_POLICY.format(nonce=nonce),
        title=html.escape(_title(shown, run)),
        style=_code_style() + files.joinpath("page.css").read_text(encoding="utf-8"),
        summary=_summary(run, failed),
        body=body,
        drawing="\n".join([widgets.state(), *scripts]),
    )


def _exporter() -> HTMLExporter:
    """The notebook's cells alone, without the page around them that loads half the web."""
    exporter = HTMLExporter(template_name="basic", embed_images=True)
    exporter.register_preprocessor(CoalesceStreamsPreprocessor, enabled=True)  # a loop's lines are one text
    exporter.log.setLevel(logging.ERROR)  # missing descriptions of images are the notebook's business
    return exporter


def _as_markup(data: NotebookNode, widgets: SavedWidgets) -> bool:
    """Replace what only a running Jupyter can show; True where the output is a figure."""
    if PLOTLY_MIME in data:
        figure = {
            key: data[PLOTLY_MIME][key] for key in ("data", "layout", "frames") if key in data[PLOTLY_MIME]
        }
        # Inside a script element only "<" could end it.
        text = json.dumps(figure).replace("<", "\\u003c")
        data.clear()
        data["text/html"] = (
            f'<div class="figure"><script type="application/json">{text}</script>'
            '<div class="plot"></div></div>'
        )
        return True
    if str(data.get("text/html", "")).startswith(STILL) and widgets.placed:
        data.clear()  # the widget itself is drawn
        data["text/html"] = ""
    if VIEW_MIME in data:
        if markup := widgets.markup(data[VIEW_MIME]):
            data.clear()
            data["text/html"] = markup
        elif len(data) > 1:
            data.pop(VIEW_MIME)
    return False


def _title(notebook: NotebookNode, run: NotebookRun) -> str:
    """The notebook's first heading, else its file name."""
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            for line in cell.source.splitlines():
                if line.startswith("# "):
                    return str(line[2:].strip())
    return run.notebook


def _summary(run: NotebookRun, failed: NotebookNode | None) -> str:
    when = run.started.strftime("%Y-%m-%d %H:%M %Z")
    done = "failed after" if run.failure else "finished in"
    lines = [
        f"<p>{html.escape(run.notebook)}, {html.escape(when)}: {done} {run.seconds:.0f} s, "
        f"with sfkit {html.escape(metadata.version('sfkit'))}.</p>"
    ]
    if run.failure:
        where = (
            f' <a href="#cell-id={html.escape(failed.id)}">Go to the cell.</a>' if failed is not None else ""
        )
        lines.append(
            f'<p role="alert" class="failure"><strong>This run failed.</strong> '
            f"{html.escape(run.failure.error)}.{where} Cells below it did not run.</p>"
        )
    if run.parameters:
        rows = "".join(
            f"<tr><th scope='row'>{html.escape(name)}</th><td>{html.escape(repr(value))}</td></tr>"
            for name, value in run.parameters.items()
        )
        lines.append(f"<table><caption>Parameters given</caption><tbody>{rows}</tbody></table>")
    return "\n".join(lines)


def _code_style() -> str:
    """Colours of code, for both schemes."""
    light = HtmlFormatter(style="default").get_style_defs(".highlight")
    dark = HtmlFormatter(style="github-dark").get_style_defs(".highlight")
    return f"{light}\n@media (prefers-color-scheme: dark) {{\n{dark}\n}}\n"
