"""The soak's figures are read from what pytest said, and a run that was stopped is told as such."""

from __future__ import annotations

import importlib
import math
import sys
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"
SHARE = "tests/search/test_search_killed.py::test_a_search_killed_at_a_random_moment_ends_bit_identically"


@pytest.fixture
def soak() -> Iterator[ModuleType]:
    sys.path.insert(0, str(FOLDER))
    yield importlib.import_module("soak")
    sys.path.remove(str(FOLDER))
    del sys.modules["soak"]


def test_kills_are_those_of_the_shares_that_passed(soak: ModuleType) -> None:
    text = f"asked 200\n{SHARE}[0] PASSED [  9%]\n{SHARE}[1] FAILED [ 18%]\n{SHARE}[2] PASSED\ncpu 91.5\n"
    part = soak.read("kills", text)
    assert (part.said, len(part.failed), part.seconds) == (
        "40 kills of a search in one process",
        1,
        91.5,
    )
    stopped = soak.read("kills", text.partition("cpu")[0] + f"{SHARE}[3] ")
    assert math.isnan(stopped.seconds)
    assert len(stopped.passed) == 2
    assert "| stopped |" in soak.table([stopped])


def test_readers_and_engines(soak: ModuleType) -> None:
    place = "tests/outside/test_outside_fuzz.py::test_only_sentences_come_out"
    fuzz = soak.read("fuzz", f"asked 2000\n{place}[pfm] PASSED\n{place}[csv] PASSED\n{place}[png16] FAILED\n")
    assert fuzz.said == "4,000 damaged files, 2,000 for each of 2 readers"
    place = "tests/search/test_search_killed_engines.py::test_"
    engines = soak.read("engines", f"asked 10\n{place}processes PASSED\n{place}ray PASSED\n")
    assert engines.said == "10 kills with processes, 5 kills with ray"
    assert soak.read("engines", "asked 10\n").said == "no kill of a parallel search"


def test_tests_that_were_run_again_count_by_their_last_run(soak: ModuleType) -> None:
    place = "tests/outside/test_outside_fuzz.py::test_only_sentences_come_out"
    first = f"asked 2000\n{place}[pfm] PASSED\n{place}[torch] FAILED\nE struct.error\ncpu 90.0\n"
    part = soak.read("fuzz", f"{first}asked 2000\n{place}[torch] PASSED\ncpu 10.0\n")
    assert (part.said, part.failed, part.seconds) == (
        "4,000 damaged files, 2,000 for each of 2 readers",
        (),
        100.0,
    )
    assert math.isnan(soak.read("fuzz", f"{first}asked 2000\n").seconds), "stopped"


def test_every_part_is_files_that_are_there_and_the_soak_s_those_of_make(soak: ModuleType) -> None:
    make = (FOLDER.parent / "Makefile").read_text()
    for name, files in soak.PARTS.items():
        for file in files:
            assert (FOLDER.parent / file).is_file()
            assert name == "faults" or file in make
    assert len(set(soak.FAULTS)) == len(soak.FAULTS) > 20
    faults = soak.read("faults", f"asked {len(soak.FAULTS)}\n{SHARE}[0] PASSED\ncpu 281.0\n")
    assert faults.said == f"the tests of faults, {len(soak.FAULTS)} files, as `make test` runs them"
