"""The second bank as it ships: what it is made of, and the bar it was given."""

from __future__ import annotations

import json
import tomllib
from dataclasses import asdict

import pytest
from safetensors.torch import load_file

import sfkit
from sfkit import bank
from sfkit.bank.building import pool_toml
from sfkit.bank.measure import errors, held_out_pairs
from sfkit.bank.plan import BANK, SLIM
from sfkit.bank.training import new_network

DATA = bank.pool_path("bank-slim").parent
TRAININGS = json.loads((DATA / "trainings.json").read_text())


def test_it_opens_by_name_and_has_the_first_bank_s_sources() -> None:
    first, second = (sfkit.open_pool(name) for name in ("bank", "bank-slim"))
    assert first.names == second.names
    assert first.blocks == second.blocks
    assert second.architecture.name == "anynet-slim"
    assert second.layout.size < 0.5 * first.layout.size
    assert not {s.fingerprint for s in first.sources} & {s.fingerprint for s in second.sources}


def test_its_pool_toml_is_what_the_builder_writes() -> None:
    assert tomllib.loads((DATA / "pool.toml").read_text()) == tomllib.loads(pool_toml(SLIM))


def test_it_takes_less_than_two_megabytes() -> None:
    assert sum(path.stat().st_size for path in DATA.iterdir()) < 2_000_000


@pytest.mark.parametrize("name", TRAININGS)
def test_every_network_meets_the_bar(name: str) -> None:
    """Far better than the best constant guess, and a source better than the base at home."""
    record = TRAININGS[name]
    own = record["own_domain"]
    assert record["plan"] == asdict(SLIM.base if name == "plain" else SLIM.plan_of(name))
    last = own.get("source", own["base"])
    assert last["epe"] < 0.5 * own["constant_guess"]["epe"]
    if name != "plain":
        assert last["epe"] < own["base"]["epe"]


def test_all_trainings_fit_into_twenty_minutes_of_one_core() -> None:
    assert sum(record["cpu_seconds"] for record in TRAININGS.values()) < 20 * 60


def test_a_record_holds_when_measured_again() -> None:
    pairs = held_out_pairs(bank.domains()["haze"], 6)
    network = new_network(0, SLIM)
    found = {}
    for name in ("base", "haze"):
        network.load_state_dict(load_file(DATA / f"{name}.safetensors"))
        found[name] = errors(network, pairs)["epe"]
    assert found["haze"] < 0.8 * found["base"]


def test_weights_of_one_bank_do_not_fit_the_other() -> None:
    with pytest.raises(RuntimeError, match="size mismatch"):
        new_network(0, BANK).load_state_dict(load_file(DATA / "base.safetensors"))
