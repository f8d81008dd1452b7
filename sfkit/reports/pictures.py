"""Figures of an executed notebook as SVG or PNG files, drawn by an installed Chromium without a network."""

from __future__ import annotations

import base64
import binascii
import html
import json
import os
import re
import subprocess
import tempfile
import urllib.parse
from collections.abc import Iterator
from importlib import resources
from pathlib import Path
from typing import Any

from nbformat import NotebookNode
from plotly.offline import get_plotlyjs

from sfkit.errors import SfkitError
from sfkit.files import write_bytes
from sfkit.reports.browsers import KINDS, check_pictures
from sfkit.reports.page import PLOTLY_MIME

WIDTH = 1000
"""Width of a picture in CSS pixels; a PNG has twice as many."""
FLAGS = (
    "--headless",
    "--disable-gpu",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    # The DOM is printed when the scripts have run, not when the page has loaded.
    "--virtual-time-budget=120000",
)
SECONDS = 300
"""How long Chromium may take for all pictures together."""

PAGE = """<!doctype html>
<meta charset="utf-8">
<title>pictures</title>
<script>{plotly}</script>
<script type="application/json" id="figures">{figures}</script>
<body>
<script>{script}</script>
"""


def write_pictures(notebook: NotebookNode, folder: Path, kind: str) -> tuple[Path, ...]:
    """Write every plotly figure of an executed notebook as ``NUMBER-CELL.svg`` (or ``.png``) into ``folder``.

    They have a light background, whatever page the figure was made for, and are 1000 pixels wide and as high
    as the figure (PNG: twice that many). Pictures of an earlier run in the folder are removed.

    Raises:
        InputError: as :func:`check_pictures`.
        SfkitError: Chromium failed, or drew fewer figures than there are.
    """
    browser = check_pictures(kind)
    names: list[str] = []
    figures: list[dict[str, Any]] = []
    for cell, figure in plotly_figures(notebook):
        names.append(f"{len(names) + 1:02d}-{re.sub(r'[^A-Za-z0-9_-]+', '-', cell)}.{kind}")
        figures.append(figure)
    folder.mkdir(parents=True, exist_ok=True)
    # Pictures of an earlier run would pass for this one's.
    for old in [path for ending in KINDS for path in folder.glob(f"[0-9][0-9]-*.{ending}")]:
        old.unlink()
    if not figures:
        return ()
    paths = []
    for name, content in zip(names, _drawn(browser, figures, kind), strict=True):
        path = folder / name
        write_bytes(path, content)
        paths.append(path)
    return tuple(paths)


def plotly_figures(notebook: NotebookNode) -> Iterator[tuple[str, dict[str, Any]]]:
    """(id of the cell, figure) of every plotly figure, in order."""
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            figure = output.get("data", {}).get(PLOTLY_MIME)
            if figure is not None:
                yield str(cell.get("id", "figure")), dict(figure)


def _drawn(browser: Path, figures: list[dict[str, Any]], kind: str) -> list[bytes]:
    """All pictures from one start of Chromium, which prints the page's DOM when its scripts are done."""
    script = resources.files("sfkit.reports").joinpath("pictures.js").read_text(encoding="utf-8")
    parts = [{"data": f.get("data", []), "layout": f.get("layout", {})} for f in figures]
    # A label with </script> in it would end the element that holds it.
    text = json.dumps({"kind": kind, "width": WIDTH, "figures": parts}).replace("<", "\\u003c")
    # Chromium does not start with its sandbox as root, which notebooks in a container often are.
    flags = [*FLAGS, *(["--no-sandbox"] if hasattr(os, "geteuid") and os.geteuid() == 0 else [])]
    with tempfile.TemporaryDirectory(prefix="sfkit-pictures-") as scratch:
        page = Path(scratch) / "page.html"
        page.write_text(PAGE.format(plotly=get_plotlyjs(), figures=text, script=script), encoding="utf-8")
        # What is drawn comes back as text of the page.
        command = [str(browser), *flags, f"--user-data-dir={scratch}/profile", "--dump-dom", page.as_uri()]
        try:
            done = subprocess.run(command, capture_output=True, timeout=SECONDS, check=False)
        except (OSError, subprocess.TimeoutExpired) as error:
            raise SfkitError(f"figures: {browser} did not draw them ({error})") from error
    dom = done.stdout.decode("utf-8", "replace")
    if found := re.search(r'<pre id="failure">(.*?)</pre>', dom, re.DOTALL):
        raise SfkitError(f"figures: {browser} could not draw one of them ({html.unescape(found[1])})")
    pictures = [_content(html.unescape(uri)) for uri in re.findall(r'<pre class="picture">(.*?)</pre>', dom)]
    if len(pictures) != len(figures):
        lines = done.stderr.decode("utf-8", "replace").strip().splitlines()[-1:] or ["no message"]
        count = f"{len(pictures)} of {len(figures)}"
        raise SfkitError(f"figures: {browser} drew {count} (exit code {done.returncode}: {lines[0]})")
    return pictures


def _content(uri: str) -> bytes:
    """The bytes of a data URI."""
    head, _, body = uri.partition(",")
    if not head.endswith(";base64"):
        return urllib.parse.unquote_to_bytes(body)
    try:
        return base64.b64decode(body, validate=True)
    except binascii.Error as error:
        raise SfkitError(f"figures: found a picture that is no base64 ({error})") from error
