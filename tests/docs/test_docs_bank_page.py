"""The sharp bank's page: the table it begins from, before and after, and what the joint network is beside."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from bank_page import before_and_after, introduction, joint_sentence, recorded_benchmarks
from bank_scores import UNIFORM, BankScores

from sfkit import bank

DOCS = Path(__file__).parents[2] / "docs"
WORLDS = list(bank.benchmarks())


def table(rows: dict[str, float]) -> pd.DataFrame:
    """Networks with one score on the validation benchmark and twice, thrice, four times that elsewhere."""
    return pd.DataFrame({name: [n * score for n in (1, 2, 3, 4)] for name, score in rows.items()}, WORLDS).T


def test_the_first_banks_table_is_read_as_recorded() -> None:
    before = recorded_benchmarks((DOCS / "bank_first.md").read_text(encoding="utf-8"))
    assert list(before.columns) == WORLDS
    assert list(before.index) == [*bank.domains(), UNIFORM]
    line = next(
        line for line in (DOCS / "bank_first.md").read_text().splitlines() if line.startswith("| haze |")
    )
    assert [f"{value:.1f}" for value in before.loc["haze"]] == [c.strip() for c in line.split("|")[2:6]]


def test_before_and_after_stand_beside_each_other() -> None:
    before = table({"plain": 10.0, "haze": 4.0, "far-scene": 8.0, UNIFORM: 5.0})
    after = table({"plain": 6.0, "haze": 7.0, "far-scene": 3.0, UNIFORM: 9.0, "joint": 2.0})
    found = before_and_after(before, after)
    assert list(found.index) == [
        "base, before",
        "base, after",
        "best single (haze), before",
        "best single (far-scene), after",
        "mean of single, before",
        "mean of single, after",
        "worst single (far-scene), before",
        "worst single (haze), after",
        "uniform, before",
        "uniform, after",
        "joint, after",
    ]
    assert list(found.iloc[:, 0]) == [10, 6, 4, 3, 6, 5, 8, 7, 5, 9, 2]
    assert found["mean of the unseen"].iloc[0] == pytest.approx(30.0)
    assert len(before_and_after(before, after.drop(index="joint"))) == 10


def test_the_joint_network_stands_beside_base_uniform_and_the_best_source() -> None:
    scores = table({"plain": 6.0, "haze": 7.0, "far-scene": 3.0, UNIFORM: 9.0, "joint": 2.0})
    said = joint_sentence(BankScores(scores, scores, scores, {"joint": {"cpu_seconds": 3000.0}}))
    assert "50 CPU minutes" in said
    assert (
        "has 6.0 % there; base 18.0 %, all merged equally 27.0 %, the best source (far-scene) 9.0 %." in said
    )


def test_the_introduction_shows_both_banks() -> None:
    assert "| base | 2,000 steps of 6 on 300 scenes | 20,000 steps" in introduction()
