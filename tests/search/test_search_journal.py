"""The journal: what it holds, that it only grows, and that a kill costs one line at most."""

from __future__ import annotations

import json
import math
import resource
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from search_landscapes import BLOCKS, Scorer, names, subset_landscape

from sfkit.errors import InputError, SfkitError
from sfkit.search import (
    Journal,
    RoutingSearch,
    RoutingSettings,
    SubsetSearch,
    SubsetSettings,
    last_run,
    read_journal,
)

SMALL = SubsetSettings(population=6, generations=2)


def subset_search(journal: Journal | None) -> SubsetSearch:
    landscape = subset_landscape(5, 0)
    return SubsetSearch(names(5), BLOCKS, Scorer(lambda r: landscape(r.sources)), SMALL, journal=journal)


def test_a_subset_search_writes_start_generations_and_end(tmp_path) -> None:
    path = tmp_path / "run.jsonl"
    search = subset_search(Journal(path))
    assert not path.exists()
    search.run()
    records = read_journal(path)
    assert [record["event"] for record in records] == ["start", *["generation"] * 3, "end"]
    start, generations, end = records[0], records[1:-1], records[-1]
    assert start["settings"]["population"] == 6
    assert start["sources"] == list(names(5))
    written = [c["candidate"] for record in generations for c in record["candidates"]]
    assert written == list(range(18))
    assert [record["population"] for record in generations] == [list(p) for p in search.state.populations]
    last = generations[-1]["candidates"][-1]
    assert last["parents"] == list(search.candidates[-1].parents)
    assert last["operators"] == list(search.candidates[-1].operators)
    assert generations[-1]["best"]["score"] == search.best.score
    assert generations[-1]["counts"]["distinct"] == search.counts.distinct
    assert end["reason"] == search.reason


def test_a_routing_search_writes_its_distribution(tmp_path) -> None:
    path = tmp_path / "run.jsonl"
    scorer = Scorer(lambda recipe: sum(recipe.scales))
    options = RoutingSettings(evaluations=20)
    search = RoutingSearch(names(3), BLOCKS, scorer, options, journal=Journal(path))
    search.run()
    records = read_journal(path)
    assert records[0]["dimension"] == 6
    final = records[-2]
    assert final["distribution"]["sigma"] == search.state.distribution.sigma
    assert final["distribution"]["axes"] == list(search.state.distribution.axes)
    assert final["candidates"][0]["weights"] == [list(row) for row in search.candidates[-1].recipe.weights]


def test_a_journal_changes_nothing(tmp_path) -> None:
    with_one, without = subset_search(Journal(tmp_path / "run.jsonl")), subset_search(None)
    with_one.run()
    without.run()
    assert with_one.candidates == without.candidates


def test_every_record_is_readable_the_moment_its_step_ends(tmp_path) -> None:
    path = tmp_path / "run.jsonl"
    for generation in subset_search(Journal(path)):
        written = [record for record in read_journal(path) if record["event"] == "generation"]
        assert written[-1]["generation"] == generation.number


def test_a_stop_is_written_and_going_on_begins_no_new_run(tmp_path) -> None:
    path = tmp_path / "run.jsonl"
    search = subset_search(Journal(path))
    search.step()
    search.request_stop()
    search.run()
    search.run()
    events = [(record["event"], record.get("reason")) for record in read_journal(path)]
    assert events == [
        ("start", None),
        ("generation", None),
        ("end", "stop requested"),
        ("generation", None),
        ("generation", None),
        ("end", search.reason),
    ]


def test_two_runs_append_and_the_last_can_be_told(tmp_path) -> None:
    path = tmp_path / "run.jsonl"
    first = subset_search(Journal(path))
    first.step()
    size = path.stat().st_size
    prefix = path.read_bytes()
    subset_search(Journal(path)).run()
    assert path.read_bytes()[:size] == prefix
    records = read_journal(path)
    assert len(last_run(records)) == len(records) - 2
    assert [record["event"] for record in last_run(records)].count("start") == 1


def test_last_run_tells_the_stages_apart() -> None:
    records = [
        {"event": e, "search": s} for s in ("subset", "routing") for e in ("start", "generation", "end")
    ]
    assert last_run(records) == tuple(records[3:])
    assert last_run(records, "subset") == tuple(records[:3])
    assert last_run([]) == ()


@given(st.integers(0, 200))
def test_a_torn_last_line_is_left_out_and_writing_goes_on(tmp_path_factory, cut: int) -> None:
    path = tmp_path_factory.mktemp("journal") / "run.jsonl"
    journal = Journal(path)
    journal.write("start", search="subset", names=["a", "b"])
    journal.write("generation", generation=0)
    whole = path.read_bytes()
    cut = min(cut, len(whole))
    path.write_bytes(whole[:cut])
    kept = read_journal(path)
    # A line that lacks its line feed alone is whole.
    assert len(kept) == sum(cut >= len(line) for line in (whole[: whole.index(b"\n")], whole[:-1]))
    journal.write("end")
    again = read_journal(path)
    assert again[: len(kept)] == kept
    assert again[-1]["event"] == "end"
    assert ("resumed" in [record["event"] for record in again]) == (whole[:cut][-1:] not in (b"", b"\n"))


def test_damage_elsewhere_is_refused(tmp_path) -> None:
    path = tmp_path / "run.jsonl"
    path.write_bytes(b'{"event":"start"}\n{"event":"gen\n{"event":"end"}\n')
    with pytest.raises(InputError, match=r"run\.jsonl: record 2 is damaged"):
        read_journal(path)
    path.write_bytes(b'[1, 2]\n{"event":"end"}\n')
    with pytest.raises(InputError, match="record 1 is damaged"):
        read_journal(path)


def test_numbers_that_are_not_finite_become_null_and_numpys_plain(tmp_path) -> None:
    path = tmp_path / "run.jsonl"
    Journal(path).write("x", values=(math.inf, math.nan, np.float32(0.5), np.int64(3), True, None))
    (line,) = path.read_text().splitlines()
    assert json.loads(line)["values"] == [None, None, 0.5, 3, True, None]
    with pytest.raises(TypeError, match="cannot write a set"):
        Journal(path).write("x", values={1})


def test_wrong_paths_are_refused(tmp_path) -> None:
    with pytest.raises(InputError, match="found a folder, expected the name of a file"):
        Journal(tmp_path)
    with pytest.raises(InputError, match="does not exist: create it first"):
        Journal(tmp_path / "missing" / "run.jsonl")
    with pytest.raises(InputError, match="no such file"):
        read_journal(tmp_path / "run.jsonl")


def test_a_journal_on_a_full_disk_is_said_and_goes_on_when_there_is_room(tmp_path: Path) -> None:
    path = tmp_path / "run.jsonl"
    journal = Journal(path)
    journal.write("start", search="subset")
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (path.stat().st_size + 20, hard))
    try:
        with pytest.raises(SfkitError, match=r"run\.jsonl: cannot be written \(.*make room and start again"):
            journal.write("generation", search="subset", number=0)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert [record["event"] for record in read_journal(path)] == ["start"]
    journal.write("generation", search="subset", number=0)
    assert [record["event"] for record in read_journal(path)] == ["start", "resumed", "generation"]
