"""A factory on the bank's domains from nothing: trains, searches, goes on, and grows by its own share."""

from __future__ import annotations

import json
from dataclasses import asdict, replace
from pathlib import Path

import pandas as pd
import pytest
from factory_files import write
from safetensors.torch import load_file, save_file
from typer.testing import CliRunner

import sfkit
from sfkit import bank
from sfkit.bank import sharp
from sfkit.bank.rendered import RenderedPair
from sfkit.cli.app import app
from sfkit.datasets.synthetic.domains import Domain
from sfkit.datasets.training_set import TrainingSet
from sfkit.errors import SfkitWarning
from sfkit.factory import (
    most_evaluations,
    read_factory,
    report_values,
    run,
    search_status,
    status,
    train_missing,
    write_example,
)
from sfkit.factory.running import warn_of_seen_pairs
from sfkit.factory.searching import begin, end
from sfkit.factory.standing import DONE, INTERRUPTED, MISSING, RUNNING, STALE
from sfkit.files import default_folder, holding, write_text
from sfkit.reports.parameters import parameter_defaults
from sfkit.reports.run import read_notebook
from sfkit.search import BayesianRoutingSettings
from sfkit.search.run_folder import LOCK, SEARCH
from sfkit.training.finetune import finetune


def test_a_factory_runs_goes_on_and_grows(tmp_path: Path) -> None:
    path = write(tmp_path, "haze", "far-scene", joint=True)
    assert [item.state for item in status(read_factory(path))] == [MISSING] * 3
    made = run(read_factory(path))
    assert made.trained == ("haze", "far-scene", "joint")
    assert set(made.scores) == {"base", "uniform", "merged", "haze", "far-scene", "joint"}
    assert all(set(row) == {"courtyard", "grey-workshop"} for row in made.scores.values())
    assert made.scores["merged"]["courtyard"] == pytest.approx(made.found.score)
    assert [item.state for item in made.items] == [DONE] * 3
    assert [(cost.part, cost.passes) for cost in made.costs[:3]] == [
        ("haze", 4),
        ("far-scene", 4),
        ("joint", 8),
    ]
    seconds = [cost.seconds for cost in made.costs]
    assert made.costs[3].part == "search"
    assert made.overhead() == pytest.approx(
        {"sources": 100 * seconds[3] / (seconds[0] + seconds[1]), "joint": 100 * seconds[3] / seconds[2]}
    )
    table = pd.read_csv(tmp_path / "costs.csv")
    assert table["part"].tolist() == ["haze", "far-scene", "joint", "search"]

    again = CliRunner().invoke(app, ["factory", "run", str(path), "--json"])
    assert again.exit_code == 0, again.output
    told = json.loads(again.stdout)
    assert (told["trained"], told["evaluated"], told["scores"]) == ([], 0, made.scores)
    assert told["costs"] == [asdict(cost) for cost in made.costs]
    listed = CliRunner().invoke(app, ["factory", "status", str(path)]).stdout
    assert [line.split()[:2] for line in listed.splitlines()[1:4]] == [
        ["haze", "done"],
        ["far-scene", "done"],
        ["joint", "done"],
    ]
    took = f"it took {made.costs[3].seconds:.0f} s"
    assert listed.splitlines()[4:] == [f"search: done, at most 1 evaluations on courtyard; {took}"]

    path = write(tmp_path, "haze", "far-scene", "thin-things")
    told = json.loads(CliRunner().invoke(app, ["factory", "status", str(path), "--json"]).stdout)
    expected, search = told["networks"][2], told["search"]
    assert (expected["state"], expected["done"], expected["steps"]) == ("missing", 0, 2)
    # All three are trained alike: by the mean pace of those that are done, which is that of the other two.
    assert expected["left"] == pytest.approx((seconds[0] + seconds[1]) / 2)
    assert search["state"] == "stale"
    assert search["seconds"] == pytest.approx(search["evaluations"] * search["each"])
    assert search["each"] == pytest.approx(seconds[3] / made.costs[3].passes), "one pair guides"
    grown = run(read_factory(path))
    assert grown.trained == ("thin-things",)
    assert 0 < grown.evaluated <= 4 + 4 + 3  # a population, its offspring and what the test adds
    assert grown.scores["haze"] == made.scores["haze"]
    assert grown.trust is None

    path = write(tmp_path, "haze", "far-scene", joint=True)
    path.write_text(path.read_text().replace('"bank:courtyard"', '"bank:courtyard"\nmetric = "census"'))
    with pytest.warns(SfkitWarning, match="1 pair can be overfitted, as labels can"):
        blind = run(read_factory(path))
    assert blind.trained == ()
    assert blind.trust is not None
    assert blind.trust.pairs == 1
    assert 0 < blind.scores["joint"]["courtyard"] < 50, "percent of census bits"
    assert blind.scores["joint"]["grey-workshop"] == made.scores["joint"]["grey-workshop"]

    stale = status(read_factory(write(tmp_path, "haze", "far-scene", rate="training = { rate = 2e-4 }")))
    assert [item.state for item in stale] == [STALE, DONE]


