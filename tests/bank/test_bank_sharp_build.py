"""The sharp bank is built by ``finetune``, from worlds and settings that were fixed beforehand."""

from __future__ import annotations

import json
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from safetensors.torch import load_file

import sfkit
from sfkit import InputError, bank
from sfkit.bank import sharp
from sfkit.bank.building import pool_toml
from sfkit.bank.measure import errors
from sfkit.bank.plan import SHARP
from sfkit.bank.training import new_network
from sfkit.datasets.synthetic.domains import SOURCES
from sfkit.evaluation.table import ProgressCallback
from sfkit.training.finetune import read_training

CROP = replace(sharp.BASE_SETTINGS.augmentation, crop=(32, 64))
BASE_ONE = replace(sharp.BASE_SETTINGS, max_steps=1, batch=1, augmentation=CROP)
SOURCE_ONE = replace(sharp.SOURCE_SETTINGS, max_steps=1, batch=1, augmentation=CROP)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Base and one source after one step each, measured on one pair."""
    out = tmp_path_factory.mktemp("sharp")
    build(out)
    return out


def build(out: Path, progress: ProgressCallback | None = None) -> None:
    bank.build(
        out,
        SHARP.name,
        only=["haze"],
        base_plan=BASE_ONE,
        source_plan=SOURCE_ONE,
        held_out=1,
        progress=progress,
    )


def test_files_say_how_they_were_trained(built: Path) -> None:
    for file, name, settings in (("base", "plain", BASE_ONE), ("haze", "haze", SOURCE_ONE)):
        said = read_training(built / f"{file}.safetensors")
        assert said is not None
        assert said["architecture"]["name"] == "anynet-wide"
        assert said["settings"] == json.loads(json.dumps(settings.describe()))
        assert said["data"]["fingerprint"] == sharp.training_set(name, built).fingerprint()
        assert said["licence"] == "Apache-2.0"
        assert said["base"]["file"] == ("" if name == "plain" else "base.safetensors")
    assert not (built / "pool.toml").exists()  # ten sources and the joint network are still missing


def test_records_say_cost_and_quality_as_measured(built: Path) -> None:
    record = json.loads((built / "training" / "haze.json").read_text())
    assert (record["plan"]["steps"], record["plan"]["scenes"], record["licence"]) == (1, 400, "Apache-2.0")
    assert record["seconds"] > 0
    network = new_network(1, SHARP)
    network.load_state_dict(load_file(built / "haze.safetensors"))
    sample = bank.held_out("haze", 1, of="bank-sharp").pairs[0].load()
    assert record["own_domain"]["source"] == pytest.approx(errors(network, [sample], SHARP))


def test_building_again_trains_nothing_and_a_lost_record_is_measured_again(built: Path) -> None:
    heard: list[object] = []
    record = built / "training" / "haze.json"
    before, weights = record.read_text(), (built / "haze.safetensors").read_bytes()
    record.unlink()
    build(built, lambda *what: heard.append(what))
    assert heard == []
    assert (record.read_text(), (built / "haze.safetensors").read_bytes()) == (before, weights)


def test_a_whole_bank_is_a_pool_of_its_sources_alone(built: Path, tmp_path: Path) -> None:
    """One network under all names; what assembling adds opens, and the joint network is no source."""
    for name in SHARP.networks[1:]:
        if name != "haze":
            path = tmp_path / f"{name}.safetensors"
            path.write_bytes((built / "haze.safetensors").read_bytes())
    text = pool_toml(SHARP)
    (tmp_path / "pool.toml").write_text(text)
    listed = tomllib.loads(text)
    assert list(listed["sources"]) == [world.name for world in SOURCES]
    assert listed["options"] == {"ranges": [4, 3, 3]}
    assert (tmp_path / "joint.safetensors").exists()
    one = "\n".join(line for line in text.split("\n\n[sources.")[0].splitlines())
    path = built / "pool.toml"
    path.write_text(f'{one}\n\n[sources.haze]\nfile = "haze.safetensors"\nlicence = "Apache-2.0"\n')
    pool = sfkit.open_pool(path)
    path.unlink()
    assert pool.architecture.name == "anynet-wide"
    assert pool.names == ("haze",)
    assert len(pool.blocks) == 4


def test_worlds_are_the_first_banks_and_six_are_sharper() -> None:
    pairs = list(zip(sharp.SOURCES, SOURCES, strict=True))
    assert [ours.name for ours, _ in pairs] == [theirs.name for _, theirs in pairs]
    assert {ours.name for ours, theirs in pairs if ours != theirs} == {
        "far-scene",
        "bare-paint",
        "uneven-exposure",
        "sensor-noise",
        "haze",
        "scanned-street",
    }


def test_the_joint_network_learns_from_every_source_alike() -> None:
    joint = sharp.training_set(sharp.JOINT, Path("scenes"))
    assert len(joint) == 11 * 400
    assert joint.pairs[400:402] == sharp.training_set("bare-paint", Path("scenes")).pairs[:2]
    assert len(sharp.training_set("plain", Path("scenes"))) == 3000
    assert SHARP.networks[-1] == sharp.JOINT


def test_its_benchmarks_are_the_first_banks_worlds() -> None:
    ours, theirs = (sfkit.open_benchmark(f"{name}:hazy-road") for name in ("bank-sharp", "bank"))
    assert len(ours) == SHARP.pairs >= len(theirs)
    assert [pair.fingerprint() for pair in ours.pairs[:40]] == [pair.fingerprint() for pair in theirs.pairs]


def test_an_unknown_network_is_refused_and_one_without_joint_says_so(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"unknown source of the bank 'joind'.*did you mean 'joint'"):
        bank.build(tmp_path / "out", "bank-sharp", only=["joind"])
    with pytest.raises(InputError, match=r"no joint network ships with 'bank-slim'"):
        bank.joint_path("bank-slim")
    assert bank.joint_training("bank-slim") == (None, None)


def test_a_joint_network_stands_beside_the_wall_seconds_of_its_training(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sfkit.bank.shipped.pool_path", lambda name: tmp_path / "pool.toml")
    (tmp_path / "trainings.json").write_text('{"haze": {"seconds": 9.0}, "joint": {"seconds": 3600.5}}')
    assert bank.joint_training("any") == (None, None), "its file is missing"
    (tmp_path / "joint.safetensors").touch()
    assert bank.joint_training("any") == (tmp_path / "joint.safetensors", 3600.5)
