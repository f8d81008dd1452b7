"""The AnyNet benchmark runs and reports what it says; it asserts no times."""

from __future__ import annotations

import runpy
from pathlib import Path
from typing import Any

import pytest
import torch

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "sections" / "anynet_speed.py"


@pytest.fixture(scope="module")
def benchmark() -> dict[str, Any]:
    return runpy.run_path(str(SCRIPT))


def test_every_size_and_number_of_threads_is_measured(benchmark: dict[str, Any]) -> None:
    before = torch.get_num_threads()
    records = benchmark["measure"](sizes=[(32, 48), (16, 64)], threads=[1], repeats=1)
    assert [(r.height, r.width, r.threads) for r in records] == [(32, 48, 1), (16, 64, 1)]
    assert all(r.plain_ms > 0 and r.fast_ms > 0 for r in records)
    assert torch.get_num_threads() == before


def test_ratio_is_plain_over_fast(benchmark: dict[str, Any]) -> None:
    record = benchmark["RouteTimes"](height=256, width=512, threads=1, plain_ms=90.0, fast_ms=30.0)
    assert record.ratio == pytest.approx(3.0)


def test_the_section_has_a_row_a_record(benchmark: dict[str, Any], monkeypatch: pytest.MonkeyPatch) -> None:
    record = benchmark["RouteTimes"](height=256, width=512, threads=1, plain_ms=90.0, fast_ms=30.0)
    monkeypatch.setitem(benchmark["section"].__globals__, "measure", lambda: [record])
    assert "| 256 x 512 | 1 | 90.0 | 30.0 | 3.00 |" in benchmark["section"]()
