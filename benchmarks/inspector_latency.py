"""How soon an edit in the RoutingInspector shows: from a key or a drag in JupyterLab to changed pixels.

    python benchmarks/inspector_latency.py [--edits 40] [--json]

A notebook in JupyterLab, in headless Chromium on this machine, with the kernel it starts. An edit is a key
press that changes a routing weight; the clock runs from the browser's time stamp of the key to the second
frame after the disparity picture was exchanged. ``first`` is the first new picture (at reduced size where the
network is slow), ``full`` the last one. Bytes are those of all messages the page receives, edits divided out.
The real AnyNet pool is measured where SFKIT_REAL_DATA names its folder.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from playwright.sync_api import Browser, sync_playwright
from processes import answered, chromium, shown
from real_pairs import DATA, POOL
from tabulated import numbers

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "browser"))

from browser_lab import Notebook, Server, serving

DOCUMENT = "benchmarks/README.md"
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking")

BANK = """
import sfkit
from sfkit_widgets import RoutingInspector
pool = sfkit.open_pool("bank")
scorer = sfkit.Evaluator(pool, sfkit.open_benchmark("bank:courtyard", pairs=2))
"""
REAL = """
import os, sfkit
from pathlib import Path
from sfkit_widgets import RoutingInspector
pool = sfkit.open_pool({pool!r})
pairs = Path(os.environ["SFKIT_REAL_DATA"]) / "pairs" / "motorcycle"
scorer = sfkit.Evaluator(pool, sfkit.open_benchmark("pairs", pairs, metric="bad-3.0"))
"""
SHOW = "inspector = RoutingInspector(scorer, tied=False)\ninspector"

WATCH = """() => {
    const root = document.querySelector(".sfkit-inspector");
    const picture = [...root.querySelectorAll("figure")].find((f) => f.innerText.startsWith("disparity"));
    const log = { pressed: 0, shown: [] };
    window.latency = log;
    root.addEventListener("keydown", (event) => {
        if ("+-".includes(event.key)) Object.assign(log, { pressed: event.timeStamp, shown: [] });
    }, true);
    new MutationObserver(() => requestAnimationFrame(() => requestAnimationFrame(
        () => log.shown.push([performance.now() - log.pressed, picture.innerText.includes(" size)")])
    ))).observe(picture.querySelector("img"), { attributeFilter: ["src"] });
}"""
PAINTED = """() => {
    const { sent, acknowledged } = document.querySelector(".sfkit-inspector").dataset;
    return sent === acknowledged && window.latency.shown.at(-1)?.[1] === false;
}"""


Row = dict[str, Any]
"""One pool: sizes in pixels, times in milliseconds, bytes an edit."""


def measured(browser: Browser, server: Server, name: str, cells: list[str], edits: int) -> Row:
    """Open a notebook with an inspector, edit one weight up and down, and time every edit."""
    server.write(f"{name}.ipynb", cells)
    context = browser.new_context(viewport={"width": 1280, "height": 1000})
    page = context.new_page()
    received: list[int] = []
    page.on("websocket", lambda ws: ws.on("framereceived", lambda data: received.append(len(data))))
    notebook = Notebook(page, server, f"{name}.ipynb", "jupyterlab")
    notebook.run_all()
    page.wait_for_selector(".sfkit-inspector figure img[src^=blob]")
    page.evaluate(WATCH)
    page.locator("[role=gridcell]").first.focus()
    first, full, kernel = [], [], []
    for number in range(-5, edits):
        page.keyboard.press("+" if number % 2 else "-")
        page.wait_for_function(PAINTED)
        shown = page.evaluate("window.latency.shown")
        before = len(received)
        if number < 0:  # warming up
            received.clear()
            continue
        first.append(shown[0][0])
        full.append(shown[-1][0])
        kernel.append(notebook.evaluate("inspector.look['milliseconds']"))
        del received[before:]  # the question just asked is no part of the edit
    height, width = notebook.evaluate("inspector.size")
    context.close()
    row: Row = {"pool": name, "width": width, "height": height, "edits": edits}
    for key, times in {"first": first, "full": full, "kernel": kernel}.items():
        row |= {f"{key}_median": float(np.median(times)), f"{key}_p95": float(np.percentile(times, 95))}
    return {**row, "received": sum(received) / edits}


def measure(edits: int = 40) -> list[Row]:
    """The first bank and, where its data is, the real AnyNet pool."""
    worlds = {"first bank": [BANK, SHOW]}
    if os.environ.get(DATA):
        worlds["real AnyNet"] = [REAL.format(pool=str(POOL)), SHOW]
    os.environ.pop("OMP_NUM_THREADS", None)
    with (
        tempfile.TemporaryDirectory() as folder,
        serving(Path(folder), "jupyterlab") as server,
        sync_playwright() as playwright,
    ):
        browser = playwright.chromium.launch(executable_path=chromium(), args=list(FLAGS))
        found = [measured(browser, server, name, cells, edits) for name, cells in worlds.items()]
        browser.close()
        server.end_kernels()
    return found


def table(records: Sequence[Row]) -> str:
    """The records as Markdown."""
    times = ("first picture, median", "95th percentile", "full size, median", "95th percentile")
    heads = ("pool", "image", *times, "network alone", "received an edit")
    keys = ("first_median", "first_p95", "full_median", "full_p95", "kernel_median")
    rows = [
        (
            r["pool"],
            f"{r['width']}x{r['height']}",
            *(f"{r[key]:.0f} ms" for key in keys),
            f"{r['received'] / 1000:.0f} kB",
        )
        for r in records
    ]
    return numbers(heads, rows, 2)


TARGET = 150.0  # ms, the median first picture on the first bank


def section() -> str:
    """The table, and whether the target was met."""
    records = measure()
    bank = records[0]
    verdict = "under" if bank["first_median"] < TARGET else "above"
    return f"""## From an edit in the RoutingInspector to changed pixels

`{shown("inspector_latency.py")}`: {bank["edits"]} edits of a routing weight by a key in JupyterLab, in
headless Chromium beside its kernel on the same cores; from the browser's time stamp of the key to the second
frame after the disparity picture was exchanged. Where the network is slow the first picture is at reduced
size.

{table(records)}

The first bank's median is {bank["first_median"]:.0f} ms, {verdict} the target of {TARGET:.0f} ms."""


if __name__ == "__main__":
    answered(measure, table)
