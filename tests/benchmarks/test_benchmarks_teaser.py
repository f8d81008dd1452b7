"""Tables of any bank: retraining beside merging."""

from __future__ import annotations

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
    rows = {"way": ["joint retraining", "uniform"], "mean (%)": [9.0, 10.25], "seconds": [3600.0, 90.5]}
    pd.DataFrame(rows).to_csv(tmp_path / "bank-slim.csv", index=False)
    text = teaser.section()
    assert "### `bank-slim`" in text
    assert "| uniform | 10.25 | 90.50 |" in text
    assert "of a processor" not in text, "no joint training of this bank is recorded"
    pd.DataFrame(rows).to_csv(tmp_path / "bank-sharp.csv", index=False)
    assert "of a processor joint training took 2,927 s, the longest fine-tuning 311 s" in teaser.section()
