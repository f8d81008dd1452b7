"""Recorded results: a section's text takes the place between its markers, and nothing else moves."""

from __future__ import annotations

import contextlib
import importlib
import os
import re
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import pandas as pd
import pytest

FOLDER = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture(scope="module")
def results() -> Iterator[ModuleType]:
    """``benchmarks/results.py``, importable as the scripts there import each other."""
    before = set(sys.modules)
    sys.path.insert(0, str(FOLDER))
    yield importlib.import_module("results")
    sys.path.remove(str(FOLDER))
    for name in set(sys.modules) - before:
        origin = getattr(sys.modules[name], "__file__", None) or ""
        if origin.startswith(str(FOLDER)):
            del sys.modules[name]


def test_every_section_can_be_found_and_has_its_parts(results: ModuleType) -> None:
    modules = results.modules()
    assert {"bigpool", "foundation-stereo-speed", "nmrf-pool", "nmrf-speed"} <= set(modules)
    for name, where in modules.items():
        module = importlib.import_module(where)
        assert callable(module.section), name
        assert module.__doc__, name
        assert getattr(module, "DOCUMENT", results.RESULTS) in results.PREAMBLES, name


def test_a_section_replaces_itself_alone(results: ModuleType) -> None:
    first = results.replaced("# Title\n", "one", "## One\n\nold \\1 text")
    both = results.replaced(first, "two", "## Two")
    assert results.replaced(both, "one", "## One\n\nnew \\g<0> text") == (
        "# Title\n\n<!-- begin one -->\n## One\n\nnew \\g<0> text\n<!-- end one -->\n\n"
        "<!-- begin two -->\n## Two\n<!-- end two -->\n"
    )


