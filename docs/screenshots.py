"""Pictures of the widgets on the embedded bank, light and dark: `make screenshots`.

    python docs/screenshots.py [--out docs/images/widgets] [--width 1280] [NAME ...]

Each widget stands on a bare page in headless Chromium. What it shows is computed: a short Stage 1 and a short
Stage 2 search on a few pairs of the validation benchmark.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from collections.abc import Callable, Sequence
from functools import cached_property
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "browser"))

import cv2
import numpy as np
from browser_stage import Stage
from playwright.sync_api import Browser, sync_playwright
from sfkit_widgets import DisparityCompare, PopulationView, RoutingInspector, RoutingView, SearchControl
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
    def which(self) -> sfkit.SubsetSearch:
        """A short Stage 1."""
        pool = self.scorer.pool
        settings = sfkit.SubsetSettings(population=12, generations=4)
        search = sfkit.SubsetSearch(pool.names, pool.blocks, self.scorer, settings)
        search.run()
        return search

    @cached_property
    def how(self) -> sfkit.RoutingSearch:
        """A short Stage 2 over six sources."""
        pool = self.scorer.pool
        settings = sfkit.RoutingSettings(evaluations=60, tied=False)
        search = sfkit.RoutingSearch(pool.names[:6], pool.blocks, self.scorer, settings)
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


NAMES = ("routing_inspector", "population_view", "search_control", "routing_view", "disparity_compare")


POINTED_AT = {"population_view": "[role=grid] .sfkit-population-row:nth-child(3)"}
"""What the mouse is over, where that shows more."""


def take(browser: Browser, widget: SfkitWidget, path: Path, *, width: int, dark: bool) -> None:
    """Write one picture."""
    context = browser.new_context(
        offline=True, color_scheme="dark" if dark else "light", viewport={"width": width, "height": 900}
    )
    stage = Stage(context.new_page())
    stage.page.add_style_tag(content="body { margin: 0 }")
    stage.show_state(widget)
    stage.page.wait_for_function(SETTLED)
    if pointed := POINTED_AT.get(path.stem.rpartition("_")[0]):
        stage.page.hover(pointed)
    stage.page.evaluate(DRAWN)
    pixels = cv2.imdecode(np.frombuffer(stage.root.screenshot(), np.uint8), cv2.IMREAD_COLOR)
    coded = [cv2.imencode(".webp", pixels, (cv2.IMWRITE_WEBP_QUALITY, quality))[1] for quality in QUALITIES]
    path.write_bytes(min(coded, key=len).tobytes())
    context.close()


def main(arguments: Sequence[str] | None = None) -> None:
    """Take the pictures asked for, or all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("names", nargs="*", choices=[*NAMES, []], help="widgets; all unless named")
    parser.add_argument("--out", type=Path, default=OUT)
    parser.add_argument("--width", type=int, default=1280, help="of the page, in pixels")
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
        for name in given.names or NAMES:
            make: Callable[[], SfkitWidget] = getattr(scenes, name)
            widget = make()
            for theme in ("light", "dark"):
                target = given.out / f"{name}_{theme}.webp"
                take(browser, widget, target, width=given.width, dark=theme == "dark")
                print(target)
            widget.close()
        browser.close()


if __name__ == "__main__":
    main()
