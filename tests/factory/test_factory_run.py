"""A factory on the bank's domains from nothing: trains, searches, goes on, and grows by its own share."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from safetensors.torch import load_file

import sfkit
from sfkit import bank
from sfkit.bank.rendered import RenderedPair
from sfkit.factory import read_factory, run, status
from sfkit.factory.status import DONE, MISSING, RUNNING, STALE
from sfkit.training.finetune import finetune

TEXT = """
name = "small"
base = "base.safetensors"
architecture = "anynet"
joint = {joint}

[options]
ranges = [4, 3, 3]
spn = false

[training]
epochs = 2
batch = 2
rate = 1e-4
save_every = 1
workers = 0
augmentation = {{ crop = [64, 128] }}

{sources}
[validation]
name = "bank:courtyard"
pairs = 1

[[tests]]
name = "bank:grey-workshop"
pairs = 1

[search]
population = 4
generations = 1
evaluations = 0
"""


def write(folder: Path, *names: str, joint: bool = False, rate: str = "") -> Path:
    (folder / "base.safetensors").write_bytes((bank.pool_path().parent / "base.safetensors").read_bytes())
    sources = "".join(
        f'[sources.{name}]\ndata = "bank:{name}"\npairs = 2\n{rate if name == "haze" else ""}\n'
        for name in names
    )
    path = folder / "factory.toml"
    path.write_text(TEXT.format(sources=sources, joint=str(joint).lower()))
    return path


def test_a_factory_runs_goes_on_and_grows(tmp_path: Path) -> None:
    path = write(tmp_path, "haze", "far-scene", joint=True)
    assert [item.state for item in status(read_factory(path))] == [MISSING] * 3
    made = run(read_factory(path))
    assert made.trained == ("haze", "far-scene", "joint")
    assert set(made.scores) == {"base", "uniform", "merged", "haze", "far-scene", "joint"}
    assert all(set(row) == {"courtyard", "grey-workshop"} for row in made.scores.values())
    assert made.scores["merged"]["courtyard"] == pytest.approx(made.found.score)
    assert [item.state for item in made.items] == [DONE] * 3

    again = run(read_factory(path))
    assert again.trained == ()
    assert again.evaluated == 0
    assert again.scores == made.scores

    grown = run(read_factory(write(tmp_path, "haze", "far-scene", "thin-things")))
    assert grown.trained == ("thin-things",)
    assert 0 < grown.evaluated <= 4 + 4 + 3  # a population, its offspring and what the test adds
    assert grown.scores["haze"] == made.scores["haze"]

    stale = status(read_factory(write(tmp_path, "haze", "far-scene", rate="training = { rate = 2e-4 }")))
    assert [item.state for item in stale] == [STALE, DONE]


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
    assert [item.state for item in status(factory)] == [RUNNING, MISSING]
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
        ('data = "bank:haze"', 'data = "sintel"', "the key root is missing, expected the folder of 'sintel'"),
        ('"bank:grey-workshop"', '"bank:courtyard"', "courtyard is validation and test"),
        ("batch = 2", "bach = 2", "unknown key of .* 'bach'"),
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
