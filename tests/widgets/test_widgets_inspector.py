"""The RoutingInspector's commands and traits, without a browser."""

from __future__ import annotations

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from sfkit_widgets.routing_inspector import RoutingInspector
from tiny import write_pairs, write_pool

import sfkit
from sfkit.analysis import previews
from sfkit.errors import InputError
from sfkit.evaluation import Evaluator
from sfkit.search import RoutingSearch, RoutingSettings


@pytest.fixture(scope="module")
def evaluator(tmp_path_factory: pytest.TempPathFactory) -> Evaluator:
    folder: Path = tmp_path_factory.mktemp("world")
    pool = sfkit.open_pool(write_pool(folder / "pool"))
    return Evaluator(pool, sfkit.open_benchmark("pairs", write_pairs(folder / "pairs"), metric="bad-2.0"))


@pytest.fixture(autouse=True)
def no_hurry(monkeypatch: pytest.MonkeyPatch) -> None:
    """Pictures at full size at once, however busy the machine is."""
    monkeypatch.setattr(previews, "QUICK_SECONDS", math.inf)


@pytest.fixture
def inspector(evaluator: Evaluator) -> RoutingInspector:
    return RoutingInspector(evaluator, ("a", "b"), tied=False)


def tell(widget: RoutingInspector, command: str, **arguments: Any) -> str:
    """Send a command as the browser would; the error it leaves."""
    message = {"command": command, "arguments": arguments, "view": "v", "sequence": 1}
    widget._receive(widget, message, [])
    return str(widget.error)


def shape(data: bytes) -> tuple[int, ...]:
    """Height, width and channels of a coded picture."""
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return picture.shape


def test_an_edit_changes_numbers_pictures_and_recipe(inspector: RoutingInspector) -> None:
    before = (inspector.disparity_picture, inspector.look["score"])
    assert tell(inspector, "weigh", block="neck", source="a", weight=0.9) == ""
    assert inspector.weights[1] == pytest.approx([0.9, 0.1])
    assert inspector.weights[0] == [0.5, 0.5]
    assert inspector.recipe.of("neck")[0] == pytest.approx({"a": 0.9, "b": 0.1})
    assert json.loads(inspector.recipe_json)["weights"]["neck"]["a"] == 0.9
    assert (inspector.disparity_picture, inspector.look["score"]) != before
    assert shape(inspector.error_picture) == shape(inspector.left_picture) == (48, 96, 3)
    assert inspector.can_undo


def test_the_pictures_are_those_of_the_recipe(evaluator: Evaluator, inspector: RoutingInspector) -> None:
    tell(inspector, "weigh", block="head", source="a", weight=1.0)
    score = evaluator.evaluate([inspector.recipe])[0].images[0].value("bad-2.0")
    assert inspector.look == {
        "score": {"state": "known", "value": score},
        "reduction": 1,
        "milliseconds": inspector.look["milliseconds"],
    }
    twin = RoutingInspector(evaluator, ("a", "b"), recipe=inspector.recipe, tied=False)
    assert twin.disparity_picture == inspector.disparity_picture


def test_a_pair_without_truth_is_edited_by_its_residual(evaluator: Evaluator, tmp_path: Path) -> None:
    guide = Evaluator(evaluator.pool, sfkit.open_benchmark("unlabelled", write_pairs(tmp_path)))
    inspector = RoutingInspector(guide, ("a", "b"), tied=False)
    assert inspector.captions == {"truth": "right image", "error": "residual"}
    assert shape(inspector.truth_picture) == shape(inspector.error_picture) == (48, 96, 3)
    assert inspector.legends["error"]["ticks"][1:] == ["12.5", "≥ 100 %"]
    before, colours = inspector.error_picture, inspector.legends
    assert tell(inspector, "weigh", block="head", source="a", weight=1.0) == ""
    score = guide.evaluate([inspector.recipe])[0].images[0].value("census")
    assert inspector.look["score"] == {"state": "known", "value": score}
    assert inspector.error_picture != before
    assert inspector.legends == colours  # the pair's, so that edits can be compared
    assert tell(inspector, "show_pair", pair=inspector.pairs[1]) == ""
    assert inspector.pair == inspector.pairs[1]


