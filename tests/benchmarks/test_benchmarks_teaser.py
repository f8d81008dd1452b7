"""Tables of any bank: retraining beside merging, and the verdict's rules."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest
from benchmark_scripts import imported

from sfkit.bank import banks
from sfkit.errors import InputError


@pytest.fixture(scope="module")
def scripts() -> Iterator[tuple[ModuleType, ...]]:
    with imported("teaser", "verdict_rules") as modules:
        yield modules


def test_each_bank_that_was_measured_has_its_table(
    scripts: tuple[ModuleType, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    teaser = scripts[0]
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


def test_a_bank_of_another_name_has_runs_of_its_own(scripts: tuple[ModuleType, ...]) -> None:
    rules = scripts[1]
    first, other = rules.kept_of(), rules.kept_of("bank-slim")
    assert first.folder.name == "rules"
    assert other.folder.name == "rules-bank-slim"
    names = list(other.jobs())
    assert len(names) >= 10
    assert all(name.startswith("bank-slim-") for name in names)
    with pytest.raises(InputError, match="unknown embedded bank 'bank-slem'"):
        rules.kept_of("bank-slem").jobs()["bank-slem-03-0"](Path("nowhere"))
    assert "bank-slim" in banks()


def test_the_section_has_a_table_for_every_bank_with_runs(
    scripts: tuple[ModuleType, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    rules = scripts[1]
    monkeypatch.setattr(rules, "RUNS", tmp_path)
    monkeypatch.setattr(rules, "kept", rules.kept_of())
    columns = {"rung": 3, "validation": 10.0, "validation:stage1": 11.0, "unseen:stage1": 20.0}
    rows = [{"rule": rule, "unseen": 20.0 - n, **columns} for n, rule in enumerate(rules.RULES)]
    (tmp_path / "rules-bank-slim").mkdir()
    pd.DataFrame(rows).to_csv(tmp_path / "rules-bank-slim" / "bank-slim-03-0.csv", index=False)
    text = rules.section()
    assert "### On `bank-slim`, bad-3.0, three other worlds unseen\n\n1 runs." in text
    assert "| bootstrap-averaged winner | 1 routed | -1.00 | -3.00 | -3.00 | 1 of 1 | -3.00, 1 of 1 |" in text
    assert "On the embedded bank" not in text
