"""Building: files, records, and that what is finished is not repeated."""

import json
import tomllib
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file

from sfkit import InputError, bank
from sfkit.bank.building import pool_toml
from sfkit.bank.measure import constant_guess, errors
from sfkit.bank.plan import TrainingPlan, bank_plan
from sfkit.bank.training import new_network
from sfkit.datasets.synthetic import domains, synthetic_pair
from sfkit.evaluation.metrics import bad, epe

TINY = TrainingPlan(steps=1, peak_rate=1e-3, scenes=2, batch=2)


@pytest.fixture(scope="module")
def built(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("bank")
    bank.build(out, only=["haze"], base_plan=TINY, source_plan=TINY, held_out=1)
    return out


def test_a_part_of_the_bank_has_its_files(built: Path) -> None:
    keys = set(new_network(1).state_dict())
    for name in ("base", "haze"):
        assert set(load_file(built / f"{name}.safetensors")) == keys
    assert not (built / "pool.toml").exists()  # ten sources are still missing


def test_records_say_cost_and_quality(built: Path) -> None:
    record = json.loads((built / "training" / "haze.json").read_text())
    assert record["plan"]["steps"] == 1
    assert record["seconds"] > 0
    assert record["cpu_seconds"] > 0
    assert set(record["own_domain"]) == {"constant_guess", "base", "source"}
    assert all(set(errors) == {"epe", "bad3"} for errors in record["own_domain"].values())


def test_the_source_starts_from_the_base(built: Path) -> None:
    base, source = load_file(built / "base.safetensors"), load_file(built / "haze.safetensors")
    apart = max(float((base[key] - source[key]).abs().max()) for key in base if key.endswith("weight"))
    assert 0 < apart < 0.01  # one step of Adam at a rate of 2e-5


def test_building_again_trains_nothing(built: Path) -> None:
    before = {path: path.stat().st_mtime_ns for path in built.rglob("*") if path.is_file()}
    heard = []
    bank.build(
        built,
        only=["haze"],
        base_plan=TINY,
        source_plan=TINY,
        held_out=1,
        progress=lambda *w: heard.append(w),
    )
    assert heard == []
    assert {path: path.stat().st_mtime_ns for path in built.rglob("*") if path.is_file()} == before


def test_an_unknown_source_is_refused_before_any_work(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"unknown source of the bank 'hase'.*did you mean 'haze'"):
        bank.build(tmp_path / "out", only=["hase"])
    assert not (tmp_path / "out").exists()


def test_pool_toml_names_every_network() -> None:
    pool = tomllib.loads(pool_toml())
    assert pool["architecture"] == "anynet"
    assert pool["options"] == {"ranges": [4, 3, 3], "spn": False}
    assert pool["base"]["file"] == "base.safetensors"
    assert list(pool["sources"]) == list(domains())[1:]


def test_a_second_bank_has_the_same_sources_and_networks_of_another_shape() -> None:
    slim = tomllib.loads(pool_toml(bank_plan("bank-slim")))
    assert slim["name"] == "sfkit-bank-slim"
    assert list(slim["sources"]) == list(tomllib.loads(pool_toml())["sources"])
    wide, narrow = (new_network(1, bank_plan(name)).state_dict() for name in ("bank", "bank-slim"))
    assert wide.keys() == narrow.keys()
    apart = [key for key in wide if wide[key].shape != narrow[key].shape]
    assert any(key.startswith("volume_postprocess.0") for key in apart)
    assert not any(key.startswith("feature_extraction") for key in apart)


def test_an_unknown_bank_is_refused_with_the_nearest(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"unknown embedded bank 'bank-slem'.*did you mean 'bank-slim'"):
        bank.build(tmp_path / "out", "bank-slem")
    assert not (tmp_path / "out").exists()


def test_measured_errors_equal_the_evaluation_s_metrics() -> None:
    pairs = [synthetic_pair(domains()[name], 0, split="held-out") for name in ("plain", "scanned-street")]
    known = torch.cat([torch.from_numpy(p.disparity).flatten() for p in pairs])
    middle = known[torch.isfinite(known)].numpy()
    guess = float(sorted(middle)[len(middle) // 2])
    maps = [torch.full(p.disparity.shape, guess).numpy() for p in pairs]
    found = constant_guess(pairs)
    mean_epe = sum(epe(m, p.disparity) for m, p in zip(maps, pairs, strict=True)) / 2
    mean_bad = sum(bad(m, p.disparity, 3.0) for m, p in zip(maps, pairs, strict=True)) / 2
    assert found["epe"] == pytest.approx(mean_epe, rel=1e-3)
    assert found["bad3"] == pytest.approx(mean_bad, rel=1e-2)
    assert errors(new_network(1), pairs)["epe"] > 0
