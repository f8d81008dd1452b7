"""Numbers of the guide that were measured, against what was recorded."""

from __future__ import annotations

import csv
import re
from collections import defaultdict
from pathlib import Path

import pytest

from sfkit.search import BayesianSubsetSettings, Constraints

ROOT = Path(__file__).parents[2]
RECORD = ROOT / "benchmarks" / "recorded" / "optimum-search.csv"
MODEL = "sfkit, a model of the score"
ELEVEN = tuple(map(str, range(11)))


@pytest.fixture(scope="module")
def needed() -> dict[str, list[float]]:
    """Validation pairs -> what each seed needed to find the best of all subsets, inf where it did not."""
    found: dict[str, list[float]] = defaultdict(list)
    with RECORD.open(newline="") as lines:
        for row in csv.DictReader(lines):
            if row["search"] == MODEL:
                found[row["pairs"]].append(float(row["needed"]))
    return found


def test_what_a_search_by_a_model_finds_with_its_default_budget(needed: dict[str, list[float]]) -> None:
    text = " ".join((ROOT / "docs" / "guide.md").read_text(encoding="utf-8").split())
    told = re.search(
        r"ends after (\d+): by then (\d+) of (\d+) searches have found the best on 20 pairs and (\d+) of "
        r"(\d+) on 8; `--generations (\d+)` ends after (\d+), by when (\d+) have on 8",
        text,
    )
    assert told is not None
    end, many, of, few, of_few, generations, later, then = map(int, told.groups())
    space = Constraints().space(ELEVEN, ("all",))
    assert end == BayesianSubsetSettings().proposals(space)
    assert later == BayesianSubsetSettings(generations=generations).proposals(space)
    assert (of, of_few) == (len(needed["20"]), len(needed["8"]))
    assert many == sum(number <= end for number in needed["20"])
    assert few == sum(number <= end for number in needed["8"])
    assert then == sum(number <= later for number in needed["8"])
    longest = re.search(r"at most (\d+) evaluations on 20 validation pairs and (\d+) on 8", text)
    assert longest is not None
    assert tuple(map(int, longest.groups())) == (max(needed["20"]), max(needed["8"]))