def test_every_edit_can_be_undone_and_redone(inspector: RoutingInspector) -> None:
    start, picture = inspector.recipe, inspector.disparity_picture
    edits: list[tuple[str, dict[str, Any]]] = [
        ("weigh", {"block": "neck", "source": "a", "weight": 0.9}),
        ("scale", {"block": "head", "value": 1.5}),
        ("remove", {"source": "b"}),
        ("reset", {}),
    ]
    for name, arguments in edits:
        assert tell(inspector, name, **arguments) == ""
    assert inspector.recipe == start
    for _ in edits:
        tell(inspector, "undo")
    assert (inspector.recipe, inspector.can_undo, inspector.can_redo) == (start, False, True)
    assert inspector.disparity_picture == picture
    for _ in edits[:-1]:
        tell(inspector, "redo")
    assert inspector.gone == ["b"]
    assert inspector.scales[-1] == 1.5


def test_a_drag_is_one_edit(inspector: RoutingInspector) -> None:
    for weight in (0.6, 0.7, 0.8):
        tell(inspector, "weigh", block="neck", source="a", weight=weight, gesture="g")
    tell(inspector, "undo")
    assert inspector.weights[1] == [0.5, 0.5]


def test_locks_and_ties_are_shown(inspector: RoutingInspector) -> None:
    tell(inspector, "lock", block="neck", source="a", locked=True)
    assert inspector.locked[1] == [True, False]
    assert "is locked" in tell(inspector, "weigh", block="neck", source="a", weight=0.1)
    tell(inspector, "tie", tied=True)
    assert inspector.tied
    assert not any(map(any, inspector.locked))


def test_an_edit_that_is_refused_leaves_everything_as_it_was(inspector: RoutingInspector) -> None:
    state = inspector.get_state()
    assert "found 7" in tell(inspector, "weigh", block="neck", source="a", weight=7)
    changed = {name for name, value in inspector.get_state().items() if value != state[name]}
    assert changed == {"error", "acknowledged"}


def test_recipes_go_in_and_out(inspector: RoutingInspector, evaluator: Evaluator, tmp_path: Path) -> None:
    inspector.recipe = evaluator.pool.equal("b")
    assert inspector.weights[0] == [0.0, 1.0]
    tell(inspector, "undo")
    assert tell(inspector, "load", text=evaluator.pool.equal("a").to_json()) == ""
    assert inspector.weights[0] == [1.0, 0.0]
    assert "the pasted text: not JSON" in tell(inspector, "load", text="{")
    with pytest.raises(InputError, match="holds the source 'c'"):
        inspector.recipe = evaluator.pool.equal("c")
    other = replace(evaluator.pool.bound(evaluator.pool.equal("a")), merged_from={"a": "of another network"})
    assert "merged from another 'a'" in tell(inspector, "load", text=other.to_json())
    assert sfkit.Recipe.from_json(inspector.recipe_json).merged_from == {
        "base": evaluator.pool.base.fingerprint,
        "a": evaluator.pool.identity["a"],
    }
    target = tmp_path / "merged.safetensors"
    assert tell(inspector, "save", path=str(target)) == ""
    assert inspector.saved == str(target)
    assert sfkit.read_recipe(target) == inspector.recipe
    assert "exists" in tell(inspector, "save", path=str(target))


