"""Fixtures every room shares, and the rule that in CI nothing is skipped unless it stands on a written list."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

REQUIRE_ALL = os.environ.get("SFKIT_REQUIRE_ALL") == "1"

# The only tests that may skip when SFKIT_REQUIRE_ALL=1, by node-id prefix, each with its reason.
ALLOWED_SKIPS: dict[str, str] = {}


def _data_folder(variable: str) -> Path:
    value = os.environ.get(variable)
    if not value:
        pytest.skip(f"{variable} is not set: it names the folder of data that is not part of the repository")
    folder = Path(value)
    if not folder.is_dir():
        pytest.fail(f"{variable} names {value}, which is no folder", pytrace=False)
    return folder.resolve()


@pytest.fixture(scope="session")
def real_data() -> Path:
    """The folder of real checkpoints and real stereo pairs (SFKIT_REAL_DATA)."""
    return _data_folder("SFKIT_REAL_DATA")


@pytest.fixture(scope="session")
def goldens() -> Path:
    """The folder of network specifications and golden arrays (SFKIT_GOLDENS)."""
    return _data_folder("SFKIT_GOLDENS")


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--slow", action="store_true", help="also run the tests marked slow")


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Slow tests are not skipped but deselected: they are a choice, not a missing condition."""
    if config.getoption("--slow"):
        return
    slow = [item for item in items if item.get_closest_marker("slow")]
    config.hook.pytest_deselected(items=slow)
    items[:] = [item for item in items if not item.get_closest_marker("slow")]


def _may_skip(nodeid: str) -> bool:
    return any(nodeid.startswith(prefix) for prefix in ALLOWED_SKIPS)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport(item: pytest.Item, call: pytest.CallInfo[None]):  # type: ignore[no-untyped-def]
    """With SFKIT_REQUIRE_ALL=1 a skip that is not on the list is a failure."""
    report = yield
    if REQUIRE_ALL and report.skipped and not hasattr(report, "wasxfail") and not _may_skip(item.nodeid):
        reason = report.longrepr[2] if isinstance(report.longrepr, tuple) else str(report.longrepr)
        report.outcome = "failed"
        report.longrepr = f"{item.nodeid} skipped although SFKIT_REQUIRE_ALL=1: {reason}"
    return report
