"""Fixtures every room shares, and the rule that in CI no test skips unless it stands on a written list."""

from __future__ import annotations

import os
import shutil
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hypothesis
import pytest

if TYPE_CHECKING:
    from playwright.sync_api import Browser, BrowserContext

REQUIRE_ALL = os.environ.get("SFKIT_REQUIRE_ALL") == "1"
DATA_FOLDERS = ("SFKIT_REAL_DATA", "SFKIT_GOLDENS")

# The only tests that may skip when SFKIT_REQUIRE_ALL=1, by node-id prefix, each with its reason.
ALLOWED_SKIPS: dict[str, str] = {}

CHROMIUM_NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
CHROMIUM_FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)

# What a page may take for anything it is waited for, in milliseconds; Playwright's own is half a minute.
PATIENCE = 240_000

# No deadlines: nothing in these tests may depend on how busy the machine is.
hypothesis.settings.register_profile("sfkit", deadline=None, derandomize=REQUIRE_ALL)
hypothesis.settings.load_profile("sfkit")


def _data_folder(variable: str) -> Path:
    value = os.environ.get(variable)
    if not value:
        pytest.skip(f"{variable} is not set: it names the folder of data that is not part of the repository")
    folder = Path(value)
    if not folder.is_dir():
        pytest.fail(f"{variable} names {value}, which is no folder", pytrace=False)
    return folder.resolve()


@pytest.fixture(scope="session", autouse=True)
def cache_folder(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A cache of the session's own, so that tests neither see nor fill the user's."""
    folder = tmp_path_factory.mktemp("cache")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SFKIT_CACHE", str(folder))
        yield folder


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real checkpoints and real stereo pairs (SFKIT_REAL_DATA)."""
    return _data_folder("SFKIT_REAL_DATA")


@pytest.fixture(scope="session")
def goldens() -> Path:
    """The folder of network specifications and golden arrays (SFKIT_GOLDENS)."""
    return _data_folder("SFKIT_GOLDENS")


@pytest.fixture(scope="session")
def shipped_goldens() -> Path:
    """The same where the variable is set; else the reduced set that ships with the tests."""
    if os.environ.get("SFKIT_GOLDENS"):
        return _data_folder("SFKIT_GOLDENS")
    return Path(__file__).parent / "goldens"


@pytest.fixture(scope="session")
def chromium() -> Path:
    """The distribution's Chromium, which Playwright and kaleido can drive."""
    found = next(filter(None, map(shutil.which, CHROMIUM_NAMES)), None)
    if found is None:
        pytest.skip("no Chromium found: install the distribution's, for instance apt-get install chromium")
    return Path(found)


@pytest.fixture(scope="session")
def browser(chromium: Path) -> Iterator[Browser]:
    """A headless Chromium driven by Playwright; mark the tests that use it ``browser``."""
    sync_api = pytest.importorskip(
        "playwright.sync_api", reason="install the extra: pip install sfkit[browser]"
    )
    with sync_api.sync_playwright() as playwright:
        running = playwright.chromium.launch(
            executable_path=chromium, args=list(CHROMIUM_FLAGS), timeout=PATIENCE
        )
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(running, "new_context", _patient(running.new_context))
            yield running
        running.close()


def _patient(new_context: Callable[..., BrowserContext]) -> Callable[..., BrowserContext]:
    def patient(**options: Any) -> BrowserContext:
        context = new_context(**options)
        context.set_default_timeout(PATIENCE)
        return context

    return patient


def pytest_addoption(parser: pytest.Parser) -> None:
    """Offer --slow."""
    parser.addoption("--slow", action="store_true", help="also run the tests marked slow")


def pytest_configure(config: pytest.Config) -> None:
    """With SFKIT_REQUIRE_ALL=1 a missing data folder ends the run before the first test."""
    missing = [name for name in DATA_FOLDERS if not Path(os.environ.get(name) or "missing").is_dir()]
    if REQUIRE_ALL and missing:
        raise pytest.UsageError(f"SFKIT_REQUIRE_ALL=1, but {' and '.join(missing)} do not name a folder")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Slow tests are not skipped but deselected: they are a choice, not a missing condition.

    Files that hold some come first: the last file of all should be a short one, for nobody else works then.

    What drives a browser is run once more where it fails: on a busy machine pages lose input, messages and
    kernels. What is no accident fails twice, and the run's summary names what was run again.
    """
    for item in items:
        if item.get_closest_marker("browser"):
            item.add_marker(pytest.mark.flaky(reruns=1))
    if config.getoption("--slow"):
        long = {item.path for item in items if item.get_closest_marker("slow")}
        first = [item for item in items if item.path in long]
        items[:] = [*first, *_spread([item for item in items if item.path not in long])]
        return
    slow = [item for item in items if item.get_closest_marker("slow")]
    config.hook.pytest_deselected(items=slow)
    items[:] = [item for item in items if not item.get_closest_marker("slow")]


def _spread(items: list[pytest.Item]) -> list[pytest.Item]:
    """The other files, those with a browser apart: side by side their pages wait for minutes."""
    files: dict[Path, list[pytest.Item]] = {}
    for item in items:
        files.setdefault(item.path, []).append(item)
    browsing = [path for path, tests in files.items() if any(t.get_closest_marker("browser") for t in tests)]
    order = [path for path in files if path not in browsing]
    gap = len(order) * 2 // 3 // max(1, len(browsing))  # none at the end, where nobody else works
    for number, path in enumerate(browsing):
        order.insert(number * (gap + 1), path)
    return [item for path in order for item in files[path]]


def _forbid_skip(report: pytest.TestReport | pytest.CollectReport) -> None:
    if not REQUIRE_ALL or not report.skipped or hasattr(report, "wasxfail"):
        return
    if any(report.nodeid.startswith(prefix) for prefix in ALLOWED_SKIPS):
        return
    reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
    report.outcome = "failed"
    report.longrepr = f"{report.nodeid} skipped although SFKIT_REQUIRE_ALL=1: {reason}"


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    """With SFKIT_REQUIRE_ALL=1 a test that skips, and is not on the list, fails."""
    report = yield
    _forbid_skip(report)
    return report


@pytest.hookimpl(wrapper=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, pytest.CollectReport]:
    """The same for a whole module that skips itself, as ``pytest.importorskip`` at its top does."""
    report = yield
    _forbid_skip(report)
    return report
