"""Pictures of the widgets on the embedded bank, light and dark: `make screenshots`.

    python docs/screenshots.py [--out docs/images/widgets] [--width 1280 800] [NAME ...]

Each widget stands on a bare page in headless Chromium. What it shows is computed: a short Stage 1 and a short
Stage 2 search on a few pairs of the validation benchmark. `reopened` is a notebook in JupyterLab as it comes:
run, saved, and opened again without a kernel.
"""

from __future__ import annotations

import argparse
import itertools
import json
import shutil
import sys
import tempfile
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "browser"))

import cv2
import numpy as np
from browser_lab import PATIENCE, Notebook, serving
from browser_stage import Stage
from playwright.sync_api import Browser, sync_playwright
from sfkit_widgets import (
    DisparityCompare,
    PopulationView,
    RoutingInspector,
    RoutingView,
    RunTable,
    SearchControl,
)
from sfkit_widgets._base import SfkitWidget

import sfkit

OUT = Path(__file__).parent / "images" / "widgets"
CHROMIUM = ("chromium", "chromium-browser", "google-chrome")
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu", "--disable-background-networking")
PAIRS = 3
QUALITIES = (101, 90)  # of WebP: without loss, which is smaller for charts, and with little, for photographs
DRAWN = "() => new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))"
SETTLED = "() => [...document.images].every((image) => image.complete && image.naturalWidth > 0)"


class Scenes:
    """What the widgets show; every part is made when it is first asked for."""

    @cached_property
    def scorer(self) -> sfkit.Evaluator:
        """The bank on some pairs of its validation benchmark."""
        return sfkit.Evaluator(sfkit.open_pool("bank"), sfkit.open_benchmark("bank:courtyard", pairs=PAIRS))

    @cached_property
    def runs(self) -> Path:
        """Where the searches leave their journals."""
        return Path(tempfile.mkdtemp())

    def journal(self, name: str) -> sfkit.Journal:
        """The journal of one search, beside what says how it is scored."""
        folder = self.runs / name
        folder.mkdir(exist_ok=True)
        (folder / "search.json").write_text(json.dumps({"metrics": [str(self.scorer.metric)]}))
        return sfkit.Journal(folder / "journal.jsonl")

    @cached_property
    def which(self) -> sfkit.SubsetSearch:
        """A short Stage 1."""
        pool = self.scorer.pool
        settings = sfkit.SubsetSettings(population=12, generations=4)
        journal = self.journal("by the paper's method")
        search = sfkit.SubsetSearch(pool.names, pool.blocks, self.scorer, settings, journal=journal)
        search.run()
        return search

    @cached_property
    def how(self) -> sfkit.RoutingSearch:
        """A short Stage 2 over six sources."""
        pool = self.scorer.pool
        settings = sfkit.RoutingSettings(evaluations=60, tied=False)
        journal = self.journal("by the paper's method")
        search = sfkit.RoutingSearch(pool.names[:6], pool.blocks, self.scorer, settings, journal=journal)
        search.run()
        return search

    @cached_property
    def modelled(self) -> sfkit.BayesianSubsetSearch:
        """A short Stage 1 by a model."""
        pool = self.scorer.pool
        settings = sfkit.BayesianSubsetSettings(generations=24)
        journal = self.journal("by a model")
        search = sfkit.BayesianSubsetSearch(pool.names, pool.blocks, self.scorer, settings, journal=journal)
        search.run()
        return search

    def routing_inspector(self) -> SfkitWidget:
        """The best recipe of Stage 2 pinned, and an edit of it."""
        widget = RoutingInspector(self.scorer, search=self.how)
        widget.pin("A")
        widget.weigh("cost_volume", widget.sources[0], 0.6)
        widget.lock("cost_volume", widget.sources[0], locked=True)
        widget.scale("head", 1.4)
        widget.score()
        widget.settle()
        return widget

    def population_view(self) -> SfkitWidget:
        """Stage 1's population."""
        return PopulationView(self.which)

    def population_view_model(self) -> SfkitWidget:
        """The same by a model."""
        return PopulationView(self.modelled)

    def run_table(self) -> SfkitWidget:
        """All these searches."""
        _ = self.which, self.modelled, self.how
        return RunTable(self.runs)

    def run_table_routing(self) -> SfkitWidget:
        """The same, Stage 2 chosen."""
        return self.run_table()

    def search_control(self) -> SfkitWidget:
        """A Stage 2 search half-way."""
        pool = self.scorer.pool
        settings = sfkit.RoutingSettings(evaluations=60, tied=False, seed=1)
        control = SearchControl(sfkit.RoutingSearch(pool.names[:6], pool.blocks, self.scorer, settings))
        for _ in range(3):
            control.step()
            control.wait()
        return control

    def routing_view(self) -> SfkitWidget:
        """Stage 2 over its iterations."""
        return RoutingView(self.how)

    def routing_view_model(self) -> SfkitWidget:
        """Stage 2 by a model."""
        pool = self.scorer.pool
        settings = sfkit.BayesianRoutingSettings(evaluations=40)
        search = sfkit.BayesianRoutingSearch(pool.names[:6], pool.blocks, self.scorer, settings)
        search.run()
        return RoutingView(search)

    def disparity_compare(self) -> SfkitWidget:
        """Base, equal weights, and what Stage 2 found."""
        pool = self.scorer.pool
        best = self.how.best
        recipes = {"base": pool.base_recipe(), "all sources equally": pool.uniform()}
        if best is not None:
            recipes["routed"] = best.recipe
        compare = DisparityCompare(pool, recipes, self.scorer.benchmark)
        compare.cursor = [160, 96]
        return compare


