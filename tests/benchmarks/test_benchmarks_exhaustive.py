"""The table of all subsets: complete, what the evaluator says of them, and what a search finds on it."""

from __future__ import annotations

import statistics
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import ModuleType

import pytest
from benchmark_scripts import imported

from sfkit import Evaluator, InputError, bank, open_pool
from sfkit.evaluation import EvaluationStore
from sfkit.evaluation.outcome import Outcome
from sfkit.merging import Recipe
from sfkit.search import BayesianSubsetSearch, BayesianSubsetSettings

ROWS = (1, 0b10000100101, 0b11111111111)
"""A source alone, the merge of four, and of all."""


@pytest.fixture(scope="module")
def exhaustive() -> Iterator[ModuleType]:
    with imported("exhaustive") as (module,):
        yield module


@pytest.mark.parametrize("name", ["bank", "bank-sharp"])
def test_every_subset_of_a_shipped_bank_has_its_scores(exhaustive: ModuleType, name: str) -> None:
    table = exhaustive.subset_scores(exhaustive.table_path(name))
    assert table.names == open_pool(bank.pool_path(name)).names
    assert set(table.scores) == set(table.quick) == set(range(1, 2**11))
    assert all(0 < score < 100 for score in (*table.scores.values(), *table.quick.values()))
    assert exhaustive.table_path(name).stat().st_size < 200_000


def test_a_mask_names_a_subset(exhaustive: ModuleType) -> None:
    table = exhaustive.subset_scores()
    assert table.members(0b10000000101) == ("far-scene", "thin-things", "scanned-street")
    assert table.mask(("scanned-street", "far-scene", "thin-things")) == 0b10000000101


def test_rows_are_what_the_evaluator_says(exhaustive: ModuleType, tmp_path: Path) -> None:
    """Image by image as the evaluator, which runs one pair at a time; another machine may round otherwise."""
    pool = open_pool(bank.pool_path())
    table = exhaustive.subset_scores()
    with EvaluationStore(tmp_path / "store.sqlite") as store, EvaluationStore(":memory:") as empty:
        found = exhaustive.score_subsets(pool, ROWS, store)
        scorer = Evaluator(pool, bank.benchmark(bank.VALIDATION).first(exhaustive.PAIRS), store=empty)
        evaluations = scorer.evaluate([pool.equal(*table.members(mask)) for mask in ROWS[:2]])
        for evaluation in evaluations:
            held = store.get(evaluation.key)
            assert held is not None
            assert [image.to_dict() for image in held.images] == [i.to_dict() for i in evaluation.images]
        assert exhaustive.score_subsets(pool, ROWS, store) == found
        assert [store.attempts(evaluation.key) for evaluation in store] == [1, 1, 1]
    for mask in ROWS:
        assert found.scores[mask] == pytest.approx(table.scores[mask], abs=0.02)
        assert found.quick[mask] == pytest.approx(table.quick[mask], abs=0.02)
    exhaustive.write_scores(found, tmp_path / "table.csv")
    again = exhaustive.subset_scores(tmp_path / "table.csv")
    assert again.scores == pytest.approx(found.scores, abs=1e-4)
    assert again.quick == pytest.approx(found.quick, abs=1e-4)


def test_a_row_of_the_sharp_bank_is_its_own(exhaustive: ModuleType) -> None:
    table, mask = exhaustive.subset_scores(exhaustive.table_path("bank-sharp")), 0b10000100000
    found = exhaustive.score_subsets(open_pool("bank-sharp"), [mask])
    assert found.scores[mask] == pytest.approx(table.scores[mask], abs=0.02)
    assert found.quick[mask] == pytest.approx(table.quick[mask], abs=0.02)


def test_the_sharp_banks_page_says_what_its_table_says(exhaustive: ModuleType) -> None:
    table = exhaustive.subset_scores(exhaustive.table_path("bank-sharp"))
    merges = {mask: score for mask, score in table.scores.items() if mask.bit_count() >= 2}
    best = min(merges, key=merges.__getitem__)
    assert len(merges) == 2036
    assert table.members(best) == ("uneven-exposure", "scanned-street")
    page = (Path(__file__).parents[2] / "docs" / "bank.md").read_text(encoding="utf-8")
    alone = table.scores[table.mask(["scanned-street"])]
    section = " ".join(page.split("## Every subset")[1].split("\n## ")[0].split())
    assert f"has {merges[best]:.2f} % and scanned-street alone {alone:.2f};" in section
    median, worst = statistics.median(merges.values()), max(merges.values())
    assert f"half of all merges are above {median:.2f}, the worst has {worst:.2f}." in section


def test_another_file_is_refused(exhaustive: ModuleType, tmp_path: Path) -> None:
    path = tmp_path / "table.csv"
    path.write_text("mask,score,other\n1,2.0,3.0\n")
    with pytest.raises(InputError, match=r"table\.csv: found the columns .* expected \['subset', 'pairs_20'"):
        exhaustive.subset_scores(path)
    with pytest.raises(InputError, match=r"none\.csv: cannot be read as a table of subsets"):
        exhaustive.subset_scores(tmp_path / "none.csv")


@pytest.mark.parametrize(
    ("name", "quick", "generations"),
    [("bank", False, 41), ("bank", True, 71), ("bank-sharp", False, 11)],
)
def test_the_model_finds_the_best_subset_in_60_evaluations_or_90(
    exhaustive: ModuleType, name: str, quick: bool, generations: int
) -> None:
    table = exhaustive.subset_scores(exhaustive.table_path(name))
    scores = table.quick if quick else table.scores

    def scorer(recipes: Sequence[Recipe]) -> list[Outcome]:
        return [Outcome(scores[table.mask(recipe.sources)]) for recipe in recipes]

    best = min(score for mask, score in scores.items() if mask.bit_count() >= 2)
    for seed in range(2):
        settings = BayesianSubsetSettings(generations=generations, seed=seed)
        search = BayesianSubsetSearch(table.names, ("backbone", "volume", "head"), scorer, settings)
        assert search.run().score == best
        assert search.counts.distinct == 19 + generations
