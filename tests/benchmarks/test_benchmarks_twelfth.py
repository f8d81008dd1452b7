"""Pools that gain a twelfth source: their table is whole, and the pool is the bank and the newcomer."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest
from benchmark_scripts import imported
from safetensors.torch import save_file

import sfkit
from sfkit.bank.measure import held_out_pairs
from sfkit.bank.plan import TrainingPlan
from sfkit.evaluation import EvaluationStore


@pytest.fixture(scope="module")
def scripts() -> Iterator[tuple[ModuleType, ...]]:
    with imported("twelfth", "optimum", "exhaustive") as modules:
        yield modules


def test_every_subset_of_twelve_has_its_scores(scripts: tuple[ModuleType, ...]) -> None:
    twelfth, _, exhaustive = scripts
    assert twelfth.TABLE.stat().st_size < 300_000
    eleven = exhaustive.subset_scores()
    for newcomer in twelfth.NEWCOMERS:
        table = twelfth.grown_scores(newcomer)
        assert table.names == (*eleven.names, newcomer)
        assert set(table.scores) == set(table.quick) == set(range(1, 2**12))
        assert all(table.scores[mask] == score for mask, score in eleven.scores.items())
        assert all(0 < score < 100 for score in (*table.scores.values(), *table.quick.values()))


def test_the_newcomer_is_the_last_source_of_the_banks_pool(
    scripts: tuple[ModuleType, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Another checkpoint in the place of the one that training would write: the mean of two of the bank's."""
    twelfth, _, exhaustive = scripts
    monkeypatch.setattr(twelfth, "FOLDER", tmp_path)
    eleven = sfkit.open_pool("bank")
    save_file(eleven.state_dict(eleven.equal("haze", "soft-focus")), tmp_path / "dusk.safetensors")
    pool = twelfth.grown_pool(twelfth.NEWCOMERS["dusk"])
    assert pool.names == (*eleven.names, "dusk")
    assert list(twelfth.with_newcomer(("a", "b", "c"))) == [0b100, 0b101, 0b110, 0b111]
    found = exhaustive.score_subsets(pool, [1 << 11], EvaluationStore(":memory:"))
    table = exhaustive.subset_scores()
    assert found.scores[1 << 11] == pytest.approx(table.scores[table.mask(["haze", "soft-focus"])], abs=0.02)


def test_a_training_is_told_by_what_it_gained_in_its_own_world(
    scripts: tuple[ModuleType, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    twelfth = scripts[0]
    monkeypatch.setattr(twelfth, "FOLDER", tmp_path)
    monkeypatch.setattr(twelfth, "PLAN", TrainingPlan(steps=2, peak_rate=1e-3, scenes=6))
    monkeypatch.setattr(twelfth, "held_out_pairs", lambda world: held_out_pairs(world, 1))
    path = twelfth.trained(twelfth.NEWCOMERS["dusk"])
    said = capsys.readouterr().out
    assert "base in its world: EPE " in said
    assert "dusk in its world: EPE " in said
    before = path.read_bytes()
    assert twelfth.trained(twelfth.NEWCOMERS["dusk"]).read_bytes() == before
    assert capsys.readouterr().out == "", "nothing is trained twice"


def test_a_newcomer_is_searched_for_in_every_way(
    scripts: tuple[ModuleType, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    twelfth, optimum, _ = scripts
    found = optimum.gained(20, 0, tmp_path)
    assert set(found["newcomer"]) == set(twelfth.NEWCOMERS)
    assert len(found) == len(twelfth.NEWCOMERS) * len(optimum.GROWN)
    rows = found.set_index(["newcomer", "way"])["needed"]
    for newcomer in twelfth.NEWCOMERS:
        assert rows[newcomer, optimum.GROWN[1]] <= rows[newcomer, optimum.GROWN[0]]


def test_the_section_says_what_a_newcomer_is_worth(
    scripts: tuple[ModuleType, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    _, optimum, exhaustive = scripts
    monkeypatch.setattr(optimum, "kept", replace(optimum.kept, folder=tmp_path))
    eleven = exhaustive.subset_scores()
    best = min(score for mask, score in eleven.scores.items() if mask.bit_count() >= 2)
    gain = best - optimum.twelve("dusk", 20).best
    rows = {"pairs": 20, "seed": 0, "newcomer": "dusk", "way": optimum.GROWN, "needed": [30, 4, 99, 50, 40]}
    pd.DataFrame(rows).to_csv(tmp_path / "twelfth-20-000.csv", index=False)
    written = optimum.section()
    assert f"| dusk | {gain:.2f} | {optimum.GROWN[1]} | 1 | 100 % | 4 | 4 |" in written
    assert "On the first 8 validation pairs" not in written
