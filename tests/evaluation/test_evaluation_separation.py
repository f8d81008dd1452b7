"""Validation and test apart: the same files are found whatever they are called."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import pytest
from tiny import write_pairs

from sfkit.datasets.benchmark import Benchmark, memory_benchmark, open_benchmark
from sfkit.errors import InputError
from sfkit.evaluation.separation import check_separation


@pytest.fixture
def seen(tmp_path: Path) -> Benchmark:
    return open_benchmark("pairs", write_pairs(tmp_path / "seen", count=2))


@pytest.fixture
def unseen(tmp_path: Path) -> Benchmark:
    return open_benchmark("pairs", write_pairs(tmp_path / "unseen", count=1, shift=7))


def test_other_pairs_are_a_test(seen: Benchmark, unseen: Benchmark) -> None:
    separation = check_separation(seen, [unseen])
    assert separation.clean
    assert separation.guided == ("seen",)
    assert [benchmark.name for benchmark in separation.columns] == ["seen", "unseen"]
    assert str(separation).startswith("The search sees seen only")


def test_a_pair_in_both_is_refused_and_named(seen: Benchmark, unseen: Benchmark) -> None:
    with pytest.raises(InputError, match=r"'seen': found pair0, pair1 .*allow_validation_in_report=True"):
        check_separation(seen, [unseen, seen])


def test_a_copy_under_other_names_is_recognised(tmp_path: Path, seen: Benchmark) -> None:
    shutil.copytree(tmp_path / "seen" / "pair1", tmp_path / "copies" / "renamed")
    copies = open_benchmark("pairs", tmp_path / "copies")
    with pytest.raises(InputError, match="'copies': found renamed"):
        check_separation(seen, [copies])


def test_pairs_in_memory_are_compared_by_content(seen: Benchmark, unseen: Benchmark) -> None:
    held = memory_benchmark("held", seen.samples())
    other = memory_benchmark("other", unseen.samples())
    assert check_separation(held, [other]).clean
    with pytest.raises(InputError, match="'again': found pair0, pair1"):
        check_separation(held, [replace(held, name="again")])


def test_the_explicit_word_lets_it_pass_and_the_report_says_so(seen: Benchmark, unseen: Benchmark) -> None:
    again = replace(seen, name="again")
    separation = check_separation([seen], [again, unseen], allow=True)
    assert separation.shared == {"again": ("pair0", "pair1")}
    assert separation.guided == ("seen", "again")
    assert "again (pair0, pair1)" in str(separation)
    assert "not a test" in str(separation)


def test_a_benchmark_that_guides_and_is_reported_is_one_column(seen: Benchmark) -> None:
    separation = check_separation(seen, [seen], allow=True)
    assert separation.columns == (seen,)
    assert separation.guided == ("seen",)


def test_one_name_for_two_protocols_is_refused(seen: Benchmark, unseen: Benchmark) -> None:
    with pytest.raises(InputError, match="found two of this name"):
        check_separation(seen, [replace(unseen, name="seen")])
