"""What a model foretold beside what came, from a search and from its journal; the coverage of intervals."""

from __future__ import annotations

import json
import math
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.stats import binom, norm

sys.path.insert(0, str(Path(__file__).parents[1] / "figures"))
sys.path.insert(0, str(Path(__file__).parents[1] / "search"))
from figure_records import told
from search_landscapes import BLOCKS, Scorer, names, subset_landscape

from sfkit import analysis
from sfkit.analysis.evolution import evolution
from sfkit.analysis.predictions import Predictions
from sfkit.errors import InputError
from sfkit.evaluation.known import Known
from sfkit.merging.recipe import Recipe
from sfkit.search import Journal, read_journal
from sfkit.search.bayesian_routing import BayesianRoutingSearch
from sfkit.search.bayesian_settings import BayesianRoutingSettings, BayesianSubsetSettings
from sfkit.search.bayesian_subset import BayesianSubsetSearch
from sfkit.search.subset import SubsetSearch, SubsetSettings

SCORE = subset_landscape(5, 1)


def same(one: Predictions, other: Predictions) -> bool:
    columns = ("number", "mean", "sd", "bound", "score", "best")
    alike = [np.array_equal(getattr(one, name), getattr(other, name)) for name in columns]
    return all(alike) and (one.metric, one.learned) == (other.metric, other.learned)


def test_a_search_and_its_journal_tell_the_same_which_is_the_history(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    known = (Known(Recipe.equal(names(5), BLOCKS), SCORE(names(5))),)
    first = BayesianSubsetSearch(
        names(5),
        BLOCKS,
        Scorer(lambda recipe: SCORE(recipe.sources)),
        BayesianSubsetSettings(population=4, generations=5),
        known=known,
        journal=Journal(journal),
    )
    first.run()
    second = BayesianRoutingSearch(
        first.best.subset,  # type: ignore[union-attr]
        BLOCKS,
        Scorer(lambda recipe: sum(recipe.scales) + recipe.weights[0][0]),
        BayesianRoutingSettings(evaluations=6),
        journal=Journal(journal),
    )
    second.run()
    for search in (first, second):
        found = analysis.predictions(search, metric="epe")
        assert same(found, analysis.watched_predictions(read_journal(journal), search.kind, metric="epe"))
        table = search.history.dropna(subset=["predicted_mean"])
        assert found.number.tolist() == table["candidate"].tolist()
        for name, column in (("mean", "predicted_mean"), ("sd", "predicted_sd"), ("bound", "acquisition")):
            assert getattr(found, name).tolist() == table[column].tolist()
        scored = [c for c in search.candidates if len(c.subset) > 1]
        for number, best in zip(found.number, found.best, strict=True):
            assert best == min(c.score for c in scored if c.number < number), "a source alone wins nothing"
    assert analysis.predictions(first).learned == 1
    # What is not of two sources is not among the best subsets either.
    assert all(len(evolution(first).individuals[n].subset) > 1 for n in evolution(first).archive)


def test_the_paper_s_search_and_old_journals_tell_nothing(tmp_path: Path) -> None:
    journal = tmp_path / "journal.jsonl"
    settings = SubsetSettings(population=4, generations=1)
    scorer = Scorer(lambda recipe: SCORE(recipe.sources))
    search = SubsetSearch(names(5), BLOCKS, scorer, settings, journal=Journal(journal))
    search.run()
    assert "predicted" not in journal.read_text()
    assert (
        len(analysis.predictions(search))
        == len(analysis.watched_predictions(read_journal(journal), "subset"))
        == 0
    )
    records = [json.loads(json.dumps(record)) for record in read_journal(journal)]
    with pytest.raises(InputError, match=r"found no scored proposal of a model.*--method bayesian"):
        analysis.calibration(analysis.watched_predictions(records, "subset"))


def test_coverage_counts_what_the_normal_intervals_hold() -> None:
    found = analysis.calibration(told(), levels=(0.5, 0.9, 0.95, 0.99))
    # Apart by 0, 1, 2, 0 and 3 deviations; intervals reach 0.67, 1.64, 1.96 and 2.58 of them.
    assert found.coverage == (0.4, 0.6, 0.6, 0.8)
    assert [norm.interval(level)[1] for level in (0.5, 0.99)] == pytest.approx([0.674, 2.576], abs=1e-3)
    assert found.failed == 1
    assert found.error == pytest.approx(0.5 * (0 + 1 - 2 + 0 + 3) / 5)
    assert found.rms == pytest.approx(math.sqrt(0.25 * (1 + 4 + 9) / 5))
    expected = [tuple(binom.ppf([0.025, 0.975], 5, level) / 5) for level in (0.5, 0.9, 0.95, 0.99)]
    np.testing.assert_allclose(found.honest, expected)
    assert found.correlation == pytest.approx(np.corrcoef(found.mean, found.score)[0, 1])
    one = replace(
        told(), **{n: getattr(told(), n)[:1] for n in ("number", "mean", "sd", "bound", "score", "best")}
    )
    assert math.isnan(analysis.calibration(one).correlation)
    with pytest.raises(InputError, match="levels: found 95, expected shares between 0 and 1"):
        analysis.calibration(told(), levels=(95,))
