"""The report's pages as pictures: top, main table, a page of figures, at two widths, light and dark.

`python docs/report_pictures.py runs/report/report.html` writes them into docs/images/report.
"""

from __future__ import annotations

import argparse
import itertools
import shutil
from pathlib import Path

from playwright.sync_api import Browser, sync_playwright
from screenshots import CHROMIUM, DRAWN, FLAGS, write

OUT = Path(__file__).parent / "images" / "report"
HEIGHTS = {1280: 900, 420: 860}
"""Width of the page -> height of its picture, in pixels."""
PAGES = {"top": None, "main": "main-table", "rivals": "rivals", "pictures": "grid"}
"""Picture -> the notebook's cell at the top of the page; the page's own beginning without one."""


def take(browser: Browser, report: Path, out: Path, width: int, theme: str) -> None:
    """Write a report's pictures at one width in one theme."""
    context = browser.new_context(
        offline=True,
        color_scheme="dark" if theme == "dark" else "light",
        viewport={"width": width, "height": HEIGHTS[width]},
    )
    context.set_default_timeout(600_000)  # milliseconds; a busy machine is slow to draw
    page = context.new_page()
    page.goto(report.resolve().as_uri())
    for name, cell in PAGES.items():
        if cell is not None:
            page.locator(f"[id='cell-id={cell}']").evaluate("one => one.scrollIntoView()")
            page.wait_for_function(VISIBLE)
        page.evaluate(DRAWN)
        write(page.screenshot(), out / f"{name}_{width}_{theme}.webp")
    context.close()


VISIBLE = """() => [...document.querySelectorAll('.figure')].every(one => {
    const place = one.getBoundingClientRect();
    return place.bottom < 0 || place.top > innerHeight || one.querySelector('.main-svg');
})"""
"""What is in sight has been drawn."""


def main() -> None:
    """Take all pictures of one report."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("report", type=Path, help="a page that sfkit report wrote of notebooks/report.ipynb")
    parser.add_argument("--out", type=Path, default=OUT)
    given = parser.parse_args()
    path = next(filter(None, map(shutil.which, CHROMIUM)), None)
    if path is None:
        raise SystemExit("no Chromium found: install the distribution's, such as apt-get install chromium")
    given.out.mkdir(parents=True, exist_ok=True)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        for width, theme in itertools.product(HEIGHTS, ("light", "dark")):
            take(browser, given.report, given.out, width, theme)
        browser.close()


if __name__ == "__main__":
    main()