def test_other_data_and_another_base_make_a_source_stale_and_unknown_seconds_are_said(tmp_path: Path) -> None:
    path = write(tmp_path, "haze")
    listed = CliRunner().invoke(app, ["factory", "status", str(path)]).stdout.splitlines()
    assert listed[1].split() == ["haze", "missing", "2", "0", "unknown", "unknown"]
    assert listed[2].startswith("search: missing, at most 0 evaluations on courtyard; its seconds")
    assert listed[3].startswith("what is unknown is known once a training, or the search, has taken")
    told = CliRunner().invoke(app, ["factory", "status", str(path), "--measure", "--json"])
    (expected,), search = (json.loads(told.stdout)[key] for key in ("networks", "search"))
    assert expected["left"] == expected["seconds"] > 0
    assert search["each"] > 0
    assert search["seconds"] == 0.0, "one source leaves no subset to look for"
    assert sorted(file.name for file in tmp_path.iterdir()) == ["base.safetensors", "factory.toml"]

    (item,) = status(read_factory(path))
    item.file.parent.mkdir()
    item.file.write_bytes(b"stands for the source")
    assert [one.state for one in status(read_factory(path))] == [DONE]
    text, base = path.read_text(), tmp_path / "base.safetensors"
    path.write_text(text.replace('"bank:haze"\npairs = 2', '"bank:haze"\npairs = 3'))
    assert [one.state for one in status(read_factory(path))] == [STALE]
    path.write_text(text)
    tensors = load_file(base)
    key = next(key for key in tensors if key.endswith(".weight"))
    save_file({**tensors, key: tensors[key] + 1}, base)
    assert [one.state for one in status(read_factory(path))] == [STALE]


def test_a_search_runs_as_long_as_its_folder_is_held(tmp_path: Path) -> None:
    factory = read_factory(write(tmp_path, "haze", "far-scene"))
    files = {"haze": tmp_path / "a", "far-scene": tmp_path / "b"}

    def state() -> str:
        return search_status(factory, files).state

    assert state() == MISSING
    with holding(tmp_path / "search" / LOCK, "busy"):
        assert state() == RUNNING
        write_text(tmp_path / "search" / SEARCH, "{}")
    assert state() == INTERRUPTED, "it began, and nothing says that it ended"
    end(factory, files)
    assert state() == DONE
    files["haze"] = tmp_path / "of other data"
    assert state() == STALE
    begin(factory, files)
    assert state() == INTERRUPTED


def test_a_source_that_was_begun_goes_on_where_it_was(tmp_path: Path) -> None:
    factory = read_factory(write(tmp_path, "haze", "far-scene"))
    (item, _) = status(factory)

    class StoppedError(Exception):
        pass

    def stop(*_: object) -> None:
        raise StoppedError

    order = factory.orders[0]
    with pytest.raises(StoppedError):
        finetune(
            factory.base,
            order.data,
            item.file,
            name=factory.architecture,
            options=factory.options,
            settings=order.settings,
            listen=stop,
        )
    assert [item.state for item in status(factory)] == [INTERRUPTED, MISSING]
    run(factory)
    whole = tmp_path / "whole.safetensors"
    finetune(
        factory.base,
        order.data,
        whole,
        name=factory.architecture,
        options=factory.options,
        settings=replace(order.settings, save_every=100),
    )
    first, second = load_file(item.file), load_file(whole)
    assert all(bool((first[key] == second[key]).all()) for key in first)