def test_a_record_says_when_how_and_on_what_but_not_where(
    results: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    module = importlib.import_module("sections.nmrf_pool")
    row = {"sources": 11, "step": "write", "write_seconds": 0.25, "anonymous_mb": 680.0, "mapped_mb": 9.0}
    monkeypatch.setattr(module, "measure", lambda _: {"file_bytes": 130e6, "rows": [row]})
    path = results.record("nmrf-pool", tmp_path)
    assert path == tmp_path / "benchmarks" / "README.md"
    written = path.read_text()
    assert written.startswith(results.PREAMBLES["benchmarks/README.md"])
    assert "| 11 | write | write 0.250 | 680 | 9 |" in written
    assert re.search(r"Measured 20\d\d-\d\d-\d\d by `python benchmarks/results.py nmrf-pool`", written)
    assert f"on {os.cpu_count()} cores and " in written
    assert os.uname().nodename not in written
    assert str(Path.home()) not in written


def test_an_unknown_section_is_refused_before_any_is_measured(
    results: ModuleType, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    recorded: list[Any] = []
    monkeypatch.setattr(results, "record", recorded.append)
    with pytest.raises(SystemExit):
        results.main(["bigpool", "bigpol"])
    assert "unknown section 'bigpol', expected one of: ablations-bank" in capsys.readouterr().err
    assert recorded == []


def test_pool_rows_become_a_table(results: ModuleType) -> None:
    bigpool = importlib.import_module("bigpool")
    rows = [
        {"sources": 3, "step": "merge", "equal_seconds": 0.1234, "routed_seconds": 0.5, "bytes_read": 7}
        | {"anonymous_mb": 1234.0, "mapped_mb": 56.0}
    ]
    assert bigpool.table({"rows": rows}).splitlines()[-1] == (
        "| 3 | merge | equal 0.123, routed 0.500 | 1,234 | 56 |"
    )


def test_a_table_in_a_document_has_whole_numbers_decimals_and_dashes(results: ModuleType) -> None:
    frame = pd.DataFrame({"a": [1.0, None], "n": [1200, 3], "t": ["x", "y"]}, index=pd.Index(["one", "two"]))
    markdown = importlib.import_module("tabulated").markdown
    assert markdown(frame.rename_axis("bench")).splitlines() == [
        "| bench | a | n | t |",
        "| --- | --: | --: | --- |",
        "| one | 1.00 | 1200 | x |",
        "| two | – | 3 | y |",
    ]
    assert markdown(frame.assign(b=True).set_index(["t", "b"]), digits=1).splitlines()[2] == (
        "| x | True | 1.0 | 1200 |"
    )


def test_a_temporary_folder_lies_elsewhere_has_room_and_is_removed(
    results: ModuleType, tmp_path: Path
) -> None:
    pools = importlib.import_module("synthetic_pool")
    for folder, size, said in (
        (FOLDER, 0, "lies in the checkout, expected a folder elsewhere"),
        (tmp_path, 1 << 60, "GB are free, expected"),
    ):
        with pytest.raises(SystemExit, match=said), pools.temporary_folder(folder, size):
            pytest.fail("made all the same")
    kept = contextlib.ExitStack()
    made = kept.enter_context(pools.temporary_folder(tmp_path, 10))
    (made / "file").write_text("x")
    interrupt = KeyboardInterrupt()
    assert not kept.__exit__(KeyboardInterrupt, interrupt, None), "it goes on to whoever handles it"
    assert not list(tmp_path.iterdir())


def test_a_shape_knows_how_large_its_files_are(results: ModuleType) -> None:
    pools, plan = importlib.import_module("synthetic_pool"), importlib.import_module("bigpool").PLANS
    shape, *_ = plan["nmrf-swint"]
    assert sum(tensor.nbytes for tensor in pools.base_state(shape).values()) == pools.file_size(shape)


TOUCH = """import json, mmap, sys, time
kept = b"x" * (SIZE << 20)
with open(sys.argv[1], "rb") as stream:
    pages = mmap.mmap(stream.fileno(), 0, prot=mmap.PROT_READ)
seen = sum(pages[n] for n in range(0, len(pages), 4096))
time.sleep(1.5)  # for whoever watches, on a busy machine too
print(json.dumps(len(kept)))
"""


@pytest.mark.skipif(sys.platform != "linux", reason="memory by kind is read from /proc: run it on Linux")
def test_memory_of_a_process_is_told_by_kind(results: ModuleType, tmp_path: Path) -> None:
    """64 MiB more of its own are anonymous, 64 MiB more of a file are mapped."""
    processes = importlib.import_module("processes")

    def peak(own: int, mapped: int) -> Any:
        (tmp_path / "touch.py").write_text(TOUCH.replace("SIZE", str(own)))
        (tmp_path / "file").write_bytes(bytes(mapped << 20))
        answer, found = processes.call_watched(str(tmp_path / "touch.py"), str(tmp_path / "file"))
        assert answer == own << 20
        return found

    little, more_own, more_mapped = peak(1, 1), peak(65, 1), peak(1, 65)
    assert more_own.anonymous_mb - little.anonymous_mb == pytest.approx(64, abs=4)
    assert more_mapped.mapped_mb - little.mapped_mb == pytest.approx(64, abs=4)
    assert more_own.mapped_mb == pytest.approx(little.mapped_mb, abs=4)
    assert more_mapped.anonymous_mb == pytest.approx(little.anonymous_mb, abs=4)


FAMILY = """import subprocess, sys, time
kept = b"x" * (64 << 20)
if len(sys.argv) > 1:
    subprocess.run([sys.executable, "-c", sys.argv[1]], check=True)
time.sleep(1.5)
print("done")
"""


@pytest.mark.skipif(sys.platform != "linux", reason="memory is read from /proc: run it on Linux")
def test_memory_of_a_command_is_that_of_all_it_began(results: ModuleType) -> None:
    """A child that holds 64 MiB beside its parent's counts as the parent does."""
    processes = importlib.import_module("processes")
    output, alone = processes.watched(sys.executable, "-c", FAMILY)
    _, two = processes.watched(sys.executable, "-c", FAMILY, FAMILY)
    assert output == "done\n"
    assert (alone.processes, two.processes) == (1, 2)
    assert two.resident_mb - alone.resident_mb >= 64
    assert alone.seconds >= 1.5


@pytest.mark.skipif(sys.platform != "linux", reason="its own peak is read from /proc: run it on Linux")
def test_the_peak_of_a_process_is_its_own(results: ModuleType) -> None:
    """What getrusage says counts from the peak of the process that started it."""
    processes = importlib.import_module("processes")
    held = bytearray(b"x") * (400 << 20)
    assert processes.apart(processes.peak_mb) < processes.peak_mb() - 200
    assert len(held) == 400 << 20


def test_evidence_is_what_finished_comparisons_say(
    results: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    evidence, bank = (importlib.import_module(name) for name in ("evidence", "evidence_bank"))
    end = bank.FIRST.evaluations
    monkeypatch.setattr(evidence, "kept", replace(evidence.kept, folder=tmp_path))
    with pytest.raises(SystemExit, match="nothing is finished yet"):
        evidence.section()
    columns = ["pairs", "trial", "seed", "evaluations", "distance", "validation", "held", "equal"]
    judges = ["courtyard", "indoor-rooms", "hazy-road", "grey-workshop"]
    after = {"plain": (9.0, 21.0, 31.5, 11.0), "shrinkage 0.05": (9.5, 20.0, 29.0, 10.0)}
    rows = [
        (2, trial, 0, end, 0.25, 18.0, "", 20.0, *found, 8.0, 20.0, 30.0, 10.0)
        for trial, found in after.items()
    ]
    header = [*columns, *judges, *(f"{judge}:equal" for judge in judges)]
    lines = [",".join(map(str, row)) for row in (header, *rows)]
    (tmp_path / "guards-02-0.csv").write_text("\n".join(lines), encoding="utf-8")
    written = evidence.section()
    # Other worlds: the mean of +1, +1.5 and +1, and that of 0, -1 and 0.
    assert "| 2 | plain | -2.00 | +1.00 (0 of 1) | +1.17 (0 of 1) | 0.25 |" in written
    assert "| 2 | shrinkage 0.05 | -2.00 | +1.50 (0 of 1) | -0.33 (1 of 1) | 0.25 |" in written
    assert f"| 2 | {end} | -2.00 | +1.00 (0 of 1) | +1.17 (0 of 1) | 0.25 |" in written
    assert "real AnyNet" not in written
