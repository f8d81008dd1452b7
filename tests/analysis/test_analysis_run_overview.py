"""Runs at a glance: best so far, importance of sources and routes from a journal, and their page."""

from __future__ import annotations

import json
import math
from html.parser import HTMLParser
from pathlib import Path

import pytest

from sfkit.analysis.run_overview import RunOverview, run_overview, source_importance
from sfkit.datasets.metric import with_unit
from sfkit.errors import SfkitWarning
from sfkit.figures.run_page import run_page
from sfkit.search.journal import Journal
from sfkit.search.runs import read_run, recorded_metrics

SUBSETS = [
    (("a", "b"), 3.0),
    (("b", "c"), 2.0),
    (("a", "c"), None),
    (("a", "b", "c"), 1.5),
    (("b", "c"), 2.0),
]
COUNTS = {"candidates": 5, "distinct": 4, "cached": 1, "failed": 1, "seconds": 2.0, "seconds_saved": 0.0}
NAME = "<b>evil&"


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A journal of both stages, whose block has a hostile name."""
    journal = Journal(tmp_path / "journal.jsonl")
    told = {"settings": {}, "constraints": {}, "sources": ["a", "b", "c"], "blocks": [NAME], "start": None}
    best = {"subset": ["a", "b", "c"], "score": 1.5, "recipe": None}
    done = {"generation": 0, "best": best, "counts": COUNTS}
    first = [{"candidate": n, "subset": s, "score": v} for n, (s, v) in enumerate(SUBSETS)]
    journal.write("start", search="subset", **told, most=5)
    journal.write("generation", search="subset", candidates=first, population=[], **done)
    second = [
        {"candidate": n, "subset": ["a", "b", "c"], "score": v, "weights": [w], "scales": [1.0 + n]}
        for n, (v, w) in enumerate([(1.5, [0.2, 0.3, 0.5]), (None, [0.0, 0.0, 1.0]), (1.25, [0.0, 0.5, 0.5])])
    ]
    journal.write("start", search="routing", **told)
    journal.write("generation", search="routing", candidates=second, **done)
    return tmp_path


def test_one_search_at_a_glance(folder: Path) -> None:
    first, second = run_overview(read_run(folder)).stages
    assert first.best_so_far == (3.0, 2.0, 2.0, 1.5, 1.5)
    # Without a the best is (b, c), without c it is (a, b); every subset with a finite score holds b.
    assert first.importance == {"a": 0.5, "b": math.inf, "c": 1.5}
    assert second.best_so_far == (1.5, 1.5, 1.25)
    assert [route.number for route in second.routes] == [0, 2], "what failed has no place on the axes"
    assert second.routes[1].weights == {"a": 0.0, "b": 0.5, "c": 0.5}
    assert second.routes[1].scales == {NAME: 3.0}
    assert source_importance(("a",), [{"subset": ("a", "b"), "score": None}]) == {}
    alone = [{"subset": ("c",), "score": 0.5}, *({"subset": s, "score": v} for s, v in SUBSETS)]
    assert source_importance(("a", "b", "c"), alone) == first.importance, "a source alone wins nothing"


class Page(HTMLParser):
    """Counts elements, and fails where they do not close."""

    def __init__(self) -> None:
        super().__init__()
        self.counts: dict[str, int] = {}
        self.open: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.counts[tag] = self.counts.get(tag, 0) + 1
        if tag != "meta":
            self.open.append(tag)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.counts[tag] = self.counts.get(tag, 0) + 1

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag


def test_the_page_draws_all_and_escapes_names(folder: Path) -> None:
    overview = run_overview(read_run(folder))
    hostile = RunOverview(Path("</script><script>alert(1)</script>"), overview.stages)
    text = run_page([overview, hostile], {str(folder): "epe [px]"}, "Searches")
    page = Page()
    page.feed(text)
    assert page.open == []
    assert page.counts["script"] == 1
    assert page.counts["tr"] == 1 + 4
    assert page.counts["rect"] == 2 * 3, "a bar a source"
    assert page.counts["polyline"] == 2 * (2 + 2), "a line a stage, and one a candidate of Stage 2"
    assert NAME not in text
    assert "http" not in text.replace("http-equiv", ""), "it asks no host for anything"


def test_the_metric_is_what_the_folder_says(tmp_path: Path) -> None:
    assert recorded_metrics(tmp_path, with_unit) is None
    (tmp_path / "search.json").write_text(json.dumps({"metrics": ["bad-1.0", "epe"]}))
    assert recorded_metrics(tmp_path, with_unit) == "bad-1.0 [%], epe [px]"
    (tmp_path / "search.json").write_text("[]")
    with pytest.warns(SfkitWarning, match=r"search\.json: does not say which search this is"):
        assert recorded_metrics(tmp_path, with_unit) is None
    (tmp_path / "search.json").write_text(json.dumps({"metrics": ["registered-elsewhere"]}))
    assert recorded_metrics(tmp_path, with_unit) == "registered-elsewhere"
