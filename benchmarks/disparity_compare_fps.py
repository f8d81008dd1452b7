"""How smoothly DisparityCompare zooms and pans large images: frames a second in headless Chromium.

    python benchmarks/disparity_compare_fps.py [--seconds 3] [--json]

Three networks on a page of 1280 x 1000: five panels, or three of which one is large, all redrawn in every
frame, without a GPU. Every frame gets one mouse or wheel event, and the page is timed from frame to frame;
60 a second is all that Chromium gives.
``first paint`` is from the arrival of a pair to its pixels on all panels, decoding and colouring included;
``recolour`` the same for a change from disparities to errors.
"""

from __future__ import annotations

import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray
from playwright.sync_api import Page, sync_playwright
from processes import chromium
from stages import answered

sys.path.insert(0, str(Path(__file__).parents[1] / "tests" / "browser"))

from browser_stage import Stage, as_message
from sfkit_widgets._compare_scene import scene
from sfkit_widgets.disparity_compare import DisparityCompare

import sfkit
from sfkit.analysis.disparities import DisparityPanels, NetworkMaps
from sfkit.analysis.pair_maps import error_map

SIZES = ((1242, 375), (1500, 1000))  # KITTI; Middlebury at half resolution
NETWORKS = 3
ARRANGEMENTS = ("side by side", "swipe")
FLAGS = ("--headless", "--no-sandbox", "--disable-gpu")

TIMED = """async ([seconds, act]) => {
    const canvas = document.querySelector(".sfkit canvas");
    const box = canvas.getBoundingClientRect();
    const [x, y] = [box.x + box.width / 2, box.y + box.height / 2];
    const frame = () => new Promise((done) => requestAnimationFrame(done));
    const acts = {
        pan: (i) => canvas.dispatchEvent(new PointerEvent("pointermove", {
            bubbles: true, clientX: x + 60 * Math.sin(i / 9), clientY: y + 30 * Math.cos(i / 7) })),
        zoom: (i) => canvas.dispatchEvent(new WheelEvent("wheel", {
            bubbles: true, cancelable: true, clientX: x, clientY: y, deltaY: i % 60 < 30 ? -12 : 12 })),
    };
    const times = [];
    let last = await frame();
    const end = last + 1000 * seconds;
    for (let i = 0; last < end; i += 1) {
        acts[act](i);
        const now = await frame();
        times.push(now - last);
        last = now;
    }
    return times;
}"""
PAINTED = """async ([name, changes]) => {
    const { model } = window;
    const frame = () => new Promise((done) => requestAnimationFrame(done));
    model.push({ held: changes }); // the fake model's decoding is not the widget's
    await frame();
    const started = performance.now();
    model.state[name] = model.get("held");
    for (const callback of [...model.listeners.get(`change:${name}`)]) callback();
    await frame();
    // Reading one pixel waits for the drawing.
    for (const canvas of document.querySelectorAll(".sfkit canvas")) {
        canvas.getContext("2d").getImageData(0, 0, 1, 1);
    }
    return performance.now() - started;
}"""


@dataclass(frozen=True)
class FrameRates:
    """One image size and arrangement; frames a second, and milliseconds."""

    width: int
    height: int
    arrangement: str
    pan_fps: float
    zoom_fps: float
    pan_p95_ms: float
    zoom_p95_ms: float
    first_paint_ms: float
    recolour_ms: float
    megabytes: float


def smooth(rng: np.random.Generator, width: int, height: int, sigma: float) -> NDArray[np.float32]:
    """(H, W) smooth noise with a standard deviation of about 1."""
    noise = cv2.GaussianBlur(rng.normal(size=(height, width)).astype(np.float32), (0, 0), sigma)
    return np.asarray(noise / noise.std(), dtype=np.float32)


def panels(width: int, height: int) -> DisparityPanels:
    """A pair with sparse ground truth and networks whose errors differ."""
    rng = np.random.default_rng(0)
    full = 40 + 12 * smooth(rng, width, height, 25)
    truth = np.where(rng.random((height, width)) < 0.7, full, np.float32(np.nan))
    networks = []
    for number in range(NETWORKS):
        seen = full + (1 + number) * smooth(rng, width, height, 8)
        networks.append(NetworkMaps(f"network {number}", seen, error_map(seen, truth), {"bad-3.0": 1.0}))
    left = rng.integers(0, 255, (height, width, 3), dtype=np.uint8)
    left = np.asarray(cv2.GaussianBlur(left, (0, 0), 2), dtype=np.uint8)
    return DisparityPanels("noise", "all-valid", "pair", left, truth, tuple(networks), (0.0, 80.0), 3.0)


def rates(page: Page, act: str, seconds: float) -> tuple[float, float]:
    """Frames a second, and the 95th percentile of a frame's milliseconds."""
    if act == "pan":
        canvas = page.locator(".sfkit canvas").first
        canvas.hover()
        page.mouse.down()
    times = np.array(page.evaluate(TIMED, [seconds, act]))
    if act == "pan":
        page.mouse.up()
    return 1000.0 * times.size / times.sum(), float(np.percentile(times, 95))


def measured(
    page: Page, widget: DisparityCompare, size: tuple[int, int], arrangement: str, seconds: float
) -> FrameRates:
    """One widget on a bare page, from its first pixels to its frames."""
    width, height = size
    held = scene(panels(width, height))
    Stage(page).show_state(widget, arrangement=arrangement)
    arrived = page.evaluate(PAINTED, ["scene", as_message(held)])
    recolour = page.evaluate(PAINTED, ["shown", "error"])
    page.locator(".sfkit canvas").first.click()
    for _ in range(3):
        page.keyboard.press("+")
    pan, pan_p95 = rates(page, "pan", seconds)
    zoom, zoom_p95 = rates(page, "zoom", seconds)
    size_mb = (len(held["left"]) + len(held["truth"]) * (1 + NETWORKS)) / 1e6
    return FrameRates(width, height, arrangement, pan, zoom, pan_p95, zoom_p95, arrived, recolour, size_mb)


def measure(seconds: float = 3.0) -> list[FrameRates]:
    """Both sizes in both arrangements."""
    pool = sfkit.open_pool("bank")
    recipes = {"base": pool.base_recipe(), "uniform": pool.uniform()}
    widget = DisparityCompare(pool, recipes, sfkit.open_benchmark("bank:courtyard", pairs=1))
    found = []
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=chromium(), args=list(FLAGS))
        for size in SIZES:
            for arrangement in ARRANGEMENTS:
                page = browser.new_page(viewport={"width": 1280, "height": 1000})
                found.append(measured(page, widget, size, arrangement, seconds))
                page.close()
        browser.close()
    return found


def table(records: Sequence[FrameRates]) -> str:
    """The records as Markdown."""
    lines = [
        "| image | arrangement | pan | zoom | 95th percentile | first paint | recolour | sent a pair |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for r in records:
        lines.append(
            f"| {r.width}x{r.height} | {r.arrangement} | {r.pan_fps:.0f} fps | {r.zoom_fps:.0f} fps | "
            f"{max(r.pan_p95_ms, r.zoom_p95_ms):.0f} ms | {r.first_paint_ms:.0f} ms | "
            f"{r.recolour_ms:.0f} ms | {r.megabytes:.1f} MB |"
        )
    return "\n".join(lines)


if __name__ == "__main__":
    answered(__doc__, measure, {"seconds": 3.0}, table)
