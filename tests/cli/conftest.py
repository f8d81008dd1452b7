"""A folder with a pool and two pairs, and a shell in it."""

from __future__ import annotations

from pathlib import Path

import pytest
from cli_world import Shell, rename_sources
from tiny import write_pairs, write_pool


@pytest.fixture
def world(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The working folder: ``pool`` of three sources and two ``pairs``."""
    rename_sources(write_pool(tmp_path / "pool"))
    write_pairs(tmp_path / "pairs", 2)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def shell(world: Path, capsys: pytest.CaptureFixture[str]) -> Shell:
    """Runs command lines in the working folder."""
    return Shell(capsys)
