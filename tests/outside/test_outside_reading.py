"""Outside data enters typed and bounded: recipes, calibrations, rows of stores and TOML say what is wrong."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from flat_world import benchmark, flat_pool
from tiny import write_pairs

import sfkit
from sfkit.checkpoints.spec import read_pool_spec
from sfkit.datasets.benchmark import open_benchmark
from sfkit.datasets.calibration import read_calibration
from sfkit.errors import InputError
from sfkit.evaluation.exchange import import_evaluations
from sfkit.evaluation.store import Evaluation, EvaluationStore
from sfkit.merging import Recipe
from sfkit.merging.origin import read_recipe
from sfkit.outside import DEPTH, parse_json, read_toml
from sfkit.search.journal import read_journal

GOOD = Recipe.equal(["a", "b"], ["x", "y"])


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda r: r["weights"]["x"].update(a="0.5"), r"weights\.x\.a is '0.5', expected a number"),
        (lambda r: r["weights"]["x"].update(a=True), r"weights\.x\.a is True, expected a number"),
        (
            lambda r: r["weights"]["x"].update(a=-1),
            r"weights\.x\.a is -1, expected a finite number of at least 0",
        ),
        (lambda r: r["weights"]["x"].update(c=0.5), r"unknown key of .*weights\.x 'c'"),
        (lambda r: r["weights"].update(z={}), "unknown key of .*weights 'z'"),
        (lambda r: r["scales"].update(x="1"), r"scales\.x is '1', expected a number"),
        (lambda r: r.update(lambda_=1), "unknown key of .* 'lambda_'"),
        (lambda r: r.update(sources=["a", 2]), "sources is 2, expected a text"),
        (lambda r: r["weights"]["x"].update(a=10**399), r"weights\.x\.a is 1000"),
    ],
)
def test_a_recipe_is_what_it_says(tmp_path: Path, edit: Any, message: str) -> None:
    values = GOOD.as_dict()
    edit(values)
    (tmp_path / "r.json").write_text(json.dumps(values))
    with pytest.raises(InputError, match=message) as refused:
        read_recipe(tmp_path / "r.json")
    assert str(tmp_path / "r.json") in str(refused.value)


def test_a_key_twice_is_refused_and_a_byte_order_mark_is_not(tmp_path: Path) -> None:
    text = GOOD.to_json()
    (tmp_path / "r.json").write_bytes(b"\xef\xbb\xbf" + text.encode())
    assert read_recipe(tmp_path / "r.json") == GOOD
    (tmp_path / "r.json").write_text(text.replace('"a": 0.5,', '"a": 0.5, "a": 0.9,', 1))
    with pytest.raises(InputError, match=r"r\.json: has the key 'a' twice in one object"):
        read_recipe(tmp_path / "r.json")


@pytest.mark.parametrize(
    "text", ["[" * 100_000, "[" * 90 + "]" * 90, "9" * 5000, "1e999", "NaN", '{"a":1,"a":2}', ""]
)
def test_json_is_bounded(text: str) -> None:
    with pytest.raises(InputError, match="x: "):
        parse_json(text, "x")


@pytest.mark.parametrize(
    "text",
    [
        f"a = {'[' * 5000}",
        f"a = {'[' * 90}{']' * 90}",
        f"a = {'9' * 5000}",
        "a = 1\na = 2",
        "\xff",
        "a.b" * 3000,
    ],
)
def test_toml_is_bounded(tmp_path: Path, text: str) -> None:
    (tmp_path / "x.toml").write_bytes(text.encode("latin-1"))
    with pytest.raises(InputError, match=r"x\.toml: "):
        read_toml(tmp_path / "x.toml")


def test_toml_may_begin_with_a_byte_order_mark(tmp_path: Path) -> None:
    (tmp_path / "x.toml").write_bytes(b"\xef\xbb\xbfa = 1\n")
    assert read_toml(tmp_path / "x.toml") == {"a": 1}
    (tmp_path / "x.toml").write_text("a = " + "[" * (DEPTH - 2) + "]" * (DEPTH - 2))
    read_toml(tmp_path / "x.toml")
    (tmp_path / "pool.toml").write_text(f"a = {'[' * 5000}")
    with pytest.raises(InputError, match="not TOML"):
        read_pool_spec(tmp_path / "pool.toml")


@pytest.mark.parametrize(
    ("focal", "baseline"), [("0", "100"), ("-700", "100"), ("1e999", "100"), ("700", "0"), ("700", "-1")]
)
def test_cameras_that_cannot_be(tmp_path: Path, focal: str, baseline: str) -> None:
    path = tmp_path / "calib.txt"
    path.write_text(f"cam0=[{focal} 0 0; 0 {focal} 0; 0 0 1]\nbaseline={baseline}\ndoffs=0\n")
    with pytest.raises(
        InputError, match=r"calib\.txt: (focal|baseline) is .*, expected a finite number above 0"
    ):
        read_calibration(path)


@pytest.mark.parametrize("text", ["P0: 7.2e+02 0 0\n", "cam0=[700 0 0; 0 700 0; 0 0 1]\nbaseline=100\n"])
def test_a_calibration_of_another_form_keeps_nobody_from_scoring(tmp_path: Path, text: str) -> None:
    root = write_pairs(tmp_path, 1, size=(8, 16))
    (root / "pair0" / "calib.txt").write_text(text)
    sample = open_benchmark("pairs", root).pairs[0].load()
    assert sample.calibration is None
    with pytest.raises(InputError, match=r"expected a Middlebury calib\.txt"):
        read_calibration(root / "pair0" / "calib.txt")


def stored(folder: Path) -> Evaluation:
    evaluator = sfkit.Evaluator(flat_pool(folder, {"low": 4.0}), benchmark(metric="epe"))
    (evaluation,) = evaluator.evaluate([evaluator.pool.uniform()])
    return evaluation


def test_only_rows_that_an_evaluator_could_have_written_are_imported(tmp_path: Path) -> None:
    """Measured before: "best epe: -6.49", and rows without images that ended every later search."""
    good = stored(tmp_path / "pool")
    image = good.images[0]
    whole = image.regions["all"]
    bad = {
        "its key is not the digest": replace(good, key="0" * 64),
        "expected at least one and each once": replace(good, images=()),
        "each once": replace(good, images=(image, image)),
        "expected sums and counts": replace(
            good, images=(replace(image, regions={"all": replace(whole, sum_abs=-6.49)}),)
        ),
        "found RegionErrors": replace(
            good, images=(replace(image, regions={"all": replace(whole, d1=whole.pixels + 1)}),)
        ),
    }
    for number, (message, row) in enumerate(bad.items()):
        with (
            EvaluationStore(tmp_path / f"{number}.sqlite") as source,
            EvaluationStore(tmp_path / f"into{number}.sqlite") as target,
        ):
            source.put(row)
            with pytest.raises(InputError, match=message):
                import_evaluations(source, target)
            assert len(target) == 0
    with EvaluationStore(tmp_path / "s.sqlite") as source, EvaluationStore(tmp_path / "t.sqlite") as target:
        source.put(good)
        assert import_evaluations(source, target) == (1, 0)


def test_a_journal_of_garbage_is_damaged(tmp_path: Path) -> None:
    (tmp_path / "j.jsonl").write_text('{"event": "start"}\n{"event": 3}\n{"event": "end"}\n')
    with pytest.raises(InputError, match="record 2 is damaged"):
        read_journal(tmp_path / "j.jsonl")
