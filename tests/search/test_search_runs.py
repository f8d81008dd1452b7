"""Runs read back from journals, and evaluations moved between stores."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pandas as pd
import pytest

from sfkit.errors import InputError
from sfkit.evaluation.exchange import evaluation_table, export_evaluations, import_evaluations
from sfkit.evaluation.metrics import ImageErrors, RegionErrors
from sfkit.evaluation.outcome import Outcome
from sfkit.evaluation.store import Evaluation, EvaluationStore, evaluation_key
from sfkit.merging.recipe import Recipe
from sfkit.search import Journal, RoutingSearch, RoutingSettings, SubsetSearch, SubsetSettings
from sfkit.search.run_folder import OUTPUTS, STORE, run_folder
from sfkit.search.runs import State, find_runs, read_run, run_differences, run_rows

NAMES, BLOCKS = ("a", "b", "c"), ("x",)


def scorer(recipes: Sequence[Recipe]) -> list[Outcome]:
    """More sources score worse; the first block's scale moves the score a little."""
    return [Outcome(10.0 * len(r.sources) + r.scales[0], seconds=0.5) for r in recipes]


def run(folder: Path, *, seed: int, stop_after: int | None = None) -> SubsetSearch:
    folder.mkdir(parents=True)
    journal = Journal(folder / "journal.jsonl")
    first = SubsetSearch(
        NAMES, BLOCKS, scorer, SubsetSettings(population=4, generations=3, seed=seed), journal=journal
    )
    for generation in first:
        if generation.number == stop_after:
            return first
    settings = RoutingSettings(evaluations=9, seed=seed)
    RoutingSearch(NAMES[:2], BLOCKS, scorer, settings, journal=journal).run()
    return first


def test_a_finished_run_reads_back_as_it_was(tmp_path: Path) -> None:
    search = run(tmp_path / "one", seed=1)
    (first, second) = read_run(tmp_path / "one").stages
    assert (first.stage, second.stage) == ("Stage 1", "Stage 2")
    assert first.state is second.state is State.FINISHED
    assert search.best is not None
    assert first.score == search.best.score == 21.0
    assert first.subset == search.best.subset
    assert first.counts["distinct"] == search.counts.distinct
    assert second.counts["candidates"] == 9


def test_an_interrupted_run_is_open(tmp_path: Path) -> None:
    run(tmp_path / "one", seed=1, stop_after=1)
    (only,) = read_run(tmp_path / "one").stages
    assert (only.state, only.reason, only.generation) == (State.OPEN, None, 1)


def test_the_list_has_a_row_a_stage(tmp_path: Path) -> None:
    run(tmp_path / "deep" / "one", seed=1)
    run(tmp_path / "two", seed=2, stop_after=0)
    assert sorted((row["stage"], row["state"]) for row in run_rows(find_runs(tmp_path))) == [
        ("Stage 1", "finished"), ("Stage 1", "open"), ("Stage 2", "finished"),
    ]  # fmt: skip
    assert run_rows([]) == []


def test_a_difference_in_settings_is_shown(tmp_path: Path) -> None:
    run(tmp_path / "one", seed=1)
    run(tmp_path / "two", seed=2)
    heads, rows = run_differences(read_run(tmp_path / "one"), read_run(tmp_path / "two"))
    assert heads == ["stage", "what", str(tmp_path / "one"), str(tmp_path / "two"), "differs"]
    assert ("Stage 1", "settings.seed", "1", "2", True) in rows
    assert "settings.population" not in {row[1] for row in rows}, "equal settings are left out"


def test_refusals(tmp_path: Path) -> None:
    run(tmp_path / "garage", seed=1, stop_after=0)
    with pytest.raises(InputError, match="did you mean 'garage'"):
        read_run(tmp_path / "garag")
    with pytest.raises(InputError, match="named twice"):
        run_differences(read_run(tmp_path / "garage"), read_run(tmp_path / "garage"))
    with pytest.raises(InputError, match="no such folder"):
        find_runs(tmp_path / "none")


def evaluation(name: str, bad: int = 3, failure: str | None = None) -> Evaluation:
    image = ImageErrors("one", (1.0,), 0, {"all": RegionErrors(20, 10.0, (bad,), 1)})
    about = {"protocol": "raft", "recipe": {}, "name": name}
    return Evaluation(evaluation_key(about), about, () if failure else (image,), failure, 2.0)


def test_evaluations_as_a_table(tmp_path: Path) -> None:
    with EvaluationStore(tmp_path / "s.sqlite") as store:
        store.put(evaluation("k1"))
        store.put(evaluation("k2", failure="RuntimeError: no"))
        table = evaluation_table(store)
        path = export_evaluations(store, tmp_path / "out" / "e.csv")
        with pytest.raises(InputError, match="the file exists"):
            export_evaluations(store, path)
        with pytest.raises(InputError, match=r"expected \.csv or \.parquet"):
            export_evaluations(store, tmp_path / "e.xls")
    assert table.loc[0, ["epe", "d1", "bad-1.0"]].tolist() == [0.5, 5.0, 15.0]
    assert table.loc[1, "failure"] == "RuntimeError: no"
    assert len(pd.read_csv(path)) == 2


def test_importing_keeps_what_is_there(tmp_path: Path) -> None:
    with EvaluationStore(tmp_path / "a.sqlite") as source, EvaluationStore(tmp_path / "b.sqlite") as target:
        for key in ("k1", "k2"):
            source.put(evaluation(key, bad=7))
        source.put(evaluation("k3"))
        target.put(evaluation("k1", bad=3))
        target.put(evaluation("k3", failure="lost its worker"))
        assert import_evaluations(source, target) == (2, 1)
        assert import_evaluations(source, target) == (0, 3)
        held = {e.description["name"]: e for e in target}
    assert held["k1"].images[0].above(1.0) == 3, "the first score written is the truth"
    assert held["k3"].failure is None, "a score takes the place of a failure"


def test_nothing_of_another_search_passes_as_the_one_that_replaced_it(tmp_path: Path) -> None:
    folder = tmp_path / "run"
    with run_folder(folder, {"seed": 1}):
        for name in OUTPUTS:
            (folder / name).write_text("of seed 1")
        (folder / STORE).write_text("evaluations")
    with run_folder(folder, {"seed": 1}, force=True):
        assert all((folder / name).exists() for name in OUTPUTS), "the same search goes on"
    with pytest.raises(InputError, match="holds another search"), run_folder(folder, {"seed": 2}):
        pass
    with run_folder(folder, {"seed": 2}, force=True):
        assert [name for name in OUTPUTS if (folder / name).exists()] == []
        assert (folder / STORE).read_text() == "evaluations", "what was computed is kept"
