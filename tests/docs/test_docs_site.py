"""The documentation as `make site` built it: three of its pages, opened from the folder, in both themes."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser

SITE = Path(__file__).parents[2] / "build" / "site"


@pytest.mark.browser
@pytest.mark.skipif(not (SITE / "index.html").is_file(), reason="the site is not built: make site")
def test_axe_finds_nothing_serious_on_three_pages(browser: Browser) -> None:
    axe = pytest.importorskip(
        "axe_playwright_python.sync_playwright", reason="install the extra: pip install sfkit[browser]"
    )
    found = []
    for scheme, name in (("light", "index"), ("dark", "guide"), ("light", "method")):
        context = browser.new_context(offline=True, color_scheme=scheme)
        page = context.new_page()
        page.goto((SITE / f"{name}.html").as_uri())
        found += [
            f"{name}, {scheme}: {rule['id']}: {node['target']} {node['failureSummary']}"
            for rule in axe.Axe().run(page).response["violations"]
            if rule["impact"] in ("serious", "critical")
            for node in rule["nodes"]
        ]
        context.close()
    assert found == []
