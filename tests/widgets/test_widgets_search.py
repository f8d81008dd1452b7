"""Traits and commands of the widgets that watch searches, without a browser."""

from __future__ import annotations

import gc
import json
import subprocess
import sys
import threading
import weakref
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
import traitlets
from browser_search import SOURCES, routing_search, searches_by_model, subset_search
from sfkit_widgets import PopulationView, RoutingView, SearchControl, watch
from sfkit_widgets._publisher import PULSE, Publisher
from sfkit_widgets._sources import JournalSource
from sfkit_widgets.search_control import ALLOWED, shown_progress

from sfkit import analysis
from sfkit.errors import InputError
from sfkit.search.following import FollowedJournal
from sfkit.search.live import LiveSearch
from sfkit.search.progress import Phase

PATIENCE = 300.0


@pytest.fixture
def made() -> Iterator[list[Any]]:
    """Widgets a test makes; closed afterwards, so that the publisher's thread ends."""
    widgets: list[Any] = []
    yield widgets
    for widget in widgets:
        widget.close()


def tell(widget: Any, command: str, sequence: int = 1) -> None:
    """What arrives when a button is pressed."""
    message = {"command": command, "arguments": {}, "view": "v", "sequence": sequence}
    widget._receive(widget, message, [])


def until(widget: Any, trait: str, met: Callable[[Any], bool]) -> None:
    """Wait until the publisher has brought a trait so far."""
    there = threading.Event()

    def look(_change: object = None) -> None:
        if met(getattr(widget, trait)):
            there.set()

    widget.observe(look, trait)
    look()
    assert there.wait(PATIENCE)


def test_the_buttons_do_what_they_say(made: list[Any]) -> None:
    search, scorer = subset_search()
    made += [control := SearchControl(search), view := PopulationView(search)]
    assert control.progress["allowed"] == ["run", "step"]
    assert view.evolution == {}
    tell(control, "step")
    assert control.progress["phase"] == "running"
    assert control.acknowledged == {"v": 1}
    scorer.open(1)
    until(control, "progress", lambda shown: shown["phase"] == "paused")
    until(view, "evolution", lambda shown: shown.get("generations") == [0])
    tell(control, "run", 2)
    assert scorer.inside.wait(PATIENCE)
    tell(control, "pause", 3)
    assert control.progress["phase"] == "pausing"
    scorer.open(1)
    until(control, "progress", lambda shown: shown["phase"] == "paused")
    assert search.generation == 1
    tell(control, "stop", 4)
    until(control, "progress", lambda shown: shown["phase"] == "stopped")
    scorer.open()
    tell(control, "run", 5)
    until(control, "progress", lambda shown: shown["phase"] == "finished")
    until(view, "evolution", lambda shown: shown["generations"] == list(range(6)))
    assert control.progress["allowed"] == []
    assert control.progress["says"] == "Finished: all 5 generations are done."
    assert control.progress["best"]["candidate"] == search.best.number
    assert control.live is LiveSearch.of(search)


def test_a_search_stepped_in_a_cell_is_followed(made: list[Any]) -> None:
    search, _ = subset_search(permits=10)
    made += [control := SearchControl(search), view := PopulationView(search)]
    search.run()
    until(view, "evolution", lambda shown: shown.get("generations") == list(range(6)))
    until(control, "progress", lambda shown: shown["phase"] == "finished")


def test_what_the_scorer_raises_appears_until_it_runs_again(made: list[Any]) -> None:
    search, scorer = subset_search(permits=100)
    scorer.broken = True
    made.append(control := SearchControl(search))
    tell(control, "run")
    until(control, "error", lambda error: error == "OSError: the disk is full")
    assert control.progress["phase"] == "failed"
    scorer.broken = False
    tell(control, "run", 2)
    until(control, "progress", lambda shown: shown["phase"] == "finished")
    assert control.error == ""


def test_every_phase_has_words_and_buttons() -> None:
    search, _ = subset_search()
    now = LiveSearch(search).progress()
    for phase in Phase:
        shown = shown_progress(replace(now, phase=phase, left=5000.0), "epe")
        assert shown["says"]
        assert shown["allowed"] == list(ALLOWED[phase])
    assert dict(shown["figures"])["left at most"] == "1 h 23 min"
    assert shown_progress(now, None, watched=True)["allowed"] == []


