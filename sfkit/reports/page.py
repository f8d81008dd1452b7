"""One HTML page from an executed notebook: no request leaves it, and it reads in light and in dark.

It reads as a document: the answer is its title, a box says what that rests on, then the notebook's chapters;
parameters, versions and how to make it again stand at the end.
"""

from __future__ import annotations

import copy
import json
import logging
import re
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from datetime import datetime
from html import unescape
from importlib import metadata, resources
from typing import Any

from nbconvert import HTMLExporter
from nbconvert.preprocessors import CoalesceStreamsPreprocessor
from nbformat import NotebookNode
from papermill.execute import ERROR_MARKER_TAG
from plotly.offline import get_plotlyjs
from pygments.formatters import HtmlFormatter

from sfkit.reports.conclusion import Conclusion, take_conclusion
from sfkit.reports.text import escaped
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

CHAPTER = re.compile(r'<h2 id="([^"]+)">(.*?)(?=<a class="anchor-link"|</h2>)', re.DOTALL)
ENDING = ("how-this-page-was-made", "How this page was made")
PARAMETER_TAGS = {"parameters", "injected-parameters"}

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
{opening}
</header>
<main>
{body}
</main>
<footer>
{ending}
</footer>
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
    # A copy: what the page leaves out stays in the notebook that is kept.
    shown = copy.deepcopy(notebook)
    shown.cells = [cell for cell in shown.cells if ERROR_MARKER_TAG not in cell.metadata.get("tags", [])]
    # Counted without the cells that papermill put in, which are gone by now.
    failed = shown.cells[run.failure.cell] if run.failure and run.failure.cell is not None else None
    if failed is not None:
        failed.metadata["tags"] = [*failed.metadata.get("tags", []), "failed"]
    outputs = [output for cell in shown.cells for output in cell.get("outputs", [])]
    widgets = SavedWidgets(shown)
    figures = [_as_markup(output.data, widgets) for output in outputs if "data" in output]
    shown.metadata.pop("widgets", None)
    name, conclusion = _take_title(shown) or run.notebook, take_conclusion(shown)
    shown.cells = _parameters_last(shown.cells)
    body, _ = _exporter().from_notebook_node(shown)
    files = resources.files("sfkit.reports")
    drawing = [get_plotlyjs(), files.joinpath("page.js").read_text(encoding="utf-8")] if any(figures) else []
    # Drawn anew for each page, so that no script but its own runs.
    nonce = secrets.token_hex(16)
    scripts = [f'<script nonce="{nonce}">{script}</script>' for script in (*drawing, *widgets.scripts())]
    return PAGE.format(
        policy=CONTENT_POLICY.format(nonce=nonce),
        title=escaped(conclusion.title if conclusion else name),
        style=_code_style() + files.joinpath("page.css").read_text(encoding="utf-8"),
        opening=_opening(name, conclusion, run, failed) + _contents(body),
        body=body,
        ending=_ending(run),
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


def _take_title(notebook: NotebookNode) -> str | None:
    """The notebook's first heading, which leaves its cell; None where there is none."""
    for cell in notebook.cells:
        if cell.cell_type == "markdown":
            lines = cell.source.splitlines()
            for number, line in enumerate(lines):
                if line.startswith("# "):
                    cell.source = "\n".join(lines[:number] + lines[number + 1 :])
                    return str(line[2:].strip())
    return None


def _parameters_last(cells: list[NotebookNode]) -> list[NotebookNode]:
    """The cells, those that hold the parameters and the prose right above them behind all others."""
    places = [n for n, cell in enumerate(cells) if PARAMETER_TAGS & set(cell.metadata.get("tags", []))]
    if places and places[0] > 1 and cells[places[0] - 1].cell_type == "markdown":
        places.insert(0, places[0] - 1)
    moved = [cells[n] for n in places]
    return [cell for n, cell in enumerate(cells) if n not in places] + moved


def _opening(name: str, conclusion: Conclusion | None, run: NotebookRun, failed: NotebookNode | None) -> str:
    """The answer and what it rests on; the notebook's own title where it has none."""
    lines = [f"<h1>{escaped(name)}</h1>"]
    if conclusion is not None:
        points = "".join(f"<li>{escaped(sentence)}</li>" for sentence in conclusion.sentences)
        lines = [f'<p class="question">{escaped(name)}</p>', f"<h1>{escaped(conclusion.title)}</h1>"]
        lines += [f'<section class="verdict" aria-label="In short"><ul>{points}</ul></section>'] * bool(
            points
        )
    if run.failure:
        where = f' <a href="#cell-id={escaped(failed.id)}">Go to the cell.</a>' if failed is not None else ""
        lines.append(
            f'<p role="alert" class="failure"><strong>This run failed.</strong> '
            f"{escaped(run.failure.error)}.{where} Cells below it did not run.</p>"
        )
    return "\n".join(lines)


def _contents(body: str) -> str:
    """Links to the chapters, where there are several."""
    found = [(i, unescape(re.sub(r"<[^>]*>", "", text))) for i, text in CHAPTER.findall(body)]
    links = "".join(f'<li><a href="#{i}">{escaped(text)}</a></li>' for i, text in [*found, ENDING])
    contents = f'<nav aria-label="Contents"><ol>{links}</ol></nav>' if len(found) > 1 else ""
    return f'\n{contents}\n<label><input type="checkbox" id="show-code"> Show code</label>'


def _ending(run: NotebookRun) -> str:
    """Where the page comes from."""
    done = "failed after" if run.failure else "finished in"
    lines = [
        f'<h2 id="{ENDING[0]}">{ENDING[1]}</h2>',
        f"<p>Notebook {escaped(run.notebook)}, {escaped(run.started.strftime('%Y-%m-%d %H:%M %Z'))}: {done} "
        f"{run.seconds:.0f} s, with sfkit {escaped(metadata.version('sfkit'))}.</p>",
    ]
    if run.parameters:
        rows = "".join(
            f"<tr><th scope='row'>{escaped(name)}</th><td>{escaped(repr(value))}</td></tr>"
            for name, value in run.parameters.items()
        )
        lines.append(
            '<div class="scroll"><table><caption>Parameters given</caption>'
            f"<tbody>{rows}</tbody></table></div>"
        )
    return "\n".join(lines)


def _code_style() -> str:
    """Colours of code, for both schemes."""
    light = HtmlFormatter(style="default").get_style_defs(".highlight")
    dark = HtmlFormatter(style="github-dark").get_style_defs(".highlight")
    return f"{light}\n@media (prefers-color-scheme: dark) {{\n{dark}\n}}\n"
