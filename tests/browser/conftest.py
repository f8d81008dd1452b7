"""Browser tests in two layers: a widget's script on a bare page, and notebooks in JupyterLab and Notebook 7.

Every page is watched: an error on its console, or a request to another host, fails the test.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING
from urllib.parse import urlsplit

import pytest
from browser_lab import Notebook, Server, serving
from browser_stage import PATIENCE, Stage

if TYPE_CHECKING:
    from playwright.sync_api import Browser, Page

INNER = ("data", "blob", "about")
# What Notebook 7.6 says by itself on every page, widgets or none.
NOTEBOOK_SAYS = "Cannot read properties of undefined (reading 'schema')"
# What JupyterLab says of each widget of a notebook whose kernel is gone.
LAB_SAYS = "Error: widget model not found"


class Watched:
    """What a page said and asked for."""

    def __init__(self, page: Page, host: str) -> None:
        self.noise: list[str] = []
        self.foreign: list[str] = []
        self.host = host
        page.on("console", lambda message: self._hear(message.type, message.text))
        page.on("pageerror", lambda error: self.noise.append(str(error)))
        page.on("request", lambda request: self._see(request.url))
        page.on("websocket", lambda socket: self._see(socket.url))

    def _hear(self, kind: str, text: str) -> None:
        if kind == "error":
            self.noise.append(text)

    def _see(self, url: str) -> None:
        parts = urlsplit(url)
        if parts.scheme not in INNER and parts.netloc != self.host:
            self.foreign.append(url)

    def check(self) -> None:
        """Fail where there was an error, or a request to another host."""
        assert [text for text in self.noise if not text.startswith((NOTEBOOK_SAYS, LAB_SAYS))] == []
        assert self.foreign == []


Open = Callable[..., Stage]


@pytest.fixture
def stage(browser: Browser) -> Iterator[Open]:
    """Makes bare pages: ``stage(width=800, dark=True)`` gives a Stage; offline and watched."""
    made = []

    def open_page(*, width: int = 1280, height: int = 900, dark: bool = False) -> Stage:
        context = browser.new_context(
            offline=True,
            color_scheme="dark" if dark else "light",
            viewport={"width": width, "height": height},
        )
        page = context.new_page()
        page.set_default_timeout(PATIENCE * 1000)
        made.append((context, Watched(page, host="")))
        return Stage(page)

    yield open_page
    for context, watched in made:
        context.close()
        watched.check()


@pytest.fixture(scope="session")
def lab_server(chromium: object, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A JupyterLab server of this test run."""
    with serving(tmp_path_factory.mktemp("lab"), "jupyterlab") as server:
        yield server


@pytest.fixture(scope="session")
def notebook_server(chromium: object, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    """A Notebook 7 server of this test run."""
    pytest.importorskip("notebook", reason="install the extra: pip install sfkit[browser]")
    with serving(tmp_path_factory.mktemp("notebook7"), "notebook") as server:
        yield server


Opened = Callable[..., Notebook]


def _opener(browser: Browser, server: Server, app: str) -> Iterator[Opened]:
    made = []

    def open_notebook(
        name: str, cells: list[str] | None = None, *, width: int = 1280, height: int = 1000
    ) -> Notebook:
        if cells is not None:
            server.write(name, cells)
        context = browser.new_context(viewport={"width": width, "height": height})
        page = context.new_page()
        made.append((context, Watched(page, host=urlsplit(server.url).netloc)))
        return Notebook(page, server, name, app)

    yield open_notebook
    for context, _ in made:
        context.close()
    server.end_kernels()
    for _, watched in made:
        watched.check()


@pytest.fixture
def lab(browser: Browser, lab_server: Server) -> Iterator[Opened]:
    """Opens notebooks in JupyterLab: ``lab("name.ipynb", ["cell", ...])`` gives a Notebook."""
    yield from _opener(browser, lab_server, "jupyterlab")


@pytest.fixture
def notebook7(browser: Browser, notebook_server: Server) -> Iterator[Opened]:
    """The same in Notebook 7."""
    yield from _opener(browser, notebook_server, "notebook")
