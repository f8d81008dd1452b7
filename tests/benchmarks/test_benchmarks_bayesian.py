"""The benchmark of model-based searches counts what the search itself counts."""

from __future__ import annotations

import sys
from importlib import import_module
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


def test_it_finds_the_bank_s_best_subset_and_counts_rounds(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    bayesian = import_module("bayesian")
    (row,) = bayesian.compare(2, (4,))
    assert row.median <= row.most <= 60
    assert row.within == (1.0, 1.0)
    assert (row.median - 19) / 4 <= row.waits <= (row.most - 19) / 4 + 2
    assert "| 4 | 2 |" in bayesian.table([row])
    sys.modules.pop("bayesian")
