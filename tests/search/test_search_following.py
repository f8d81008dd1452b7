"""Progress read from a journal is that of the search that wrote it; following one only reads."""

from __future__ import annotations

from pathlib import Path

import pytest
from search_landscapes import BLOCKS, Scorer, names, subset_landscape

from sfkit import Journal, RoutingSearch, RoutingSettings, SubsetSearch, SubsetSettings
from sfkit.errors import InputError
from sfkit.search.following import FollowedJournal
from sfkit.search.live import LiveSearch
from sfkit.search.progress import Phase, most_candidates, next_size, time_left, watched_progress


def searches(journal: Journal) -> tuple[SubsetSearch, RoutingSearch]:
    score = subset_landscape(5, 0)
    scorer = Scorer(lambda recipe: score(recipe.sources))
    first = SubsetSearch(
        names(5), BLOCKS, scorer, SubsetSettings(population=5, generations=2), journal=journal
    )
    second = RoutingSearch(
        names(3), BLOCKS, scorer, RoutingSettings(evaluations=12, converge=False), journal=journal
    )
    return first, second


def test_a_journal_tells_what_the_search_knows(tmp_path: Path) -> None:
    journal = Journal(tmp_path / "journal.jsonl")
    followed = FollowedJournal(tmp_path)
    assert followed.records() == ()
    assert followed.searches() == ()
    first, second = searches(journal)
    first.step()
    told = watched_progress(followed.records(), "subset")
    assert (told.phase, told.generation, told.counts) == (Phase.OPEN, 0, first.counts)
    assert told.best.number == first.best.number
    assert told.running == first.counts.seconds
    assert told.left == pytest.approx(told.running / 5 * (told.total - 5))
    first.run()
    told = watched_progress(followed.records(), "subset")
    own = LiveSearch(first).progress()
    assert told.phase is own.phase is Phase.FINISHED
    assert (told.candidates, told.total) == (own.candidates, own.total) == (17, 17)
    assert told.reason == own.reason
    assert followed.searches() == ("subset",)
    second.run()
    assert followed.searches() == ("subset", "routing")
    told = watched_progress(followed.records(), "routing")
    assert (told.candidates, told.total, told.generations) == (12, 12, None)
    assert followed.records() is followed.records()


def test_a_stop_is_told(tmp_path: Path) -> None:
    first, _ = searches(Journal(tmp_path / "journal.jsonl"))
    first.request_stop()
    list(first)
    told = watched_progress(FollowedJournal(tmp_path).records(), "subset")
    assert (told.phase, told.generation, told.best) == (Phase.STOPPED, -1, None)


def test_the_journal_is_found_and_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "evaluations.sqlite").touch()
    with pytest.raises(InputError, match=r"found no journal.jsonl beside it"):
        FollowedJournal(tmp_path / "evaluations.sqlite")
    first, _ = searches(Journal(tmp_path / "journal.jsonl"))
    first.step()
    before = {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in tmp_path.iterdir()}
    for path in (tmp_path, tmp_path / "journal.jsonl", tmp_path / "evaluations.sqlite"):
        assert FollowedJournal(path).searches() == ("subset",)
    assert {path: (path.stat().st_mtime_ns, path.read_bytes()) for path in tmp_path.iterdir()} == before
    with pytest.raises(InputError, match=r"journal.jsnl: no such file.*did you mean 'journal.jsonl'"):
        FollowedJournal(tmp_path / "journal.jsnl")


def test_another_stage_is_refused(tmp_path: Path) -> None:
    first, _ = searches(Journal(tmp_path / "journal.jsonl"))
    first.step()
    with pytest.raises(InputError, match="found no routing search"):
        watched_progress(FollowedJournal(tmp_path).records(), "routing")


def test_sizes_of_generations_add_up(tmp_path: Path) -> None:
    for search in searches(Journal(tmp_path / "journal.jsonl")):
        sizes = []
        while not search.done:
            sizes.append(next_size(search))
            assert len(search.step().candidates) == sizes[-1]
        assert sum(sizes) == most_candidates(search)


def test_time_left() -> None:
    assert time_left(30.0, 10, 40) == 90.0
    assert time_left(30.0, 40, 40) == 0.0
    assert time_left(0.0, 0, 40) is None