NAMES = (
    "routing_inspector",
    "population_view",
    "search_control",
    "routing_view",
    "disparity_compare",
    "population_view_model",
    "routing_view_model",
    "run_table",
    "run_table_routing",
)
REOPENED = "reopened"
CELLS = ("import sfkit_widgets", "sfkit_widgets.inspect('bank')")


_ROW = "[role=grid] .sfkit-population-row:nth-child({})"
POINTED_AT = {"population_view": _ROW.format(3), "population_view_model": _ROW.format(1)}
"""What the mouse is over, where that shows more."""
PRESSED = {"run_table_routing": "tbody tr:has-text('Stage 2') button"}
"""What is pressed before."""


def take(browser: Browser, widget: SfkitWidget, name: str, path: Path, *, width: int, dark: bool) -> None:
    """Write one picture."""
    context = browser.new_context(
        offline=True, color_scheme="dark" if dark else "light", viewport={"width": width, "height": 900}
    )
    context.set_default_timeout(PATIENCE * 1000)
    stage = Stage(context.new_page())
    stage.page.add_style_tag(content="body { margin: 0 }")
    stage.show_state(widget)
    stage.page.wait_for_function(SETTLED)
    if pressed := PRESSED.get(name):
        stage.page.click(pressed)
    if pointed := POINTED_AT.get(name):
        stage.page.hover(pointed)
    stage.page.evaluate(DRAWN)
    write(stage.root.screenshot(), path)
    context.close()


def write(png: bytes, path: Path) -> None:
    """A screenshot as WebP."""
    pixels = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR)
    coded = [cv2.imencode(".webp", pixels, (cv2.IMWRITE_WEBP_QUALITY, quality))[1] for quality in QUALITIES]
    path.write_bytes(min(coded, key=len).tobytes())
    print(path)


def take_reopened(browser: Browser, path: Path) -> None:
    """A notebook with a widget in JupyterLab as it comes: run, saved, opened again without its kernel."""
    with tempfile.TemporaryDirectory() as folder, serving(Path(folder), "jupyterlab") as server:
        server.write("reopened.ipynb", CELLS)
        for again in (False, True):
            page = browser.new_page(viewport={"width": 1100, "height": 900})
            notebook = Notebook(page, server, "reopened.ipynb", "jupyterlab")
            if not again:
                notebook.run_all()
                notebook.save()
                server.end_kernels()
                page.close()
                continue
            notebook.command("application:toggle-left-area")
            page.wait_for_function("() => document.querySelector('.sfkit-still img').naturalWidth === 960")
            page.evaluate(DRAWN)
            write(page.screenshot(), path)
            page.close()


def main(arguments: Sequence[str] | None = None) -> None:
    """Take the pictures asked for, or all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[*NAMES, REOPENED, []], help="pictures; all unless named")
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--width", type=int, nargs="+", default=[1280, 800], help="of the page, in pixels")
    given = parser.parse_args(arguments)
    path = next(filter(None, map(shutil.which, CHROMIUM)), None)
    if path is None:
        raise SystemExit(
            "no Chromium found: install the distribution's, for instance apt-get install chromium"
        )
    given.out.mkdir(parents=True, exist_ok=True)
    scenes = Scenes()
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        for name in given.names or (*NAMES, REOPENED):
            if name == REOPENED:
                take_reopened(browser, given.out / f"{name}.webp")
                continue
            make: Callable[[], SfkitWidget] = getattr(scenes, name)
            widget = make()
            for width, theme in itertools.product(given.width, ("light", "dark")):
                narrow = "" if width == 1280 else f"_{width}"
                target = given.out / f"{name}{narrow}_{theme}.webp"
                take(browser, widget, name, target, width=width, dark=theme == "dark")
            widget.close()
        browser.close()


if __name__ == "__main__":
    main()