def test_the_population_is_that_of_the_static_figure(made: list[Any]) -> None:
    search, _ = subset_search(permits=10)
    search.run()
    made.append(view := PopulationView(search, archive=3, metric="epe"))
    shown, history = view.evolution, analysis.population_history(search, metric="epe")
    assert shown["sources"] == list(SOURCES)
    assert shown["metric"] == "EPE (px)"
    assert shown["best"] == pytest.approx(history.best, rel=1e-5)
    assert shown["share"] == [pytest.approx(row, abs=1e-4) for row in history.share]
    assert shown["populations"][-1] == [one.number for one in history.individuals]
    assert shown["archive"] == [candidate.number for candidate in search.archive(3)]
    person = shown["people"][str(shown["archive"][0])]
    assert [SOURCES[n] for n in person["sources"]] == list(search.best.subset)
    assert person["score"] == f"{search.best.score:.2f} px"
    for person in shown["people"].values():
        if person["generation"] is not None:
            assert all(str(parent) in shown["people"] for parent in person["parents"])
    assert any(person["score"] == "failed" for person in shown["people"].values())


@pytest.mark.parametrize("tied", [True, False])
def test_the_routing_is_that_of_the_static_figure(made: list[Any], tied: bool) -> None:
    search, _ = routing_search(permits=100, tied=tied)
    search.run()
    made.append(view := RoutingView(search))
    shown, trace = view.trace, analysis.routing_trace(search)
    assert shown["drawn"] == list(range(40))
    assert shown["best"] == trace.best
    assert len(shown["weights"][0]) == (1 if tied else 3)
    assert shown["weights"][-1][0] == pytest.approx(trace.weights[-1, 0], abs=1e-4)
    assert shown["scales"][7] == pytest.approx(trace.scales[7], abs=1e-4)
    assert shown["incumbent"] == trace.incumbent.tolist()
    assert shown["sigma"][0] == 0.5
    assert len(shown["axes"]) == search.encoding.dimension
    assert len(shown["axes"][0]) == len(shown["iterations"])


def test_what_a_model_expected_is_that_of_the_static_figure_live_and_from_a_journal(
    made: list[Any], tmp_path: Path
) -> None:
    searches = searches_by_model(tmp_path / "journal.jsonl")
    journal = FollowedJournal(tmp_path)
    for search, view in zip(searches, (PopulationView, RoutingView), strict=True):
        made += [own := view(search, metric="epe"), other := view(JournalSource(journal, search.kind, "epe"))]
        told = analysis.predictions(search, metric="epe")
        assert own.model == other.model
        assert json.loads(json.dumps(own.model, allow_nan=False))["number"] == told.number.tolist()
        assert own.model["mean"] == pytest.approx(told.mean, rel=1e-4)
        assert own.model["high"] == pytest.approx(told.mean + 1.96 * told.sd, rel=1e-4)
        share = 100 * analysis.calibration(told, (0.95,)).coverage[0]
        assert f"hold {share:.0f} % of {told.measured.sum()} measured scores" in own.model["says"]
        assert "measured (orange), predicted, with its 95 % interval (blue)" in own.sheet().svg()
    drawn = set(map(str, made[0].model["number"]))
    assert drawn <= made[0].evolution["people"].keys(), "a click on any of them finds it"
    assert made[2].trace["by_model"]
    made += [paper := PopulationView(subset_search(permits=10)[0])]
    assert paper.model == {}


def test_what_is_sent_is_json_without_nan(made: list[Any]) -> None:
    search, scorer = subset_search(permits=10)
    scorer.outcome = lambda recipe: replace(type(scorer).outcome(scorer, recipe), score=float("nan"))
    search.run() if search.best else list(search)
    made += [control := SearchControl(search), view := PopulationView(search)]
    for traits in (control.progress, view.evolution):
        json.dumps(traits, allow_nan=False)
    assert control.progress["best"] is None
    assert view.evolution["best"] == [None] * 6
    assert view.evolution["archive"] == []


def test_a_long_search_stays_light(made: list[Any]) -> None:
    search, _ = routing_search(permits=10_000)
    object.__setattr__(search.settings, "evaluations", 900)
    object.__setattr__(search.settings, "converge", False)
    search.run()
    made.append(view := RoutingView(search))
    assert len(view.trace["drawn"]) <= 400
    assert len(view.trace["iterations"]) <= 400