@pytest.mark.parametrize(
    ("old", "new", "sentence"),
    [
        ("joint = false", "joints = 1", "unknown key of .*factory.toml 'joints'"),
        (
            'data = "bank:haze"',
            'data = "bank:hase"',
            "unknown domain of the bank 'hase'.*did you mean 'haze'",
        ),
        (
            'data = "bank:haze"\npairs = 2',
            'data = "bank-sharp:haze"\npairs = 401',
            "pairs = 401, expected at most 400",
        ),
        ('data = "bank:haze"', 'data = "sintel"', "the key root is missing, expected the folder of 'sintel'"),
        ('"bank:grey-workshop"', '"bank:courtyard"', "courtyard is validation and test"),
        ("batch = 2", "bach = 2", "unknown key of .* 'bach'"),
        ("population = 4", 'population = "x"', "population of .*: found 'x', expected a whole number"),
        ("evaluations = 0", "evaluations = 2.7", "evaluations of .*: found 2.7, expected a whole number"),
        ("evaluations = 0", "sigma = 0.2", r"unknown key of \[search\] in .* 'sigma'"),
        ("evaluations = 0", "batch = 4", "batch: found 4 with method paper, .*take method bayesian"),
        ("evaluations = 0", 'batch = 0\nmethod = "bayesian"', "batch: found 0, expected .* at least 1"),
        ("evaluations = 0", 'combine = "worst"', "combine of .*: found worst and one benchmark"),
        ("[sources.haze]", '[sources."a b"]', "source name 'a b', expected letters, digits"),
        (
            'name = "bank:grey-workshop"\npairs = 1',
            'name = "bank:courtyard"\npairs = 2',
            "'courtyard': found .* among the pairs that guide the search",
        ),
    ],
)
def test_a_file_that_makes_no_sense_is_refused(tmp_path: Path, old: str, new: str, sentence: str) -> None:
    path = write(tmp_path, "haze")
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    with pytest.raises(sfkit.InputError, match=sentence):
        read_factory(path)


def test_pairs_of_the_bank_are_training_pairs(tmp_path: Path) -> None:
    factory = read_factory(write(tmp_path, "haze"))
    assert factory.orders[0].data.pairs == (
        RenderedPair("haze", 0, "train"),
        RenderedPair("haze", 1, "train"),
    )
    path = write(tmp_path, "haze")
    path.write_text(path.read_text().replace('"bank:haze"', '"bank-sharp:haze"'))
    (order,) = read_factory(path).orders
    whole = sharp.training_set("haze", default_folder() / "rendered")
    assert order.data.name == "bank-sharp:haze"
    assert order.data.pairs == whole.pairs[:2]


def test_an_example_trains_the_base_of_the_bank_it_names(tmp_path: Path) -> None:
    file = write_example(tmp_path / "factory.toml", ["haze"], pairs=3, joint=True, of="bank-sharp")
    factory = read_factory(file)
    assert factory.base == bank.pool_path("bank-sharp").parent / "base.safetensors"
    assert factory.architecture == "anynet-wide"
    assert [pair.world for pair in factory.orders[0].data.pairs] == 3 * [_world("haze")]
    assert [each.name for each in factory.tests] == ["grey-workshop", "hazy-road"]
    warn_of_seen_pairs(factory)


def _world(name: str) -> Domain:
    return next(each for each in sharp.SOURCES if each.name == name)


