"""The command that a verdict gives to copy, in folders whose names a shell would take apart."""

from __future__ import annotations

import shlex
from pathlib import Path

from sfkit.cli.judging import other_network
from sfkit.evaluation.outcome import Outcome
from sfkit.merging import Recipe
from sfkit.search import SubsetCandidate
from sfkit.search.pipeline import SearchResult

BLOCKS = ("neck", "head")
BEST, AVERAGE = Recipe.equal(["a", "b"], BLOCKS), Recipe.equal(["a", "b", "c"], BLOCKS)
FOLDER = Path("my runs; rm -r $HOME/it's")


def found(recipe: Recipe) -> SearchResult:
    best = SubsetCandidate(
        number=0,
        generation=0,
        recipe=BEST,
        outcome=Outcome(1.0),
        repeated=False,
        chromosome=BEST.sources,
        parents=(),
        operators=("start",),
    )
    return SearchResult(recipe, 1.0, best, None, FOLDER / "merged.safetensors", FOLDER)


def words(line: str) -> list[str]:
    said, _, command = line.partition(": ")
    assert said.startswith(str(FOLDER / "merged.safetensors"))
    return shlex.split(command)


def test_a_folder_of_any_name_is_one_word_of_the_command_that_writes_the_best() -> None:
    line = other_network(found(AVERAGE), BEST, "Stage 1")
    assert "is the averaged winner; for Stage 1: sfkit merge" in line
    assert words(line) == ["sfkit", "merge", "POOL", "--recipe", str(FOLDER / "best.json"), "--out", "FILE"]


def test_equal_weights_are_a_subset_of_the_command() -> None:
    alone = Recipe.equal(["c"], BLOCKS)
    assert words(other_network(found(BEST), alone, "c")) == [
        *("sfkit", "merge", "POOL", "--subset", "c", "--out", "FILE")
    ]
