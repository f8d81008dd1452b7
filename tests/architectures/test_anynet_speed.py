"""The AnyNet benchmark runs and reports what it says; it asserts no times."""

from __future__ import annotations

import json
import runpy
from pathlib import Path
from typing import Any

import pytest
import torch

SCRIPT = Path(__file__).parents[2] / "benchmarks" / "anynet_speed.py"


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
    record = benchmark["Record"](height=256, width=512, threads=1, plain_ms=90.0, fast_ms=30.0)
    assert record.ratio == pytest.approx(3.0)


def test_json_is_one_list_of_records(
    benchmark: dict[str, Any], capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    record = benchmark["Record"](height=256, width=512, threads=1, plain_ms=90.0, fast_ms=30.0)
    monkeypatch.setitem(benchmark["main"].__globals__, "measure", lambda repeats: [record] * repeats)
    benchmark["main"](["--json", "--repeats", "2"])
    expected = {"height": 256, "width": 512, "threads": 1, "plain_ms": 90.0, "fast_ms": 30.0, "ratio": 3.0}
    assert json.loads(capsys.readouterr().out) == [expected] * 2