def test_two_devices_train_what_one_trains_and_one_failure_keeps_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    alone = read_factory(write(tmp_path / "one", "haze", "far-scene"))
    together = read_factory(write(tmp_path / "two", "haze", "far-scene"))
    assert train_missing(alone) == ("haze", "far-scene")

    haze = status(together)[0].file
    haze.parent.mkdir(parents=True)
    obstacle = haze.with_name(f"{haze.stem}.training")
    obstacle.write_text("in the way")
    with pytest.raises(sfkit.SfkitError, match=r"^1 trainings failed: haze: .*all others are done"):
        train_missing(together, devices=("cpu", "cpu"))
    assert [item.state for item in status(together)] == [MISSING, DONE]

    obstacle.unlink()
    lines: list[str] = []
    assert train_missing(together, devices=("cpu", "cpu"), say=lines.append) == ("haze",)
    assert lines[0] == "haze: missing, 2 steps"
    assert lines[-1].startswith("haze: step 2 of 2, loss ")
    for one, two in zip(status(alone), status(together), strict=True):
        assert one.file.read_bytes() == two.file.read_bytes()


def test_a_source_that_learned_the_validation_s_pairs_is_warned_of(tmp_path: Path) -> None:
    text = write(tmp_path, "haze", "far-scene").read_text()
    pair = sfkit.open_benchmark("bank:courtyard", pairs=1).pairs[0]
    factory = read_factory(tmp_path / "factory.toml")
    order = replace(factory.orders[0], data=TrainingSet("seen", (pair, *factory.orders[0].data.pairs)))
    assert "courtyard" in text
    with pytest.warns(sfkit.SfkitWarning, match="haze is trained on 1 of 1 pairs of courtyard"):
        warn_of_seen_pairs(replace(factory, orders=(order, factory.orders[1])))


def test_several_guides_a_method_and_what_the_search_costs_at_most(tmp_path: Path) -> None:
    path = write(tmp_path, "haze", "far-scene", "thin-things")
    text = path.read_text().replace("[validation]", "[[validation]]", 1)
    text = text.replace("[[tests]]", '[[validation]]\nname = "bank:hazy-road"\npairs = 2\n\n[[tests]]')
    named = 'evaluations = 12\nbatch = 2\nmethod = "bayesian"\ncombine = "worst"\nresamples = 50'
    text = text.replace("evaluations = 0", named)
    path.write_text(text)
    factory = read_factory(path)
    assert factory.plan.resamples == 50
    assert [len(guide) for guide in factory.validation] == [1, 2]
    assert (factory.combine, factory.plan.method) == ("worst", "bayesian")
    assert factory.plan.stage2 == BayesianRoutingSettings(evaluations=12, batch=2)
    # Of three sources four subsets, and each alone; and the average of what wins resamples.
    assert most_evaluations(factory) == 4 + 3 + 12 + 1
    with pytest.raises(sfkit.InputError, match="2 validation benchmarks, method bayesian"):
        report_values(factory)
    for said, resamples in (("", 200), ("resamples = 0", 0)):
        path.write_text(text.replace("resamples = 50", said))
        assert read_factory(path).plan.resamples == resamples, "of three pairs, unless it is said"
    path.write_text(
        text.replace("resamples = 50", "").replace('method = "bayesian"', "").replace("batch = 2", "")
    )
    assert read_factory(path).plan.resamples == 0, "by the paper's method"


def test_the_report_is_given_the_factory_s_benchmarks_and_budgets(tmp_path: Path) -> None:
    path = write(tmp_path, "haze", "far-scene")
    path.write_text(path.read_text().replace("evaluations = 0", "evaluations = 9\nresamples = 25"))
    values = report_values(read_factory(path))
    assert values == {
        "pool": tmp_path / "pool.toml",
        "benchmark": "bank:courtyard",
        "benchmark_pairs": 1,
        "report_on": [{"name": "bank:grey-workshop", "pairs": 1}],
        "population": 4,
        "generations": 1,
        "evaluations": 9,
        "resamples": 25,
        "seed": 0,
    }
    book = Path(__file__).parents[2] / "notebooks" / "report.ipynb"
    assert set(values) <= set(parameter_defaults(book, read_notebook(book)))