def test_scrubbing_shows_what_the_search_scored(evaluator: Evaluator) -> None:
    search = RoutingSearch(
        ("a", "b"), evaluator.pool.blocks, evaluator, RoutingSettings(evaluations=9, population=4)
    )
    search.step()
    inspector = RoutingInspector(evaluator, search=search)
    assert (inspector.trial, inspector.trials["iteration"]) == (0, [0])
    search.run()
    tell(inspector, "refresh")
    assert inspector.trials["score"] == [candidate.score for candidate in search.candidates]
    assert tell(inspector, "scrub", trial=3) == ""
    assert inspector.trial == 3
    assert inspector.recipe == search.candidates[3].recipe
    assert inspector.scores == {"state": "known", "value": search.candidates[3].score}
    tell(inspector, "scale", block="neck", value=1.1)
    assert inspector.trial is None
    assert inspector.scores["state"] == "unknown"
    assert "expected 0 to 8" in tell(inspector, "scrub", trial=9)


def test_a_score_comes_when_asked_for(evaluator: Evaluator) -> None:
    own = evaluator.with_store(sfkit.EvaluationStore(":memory:"))
    inspector = RoutingInspector(own, ("a", "b"), tested_on=[evaluator.benchmark])
    assert inspector.scores["state"] == "unknown"
    assert "a report tests on 2 pairs" in inspector.flag
    tell(inspector, "score")
    inspector.settle()
    assert inspector.scores == {"state": "known", "value": own([inspector.recipe])[0].score}
    assert "1 recipe edited by hand" in inspector.flag
    tell(inspector, "pin", name="A")
    tell(inspector, "weigh", block="neck", source="a", weight=0.0)
    assert {score["state"] for score in inspector.pins["A"].values()} == {"known"}
    assert inspector.scores["state"] == "unknown"
    pictures = inspector.pin_pictures["A"]
    tell(inspector, "show_pair", pair="pair1")
    assert inspector.pair == "pair1"
    assert inspector.pin_pictures["A"]["disparity"] != pictures["disparity"]
    tell(inspector, "unpin", name="A")
    assert (inspector.pins, inspector.pin_pictures) == ({}, {})


def test_a_reduced_look_is_followed_by_the_full_one(
    inspector: RoutingInspector, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(previews, "QUICK_SECONDS", 1e-9)
    seen = []
    inspector.observe(lambda change: seen.append(change["new"]["reduction"]), "look")
    tell(inspector, "weigh", block="neck", source="a", weight=0.9)
    inspector.settle()
    assert seen == [4, 1]
    assert inspector.look["score"]["state"] == "known"


def test_the_score_on_the_pair_is_of_the_full_size(
    evaluator: Evaluator, inspector: RoutingInspector, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(previews, "QUICK_SECONDS", 1e-9)
    inspector.weigh("neck", "a", 0.9)
    expected = evaluator.evaluate([inspector.recipe])[0].images[0].value("bad-2.0")
    assert inspector.pair_score == expected
    assert inspector.look["score"] == {"state": "known", "value": expected}


def test_a_network_that_fails_is_said_and_the_edit_stays(
    inspector: RoutingInspector, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(*_: object) -> None:
        raise RuntimeError("no memory left")

    monkeypatch.setattr(inspector._bench.preview._model.network, "forward", broken)
    error = tell(inspector, "weigh", block="neck", source="a", weight=0.9)
    assert error.startswith("RuntimeError: no memory left")
    assert inspector.weights[1] == pytest.approx([0.9, 0.1])


def test_unknown_arguments_are_refused_before_anything_is_loaded(evaluator: Evaluator) -> None:
    with pytest.raises(InputError, match=r"unknown argument of RoutingInspector 'serch'.*'search'"):
        RoutingInspector(evaluator, serch=None)


def test_every_trait_is_documented() -> None:
    import inspect

    from sfkit_widgets import _routing_traits

    source = inspect.getsource(_routing_traits)
    for name, trait in RoutingInspector.class_own_traits(sync=True).items():
        if not name.startswith("_"):
            assert f"{name} = traitlets.{type(trait).__name__}" in source
            assert '"""' in source.split(f"    {name} = ")[1].split(" = traitlets")[0]
