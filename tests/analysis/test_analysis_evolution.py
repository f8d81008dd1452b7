"""Sizes, diversity and the archive against hand values; a journal tells the same as the search."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

sys.path.insert(0, str(Path(__file__).parents[1] / "search"))
from search_landscapes import BLOCKS, Scorer, names, subset_landscape

from sfkit import Journal, SubsetSearch, SubsetSettings
from sfkit.analysis.evolution import evolution, jaccard_diversity, watched_evolution
from sfkit.errors import InputError
from sfkit.search.journal import read_journal


def test_diversity_by_hand() -> None:
    # {a b} and {b c} share 1 of 3, {a b} and {c d} nothing, {b c} and {c d} 1 of 3.
    members = np.array([[1, 1, 0, 0], [0, 1, 1, 0], [0, 0, 1, 1]], dtype=bool)
    assert jaccard_diversity(members) == pytest.approx((2 / 3 + 1 + 2 / 3) / 3)
    assert jaccard_diversity(members[[0, 0, 0]]) == 0.0
    assert jaccard_diversity(members[:1]) == 0.0


def search(journal: Journal | None = None) -> SubsetSearch:
    score = subset_landscape(6, 0)
    scorer = Scorer(lambda recipe: float("inf") if len(recipe.sources) == 3 else score(recipe.sources))
    settings = SubsetSettings(population=8, generations=4, seed=2)
    return SubsetSearch(names(6), BLOCKS, scorer, settings, journal=journal)


def test_it_is_what_the_search_did(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    run = search(journal)
    with pytest.raises(InputError, match="no generation yet"):
        evolution(run)
    run.run()
    found = evolution(run, metric="epe")
    assert [one.number for one in found.individuals] == list(range(len(run.candidates)))
    for group, population in zip(found.populations, run.state.populations, strict=True):
        assert sorted(group) == sorted(population)
        assert [found.individuals[n].score for n in group] == sorted(run.candidates[n].score for n in group)
    last = [len(candidate.subset) for candidate in run.population]
    assert found.sizes[-1] == (min(last), sum(last) / len(last), max(last))
    assert found.archive == tuple(candidate.number for candidate in run.archive())
    assert found.history.metric == "epe"
    assert watched_evolution(read_journal(journal.path), metric="epe") == found


def test_a_journal_without_stage_1_is_refused(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    journal.write("start", search="routing")
    with pytest.raises(InputError, match="no generation of a subset search"):
        watched_evolution(read_journal(journal.path))
