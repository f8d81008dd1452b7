"""The sharp bank that ships: complete, small, trained as its plan says; its benchmarks rank alike."""

from __future__ import annotations

import json
import re
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from bank_fingerprints import agree, read_fingerprints

import sfkit
from sfkit import bank
from sfkit.bank import sharp
from sfkit.bank.building import pool_toml
from sfkit.bank.fingerprints import fingerprint
from sfkit.bank.plan import BANKS, SHARP
from sfkit.checkpoints.spec import Member
from sfkit.training.finetune import read_training

DATA = bank.pool_path("bank-sharp").parent
PAGE = Path(__file__).parents[2] / "docs" / "bank.md"
NETWORKS = SHARP.networks
TRAININGS: dict[str, Any] = json.loads((DATA / "trainings.json").read_text())


def file_of(name: str) -> Path:
    return DATA / f"{'base' if name == 'plain' else name}.safetensors"


def test_it_is_complete_and_all_banks_together_are_small() -> None:
    networks = {file_of(name).name for name in NETWORKS}
    files = {path.name for path in DATA.iterdir()}
    assert files == networks | {"pool.toml", "trainings.json", "fingerprints.json"}
    assert set(TRAININGS) == set(NETWORKS)
    every = [path for plan in BANKS.values() for path in plan.pool_file.parent.iterdir()]
    assert sum(path.stat().st_size for path in every) < 12e6


def test_its_pool_toml_is_what_the_builder_writes() -> None:
    assert tomllib.loads((DATA / "pool.toml").read_text()) == tomllib.loads(pool_toml(SHARP))


def test_it_opens_with_its_sources_and_its_worlds() -> None:
    pool = sfkit.open_pool("bank-sharp")
    assert pool.names == sfkit.open_pool("bank").names
    assert pool.architecture.name == "anynet-wide"
    assert bank.worlds("bank-sharp", None)[0] == "bank-sharp:courtyard"
    assert list(bank.training_seconds("bank-sharp")) == list(pool.names)
    assert list(sfkit.open_source_data("bank-sharp", pairs=1)) == list(pool.names)
    joint = sfkit.open_pool(replace(pool.spec, sources=(Member("joint", bank.joint_path("bank-sharp")),)))
    assert joint.layout.size == pool.layout.size


@pytest.mark.parametrize("name", NETWORKS)
def test_each_file_says_that_it_was_trained_as_its_plan_says(name: str) -> None:
    said = read_training(file_of(name))
    assert said is not None
    assert said["settings"] == json.loads(json.dumps(SHARP.plan_of(name).describe()))  # type: ignore[union-attr]
    assert said["data"]["fingerprint"] == sharp.training_set(name, Path()).fingerprint()
    assert said["licence"] == TRAININGS[name]["licence"] == "Apache-2.0"
    assert TRAININGS[name]["plan"]["steps"] == said["steps"]
    assert TRAININGS[name]["seconds"] > 0


def test_every_source_began_from_the_base_that_ships() -> None:
    marks = {read_training(file_of(name))["base"]["fingerprint"] for name in NETWORKS[1:]}  # type: ignore[index]
    assert marks == {sfkit.open_pool("bank-sharp").base.fingerprint}


def test_the_base_meets_its_bar() -> None:
    own = TRAININGS["plain"]["own_domain"]
    assert own["base"]["epe"] <= own["constant_guess"]["epe"] / 10
    assert own["base"]["bad3"] < 5


def test_every_source_beats_the_base_at_home() -> None:
    owns = {name: TRAININGS[name]["own_domain"] for name in NETWORKS if name not in ("plain", sharp.JOINT)}
    assert len(owns) == 11
    assert [name for name, own in owns.items() if own["source"]["epe"] >= 0.95 * own["base"]["epe"]] == []


def test_sources_that_harm_are_kept() -> None:
    """Recorded by ``docs/bank_page.py``: alone, on the mean of the unseen benchmarks, against the base."""
    rows = table_of("Benchmarks, bad-3.0 in percent")
    means = {row[0]: float(row[-1]) for row in rows[2:]}
    pool = sfkit.open_pool("bank-sharp").names
    harmful = [name for name in pool if means[name] > means["plain"]]
    assert len(harmful) == 9
    assert means["scanned-street"] < means["uneven-exposure"] < means["plain"]
    assert means[sharp.JOINT] < min(means[name] for name in (*pool, "plain", "uniform"))


def table_of(title: str) -> list[list[str]]:
    """The rows of the page's table below a heading that begins so, its heads and their rule first."""
    section = PAGE.read_text(encoding="utf-8").split(f"## {title}")[1].split("\n## ")[0]
    return [[c.strip() for c in line.strip("|").split("|")] for line in re.findall(r"^\|.*$", section, re.M)]


@pytest.mark.parametrize("name", bank.benchmarks())
def test_this_machine_renders_the_benchmarks_that_were_scored(name: str) -> None:
    expected = read_fingerprints(DATA / "fingerprints.json")
    pairs = bank.benchmark(name, of="bank-sharp").pairs
    assert {pair.id for pair in pairs} <= set(expected)
    assert agree(fingerprint(pairs[20].load()), expected[pairs[20].id])


def test_two_halves_of_each_benchmark_rank_subsets_alike() -> None:
    """Recorded by ``docs/bank_page.py``: at least 0.7 on each, at the number of pairs there are."""
    rows = table_of("How alike two halves")
    assert rows[0][-1] == f"{SHARP.pairs} pairs"
    found = {row[0]: float(row[-1]) for row in rows[2:]}
    assert set(found) == set(bank.benchmarks())
    assert min(found.values()) >= 0.7, found
