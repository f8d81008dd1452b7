"""A notebook's report as a reader opens it: in Chromium, without a network, quiet and asking for nothing."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page


@contextmanager
def opened(browser: Browser, path: Path) -> Iterator[Page]:
    """The page, with every widget drawn."""
    context = browser.new_context(offline=True, viewport={"width": 1280, "height": 900})
    page = context.new_page()
    noise: list[str] = []
    asked: list[str] = []
    page.on("console", lambda message: noise.append(message.text))
    page.on("pageerror", lambda error: noise.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    page.goto(path.as_uri())
    page.wait_for_function(
        "[...document.querySelectorAll('.widget')].every((place) => place.firstElementChild)"
    )
    yield page
    context.close()
    assert noise == []
    assert [url for url in asked if not url.startswith(("data:", "blob:"))] == [path.as_uri()]
