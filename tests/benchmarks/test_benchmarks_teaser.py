"""Tables of any bank: retraining beside merging."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest
from benchmark_scripts import imported


@pytest.fixture(scope="module")
def teaser() -> Iterator[ModuleType]:
    with imported("teaser") as (module,):
        yield module


def test_each_bank_that_was_measured_has_its_table(
    teaser: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(teaser, "FOLDER", tmp_path)
    with pytest.raises(SystemExit, match="nothing is measured yet"):
        teaser.section()
    rows = {"way": ["joint retraining", "uniform"], "mean (%)": [9.0, 10.25], "CPU seconds": [math.nan, 90.5]}
    pd.DataFrame(rows).to_csv(tmp_path / "bank-slim.csv", index=False)
    text = teaser.section()
    assert "### `bank-slim`" in text
    assert "| uniform | 10.25 | 90.50 |" in text
    assert "| joint retraining | 9.00 | – |" in text, "CPU seconds that nobody measured"
    assert "### `bank-sharp`" not in text
    pd.DataFrame(rows).to_csv(tmp_path / "bank-sharp.csv", index=False)
    assert "### `bank-sharp`" in teaser.section()
