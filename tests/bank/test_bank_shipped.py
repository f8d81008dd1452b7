"""The bank that ships: complete, small, what its records say, and rendered alike on this machine."""

import json
import tomllib
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from bank_fingerprints import agree, read_fingerprints
from safetensors.torch import load_file

from sfkit import InputError, bank, open_pool
from sfkit.bank.building import pool_toml
from sfkit.bank.fingerprints import fingerprint
from sfkit.bank.measure import errors, held_out_pairs
from sfkit.bank.plan import BANK
from sfkit.bank.training import new_network

DATA = bank.pool_path().parent
SOURCES = [name for name in bank.domains() if name != "plain"]
TRAININGS: dict[str, Any] = json.loads((DATA / "trainings.json").read_text())


def network(file: str) -> Any:
    """A shipped network in evaluation mode."""
    made = new_network(0)
    made.load_state_dict(load_file(DATA / file))
    return made.eval()


def test_the_bank_is_complete_and_small() -> None:
    files = {path.name for path in DATA.iterdir()}
    networks = {f"{name}.safetensors" for name in ("base", *SOURCES)}
    assert files == networks | {"pool.toml", "trainings.json", "fingerprints.json"}
    assert sum((DATA / name).stat().st_size for name in files) < 8e6


def test_pool_toml_is_what_the_builder_writes() -> None:
    assert tomllib.loads(bank.pool_path().read_text()) == tomllib.loads(pool_toml())


@pytest.mark.parametrize("name", ["plain", *SOURCES])
def test_records_name_the_plan_that_would_be_trained(name: str) -> None:
    assert TRAININGS[name]["plan"] == asdict(BANK.base if name == "plain" else BANK.plan_of(name))


def test_the_pool_opens_without_a_warning() -> None:
    pool = open_pool(bank.pool_path())
    assert pool.names == tuple(SOURCES)
    assert len(pool.blocks) == 4


def test_the_base_meets_its_bar() -> None:
    own = TRAININGS["plain"]["own_domain"]
    assert own["base"]["epe"] <= own["constant_guess"]["epe"] / 5
    assert own["base"]["bad3"] < 15


@pytest.mark.parametrize("name", SOURCES)
def test_each_source_is_a_fifth_better_than_the_base_at_home(name: str) -> None:
    own = TRAININGS[name]["own_domain"]
    assert own["source"]["epe"] <= 0.8 * own["base"]["epe"]
    assert TRAININGS[name]["seconds"] > 0


def test_records_hold_when_measured_again() -> None:
    """The first eight of the 24 pairs, against the same eight: the records' order must show in them."""
    pairs = held_out_pairs(bank.domains()["soft-focus"], 8)
    base, source = (
        errors(network("base.safetensors"), pairs),
        errors(network("soft-focus.safetensors"), pairs),
    )
    assert source["epe"] <= 0.8 * base["epe"]
    assert source["bad3"] < base["bad3"]


@pytest.mark.slow
@pytest.mark.parametrize("name", ["plain", "haze"])
def test_records_are_exact(name: str) -> None:
    pairs = held_out_pairs(bank.domains()[name])
    found = errors(network("base.safetensors"), pairs)
    assert found["epe"] == pytest.approx(TRAININGS[name]["own_domain"]["base"]["epe"], rel=1e-2)
    assert found["bad3"] == pytest.approx(TRAININGS[name]["own_domain"]["base"]["bad3"], rel=2e-2)


@pytest.mark.parametrize("name", bank.benchmarks())
def test_this_machine_renders_the_benchmarks_that_were_shipped(name: str) -> None:
    expected = read_fingerprints(DATA / "fingerprints.json")
    for pair in bank.benchmark(name).pairs[::20]:
        assert agree(fingerprint(pair.load()), expected[pair.id])


@pytest.mark.slow
@pytest.mark.parametrize("name", bank.benchmarks())
def test_this_machine_renders_every_pair_that_was_shipped(name: str) -> None:
    expected = read_fingerprints(DATA / "fingerprints.json")
    assert [pair.id for pair in bank.benchmark(name).pairs if pair.id not in expected] == []
    for sample in bank.benchmark(name).samples():
        assert agree(fingerprint(sample), expected[sample.id]), sample.id


def test_a_fingerprint_tells_pairs_apart() -> None:
    shipped = list(read_fingerprints(DATA / "fingerprints.json").values())
    assert len(shipped) == 160
    assert not any(agree(a, b) for i, a in enumerate(shipped) for b in shipped[:i])


@pytest.mark.parametrize(
    ("change", "same"),
    [
        (lambda a: a, True),
        (lambda a: np.roll(a, 3, axis=1), False),
        (lambda a: np.minimum(a, 250).astype(np.uint8) + np.uint8(5), False),
    ],
)
def test_a_fingerprint_notices_what_rounding_cannot_do(change: Callable[[Any], Any], same: bool) -> None:
    sample = bank.benchmark("courtyard").pairs[0].load()
    altered = type(sample)(sample.id, change(sample.left), sample.right, sample.disparity, sample.nonoccluded)
    assert agree(fingerprint(altered), fingerprint(sample)) == same


def test_a_pixel_s_rounding_keeps_the_fingerprint() -> None:
    sample = bank.benchmark("courtyard").pairs[0].load()
    flips = np.random.default_rng(0).random(sample.left.shape) < 0.01
    left = np.where(flips, sample.left ^ 1, sample.left).astype(np.uint8)
    altered = type(sample)(sample.id, left, sample.right, sample.disparity, sample.nonoccluded)
    assert agree(fingerprint(altered), fingerprint(sample))


def test_benchmarks_have_forty_pairs_and_the_quick_one_its_first_eight() -> None:
    assert len(bank.benchmarks()) == 4
    assert bank.benchmarks()[0] == bank.VALIDATION
    for name in bank.benchmarks():
        assert len(bank.benchmark(name)) == 40
        assert bank.benchmark(name).metric == "bad-3.0"
    quick = bank.benchmark(bank.VALIDATION, quick=True)
    assert quick.ids == bank.benchmark(bank.VALIDATION).ids[:8]


def test_pairs_are_rendered_once() -> None:
    pair = bank.benchmark("hazy-road").pairs[0]
    assert pair.load() is pair.load()


def test_benchmark_fingerprints_depend_on_the_pairs_alone() -> None:
    marks = {bank.benchmark(name).fingerprint() for name in bank.benchmarks()}
    marks |= {bank.held_out(name, 4).fingerprint() for name in bank.domains()}
    assert len(marks) == 16
    again = bank.benchmark("courtyard").fingerprint()
    assert again == bank.benchmark("courtyard").fingerprint()
    assert bank.held_out("haze", 4).fingerprint() != bank.held_out("haze", 5).fingerprint()


def test_unknown_names_are_refused_with_the_nearest() -> None:
    with pytest.raises(InputError, match=r"unknown benchmark of the bank 'courtyrad'.*'courtyard'"):
        bank.benchmark("courtyrad")
    with pytest.raises(InputError, match=r"unknown domain of the bank 'hase'.*'haze'"):
        bank.held_out("hase", 1)
    with pytest.raises(InputError, match="expected it for the validation benchmark only"):
        bank.benchmark("hazy-road", quick=True)


def test_nothing_in_the_bank_bears_a_real_data_set_s_name() -> None:
    names = " ".join((*bank.domains(), *bank.benchmarks(), *(p.name for p in Path(DATA).iterdir())))
    for real in ("kitti", "eth3d", "middlebury", "sceneflow", "sintel", "booster", "driving", "cityscapes"):
        assert real not in names