def test_watching_a_journal(made: list[Any], tmp_path: Path) -> None:
    made.append(watched := watch(tmp_path, metric="epe"))
    assert watched.says.startswith("Waiting for the first record of a search in ")
    search, _ = subset_search(10, tmp_path / "journal.jsonl")
    search.step()
    until(watched, "children", lambda children: len(children) == 3)
    _, control, view = watched.children
    assert control.progress["phase"] == "open"
    assert "Runs elsewhere" in control.progress["says"]
    search.run()
    until(control, "progress", lambda shown: shown["phase"] == "finished")
    until(view, "evolution", lambda shown: len(shown["generations"]) == 6)
    assert control.progress["best"]["score"] == f"EPE {search.best.score:.2f} px"
    own = PopulationView(search, metric="epe")
    made.append(own)
    assert view.evolution == own.evolution
    second, _ = routing_search(100, tmp_path / "journal.jsonl")
    second.run()
    until(watched, "children", lambda children: len(children) == 5)
    # The view may have been made while the search still wrote.
    until(watched.children[-1], "trace", lambda shown: len(shown["drawn"]) == len(second.candidates))
    tell(control, "stop")
    assert control.error == "this search runs elsewhere and is only watched here: stop it where it runs"


def test_a_damaged_journal_is_told(made: list[Any], tmp_path: Path) -> None:
    (tmp_path / "journal.jsonl").write_text('{"event": "start"\n{"event": "x"}\n', encoding="utf-8")
    made.append(watched := watch(tmp_path))
    assert "record 1 is damaged" in watched.says


def test_wrong_arguments_are_refused(tmp_path: Path) -> None:
    subset, routing = subset_search()[0], routing_search()[0]
    with pytest.raises(InputError, match="found a routing search, expected a subset search: use RoutingView"):
        PopulationView(routing)
    with pytest.raises(InputError, match="use PopulationView"):
        RoutingView(subset)
    with pytest.raises(InputError, match="found a str, expected a SubsetSearch"):
        SearchControl("runs")
    with pytest.raises(InputError, match=r"unknown argument of SearchControl 'thme'.*did you mean 'theme'"):
        SearchControl(subset, thme="dark")
    with pytest.raises(InputError, match=r"archive: found -1, expected a whole number"):
        PopulationView(subset, archive=-1)
    with pytest.raises(InputError, match=r"unknown argument of watch 'metrics'.*did you mean 'metric'"):
        watch(tmp_path, metrics="epe")
    with pytest.raises(traitlets.TraitError, match="theme"):
        SearchControl(subset, theme="blue")


def test_the_publisher_refreshes_until_told_otherwise_and_keeps_nothing_alive() -> None:
    assert 1 / PULSE == 8

    class Counting:
        def __init__(self) -> None:
            self.seen = threading.Semaphore(0)

        def refresh(self) -> None:
            self.seen.release()

    publisher, widget = Publisher(), Counting()
    publisher.follow(widget)
    assert all(widget.seen.acquire(timeout=PATIENCE) for _ in range(3))
    thread = publisher._thread
    publisher.leave(widget)
    assert thread is not None
    thread.join(PATIENCE)
    assert not thread.is_alive()
    publisher.follow(widget)
    assert widget.seen.acquire(timeout=PATIENCE)
    thread, gone = publisher._thread, weakref.ref(widget)
    del widget
    assert thread is not None
    thread.join(PATIENCE)
    gc.collect()
    assert gone() is None


SCRIPT = """
import sys, tempfile, pathlib, sfkit, sfkit_widgets
from flat_world import benchmark, flat_pool
pool = flat_pool(pathlib.Path(tempfile.mkdtemp()))
scorer = sfkit.Evaluator(pool, benchmark())
view = sfkit_widgets.PopulationView(sfkit.SubsetSearch(pool.names, pool.blocks, scorer))
"""


def test_a_script_that_made_a_widget_ends() -> None:
    tests = Path(__file__).parents[1]
    ended = subprocess.run(
        [sys.executable, "-c", SCRIPT], cwd=tests, capture_output=True, text=True, timeout=PATIENCE
    )
    assert ended.returncode == 0, ended.stderr
