"""The table of all subsets: complete, and what the evaluator says of them on this machine."""

from __future__ import annotations

from pathlib import Path

import pytest

from sfkit import Evaluator, InputError, bank, open_pool
from sfkit.bank.exhaustive import PAIRS, score_subsets, subset_scores, table_path, write_scores
from sfkit.evaluation import EvaluationStore

ROWS = (1, 0b10000100101, 0b11111111111)
"""A source alone, the merge of four, and of all."""


def test_every_subset_of_the_shipped_bank_has_its_scores() -> None:
    table = subset_scores()
    assert table.names == open_pool(bank.pool_path()).names
    assert set(table.scores) == set(table.quick) == set(range(1, 2**11))
    assert all(0 < score < 100 for score in (*table.scores.values(), *table.quick.values()))
    assert table_path().stat().st_size < 200_000


def test_a_mask_names_a_subset() -> None:
    table = subset_scores()
    assert table.members(0b10000000101) == ("far-scene", "thin-things", "scanned-street")
    assert table.mask(("scanned-street", "far-scene", "thin-things")) == 0b10000000101


def test_rows_are_what_the_evaluator_says(tmp_path: Path) -> None:
    """Image by image as the evaluator, which runs one pair at a time; another machine may round otherwise."""
    pool = open_pool(bank.pool_path())
    table = subset_scores()
    with EvaluationStore(tmp_path / "store.sqlite") as store, EvaluationStore(":memory:") as empty:
        found = score_subsets(pool, ROWS, store)
        scorer = Evaluator(pool, bank.benchmark(bank.VALIDATION).first(PAIRS), store=empty)
        evaluations = scorer.evaluate([pool.equal(*table.members(mask)) for mask in ROWS[:2]])
        for evaluation in evaluations:
            held = store.get(evaluation.key)
            assert held is not None
            assert [image.to_dict() for image in held.images] == [i.to_dict() for i in evaluation.images]
        assert score_subsets(pool, ROWS, store) == found
        assert [store.attempts(evaluation.key) for evaluation in store] == [1, 1, 1]
    for mask in ROWS:
        assert found.scores[mask] == pytest.approx(table.scores[mask], abs=0.02)
        assert found.quick[mask] == pytest.approx(table.quick[mask], abs=0.02)
    write_scores(found, tmp_path / "table.csv")
    again = subset_scores(tmp_path / "table.csv")
    assert again.scores == pytest.approx(found.scores, abs=1e-4)
    assert again.quick == pytest.approx(found.quick, abs=1e-4)


def test_another_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("mask,score,other\n1,2.0,3.0\n")
    with pytest.raises(InputError, match=r"table\.csv: found the columns .* expected \['subset', 'pairs_20'"):
        subset_scores(path)
    with pytest.raises(InputError, match=r"none\.csv: cannot be read as a table of subsets"):
        subset_scores(tmp_path / "none.csv")
