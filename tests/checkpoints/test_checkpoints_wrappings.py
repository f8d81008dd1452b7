"""Checkpoints as training scripts leave them: whatever is around the weights, the network is the same."""

from __future__ import annotations

import argparse
import collections
import functools
import json
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import tiny
import torch
from safetensors.torch import save_file

from sfkit import FileForm, save_merged
from sfkit.architectures import architecture
from sfkit.checkpoints.fingerprints import fingerprint, tensor_digest
from sfkit.checkpoints.layouts import Wrapping
from sfkit.checkpoints.reading import read_checkpoint
from sfkit.errors import InputError, SfkitWarning
from sfkit.merging import open_pool
from sfkit.merging.members import PoolOpener
from sfkit.merging.tensor_specs import tensor_specs

STATE = tiny.base_state()
OTHER = tiny.fine_tune(STATE, 1)
OPTIMISER = {
    "state": {0: {"step": torch.tensor(3.0), "exp_avg": torch.ones(2)}},
    "param_groups": [{"lr": 1e-3}],
}


class Config(dict[str, Any]):
    """A configuration that is a dictionary with attributes, as yacs and easydict make them."""


class Scheduler:
    """OneCycleLR of old: its state holds a bound method."""

    def anneal(self) -> None:
        """Stand for a cosine."""


class Trainer:
    """A class of the training code."""

    def __init__(self) -> None:
        self.best = np.float64(0.7)


def at(prefix: str, state: dict[str, torch.Tensor] = STATE) -> dict[str, torch.Tensor]:
    """A state dict with a prefix before each key."""
    return {prefix + key: tensor for key, tensor in state.items()}


def configuration() -> Config:
    """Nested, and with attributes of its own."""
    config = Config(MODEL=Config(WIDTH=3))
    config.__dict__["frozen"] = True
    return config


# What torch.save is given: name -> content.
WRAPPINGS: dict[str, Callable[[], object]] = {
    "bare": lambda: dict(STATE),
    "module": lambda: {"state_dict": at("module.")},
    "module twice": lambda: {"state_dict": at("module.module.")},
    "compiled": lambda: {"model": at("_orig_mod.")},
    "compiled and parallel": lambda: at("_orig_mod.module."),
    "model prefix": lambda: {"state_dict": at("model.")},
    "net prefix": lambda: at("net."),
    "container net": lambda: {"net": STATE, "acc": 0.3, "epoch": 3},
    "container network": lambda: {"network": STATE},
    "container params": lambda: {"params": STATE},
    "container params_ema": lambda: {"params_ema": STATE},
    "container weights": lambda: {"weights": STATE},
    "ema in a module": lambda: {"ema": {"module": STATE, "decay": 0.999}},
    "a state in a model": lambda: {"model": {"state_dict": STATE, "arch": "anynet"}},
    "Lightning": lambda: {
        "state_dict": at("model.") | {"loss.vgg.weight": torch.ones(3)},
        "pytorch-lightning_version": "2.1",
        "hyper_parameters": argparse.Namespace(lr=1e-3),
        "callbacks": {"ModelCheckpoint{'monitor': 'epe'}": {"best_model_score": torch.tensor(1.0)}},
        "optimizer_states": [OPTIMISER],
    },
    "OpenStereo": lambda: {
        "model_state": STATE,
        "optimizer_state": OPTIMISER,
        "scheduler_state": {"last_epoch": 3, "anneal_func": Scheduler().anneal},
        "scaler_state": {},
        "epoch": 3,
    },
    "numpy": lambda: {"state_dict": STATE, "best": np.float64(0.3), "curve": np.arange(3.0)},
    "a namespace": lambda: {"model": STATE, "args": argparse.Namespace(root=Path("x"), size=np.int64(3))},
    "a configuration": lambda: {"model": STATE, "cfg": configuration()},
    "collections": lambda: {
        "model": STATE,
        "seen": collections.defaultdict(list, {"a": [1]}),
        "last": collections.deque([1.0, 2.0]),
        "hook": functools.partial(print, "no"),
    },
    "random states": lambda: {
        "model": STATE,
        "rng": torch.get_rng_state().tolist(),
        "numpy_rng": np.random.RandomState(3).get_state(),
    },
    "a trainer": lambda: {"state_dict": at("module."), "trainer": Trainer()},
    "foreign entries in the state": lambda: {"state_dict": at("model.") | {"extra": None, "tag": "x"}},
}


def opener() -> PoolOpener:
    """For AnyNets of the tiny pool."""
    entry = architecture("anynet")
    options = entry.resolve(tiny.OPTIONS)
    return PoolOpener(entry, options, tensor_specs(entry, options))


def identity(tensors: Any) -> str:
    """The fingerprint of a network's tensors."""
    return fingerprint({key: tensor_digest(tensor) for key, tensor in tensors.items()})


@pytest.mark.parametrize("archive", [True, False], ids=["archive", "legacy"])
@pytest.mark.parametrize("name", WRAPPINGS)
def test_the_network_is_the_same_in_every_wrapping(tmp_path: Path, name: str, archive: bool) -> None:
    torch.save(WRAPPINGS[name](), tmp_path / "x.pth", _use_new_zipfile_serialization=archive)
    file = opener().read(tmp_path / "x.pth", is_base=True)
    assert identity(file.tensors) == identity(STATE)


def test_there_are_twenty_wrappings() -> None:
    assert len(WRAPPINGS) >= 20


@pytest.mark.parametrize("suffix", [".bin", ".PTH", ".Safetensors"])
def test_endings(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"x{suffix}"
    if suffix.lower() == ".safetensors":
        save_file(STATE, path)
    else:
        torch.save(STATE, path)
    assert identity(opener().read(path, is_base=True).tensors) == identity(STATE)


def shards(folder: Path) -> Path:
    """The state in two files and their index."""
    keys = sorted(STATE)
    halves = {"model-1-of-2.safetensors": keys[::2], "model-2-of-2.safetensors": keys[1::2]}
    for name, held in halves.items():
        save_file({key: STATE[key] for key in held}, folder / name)
    index = {"metadata": {}, "weight_map": {key: name for name, held in halves.items() for key in held}}
    (folder / "model.safetensors.index.json").write_text(json.dumps(index))
    return folder / "model.safetensors.index.json"


def test_shards_are_one_network(tmp_path: Path) -> None:
    assert identity(opener().read(shards(tmp_path), is_base=True).tensors) == identity(STATE)


def remove_part(index: Path) -> None:
    """Lose the second file."""
    (index.parent / "model-2-of-2.safetensors").unlink()


def place_more(index: Path) -> None:
    """Name a tensor that the first file does not have."""
    content = json.loads(index.read_text())
    content["weight_map"]["gone"] = "model-1-of-2.safetensors"
    index.write_text(json.dumps(content))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (remove_part, "names model-2-of-2.safetensors, which is not there"),
        (place_more, "places 'gone' in model-1-of-2.safetensors, where it is not"),
        (lambda index: index.write_text("{"), "not JSON"),
        (lambda index: index.write_text('{"weight_map": {}}'), "has no weight_map"),
        (lambda index: index.write_text('{"weight_map": {"a": "../a"}}'), "files of its own folder"),
    ],
)
def test_broken_shards(tmp_path: Path, damage: Callable[[Path], object], message: str) -> None:
    index = shards(tmp_path)
    damage(index)
    with pytest.raises(InputError, match=message):
        read_checkpoint(index)


def test_a_hub_cache(tmp_path: Path) -> None:
    """A snapshot of links to blobs whose names have no ending."""
    repository = tmp_path / "models--lab--net"
    snapshot = repository / "snapshots" / "abc123"
    snapshot.mkdir(parents=True)
    (repository / "blobs").mkdir()
    for name, state in {"base": STATE, "a": OTHER}.items():
        save_file(state, repository / "blobs" / name)
        (snapshot / f"{name}.safetensors").symlink_to(f"../../blobs/{name}")
    (tmp_path / "pool.toml").write_text(
        f'name = "p"\narchitecture = "anynet"\nroot = "{snapshot}"\n'
        "[options]\nranges = [4, 3, 3]\nspn = false\n"
        '[base]\nfile = "base.safetensors"\n[sources.a]\nfile = "a.safetensors"\n'
    )
    assert open_pool(tmp_path / "pool.toml").names == ("a",)
    (tmp_path / "stray.safetensors").write_bytes((repository / "blobs" / "a").read_bytes())
    (snapshot / "a.safetensors").unlink()
    (snapshot / "a.safetensors").symlink_to(tmp_path / "stray.safetensors")
    # Links are the user's own; it is paths written in files that may not leave the root.
    assert open_pool(tmp_path / "pool.toml").names == ("a",)


def test_pool_toml_says_container_and_prefix(tmp_path: Path) -> None:
    """Where a file holds the network twice the pool says which; the merged file has the base's wrapping."""
    torch.save(
        {"model": {"net": at("student.")}, "ema": at("teacher.", OTHER) | at("student.")}, tmp_path / "b.pth"
    )
    torch.save({"ema": at("teacher.", OTHER) | at("student.")}, tmp_path / "a.pth")
    text = (
        'name = "p"\narchitecture = "anynet"\n'
        'prefix = "student."\n[options]\nranges = [4, 3, 3]\nspn = false\n'
        '[base]\nfile = "b.pth"\ncontainer = "model.net"\n'
        '[sources.a]\nfile = "a.pth"\nprefix = "teacher."\ncontainer = "ema"\n'
    )
    (tmp_path / "pool.toml").write_text(text)
    pool = open_pool(tmp_path)
    assert pool.base.fingerprint == identity(STATE)
    assert pool.identity == {"a": identity(OTHER)}
    path = save_merged(pool, pool.base_recipe(), tmp_path / "out.pth", form=FileForm.ORIGINAL)
    written = torch.load(path, weights_only=True)["model"]["net"]
    assert identity(written) == identity(at("student."))


@pytest.mark.parametrize(
    ("content", "wrapping", "message"),
    [
        ({"model": STATE}, Wrapping("gone"), "has no entry 'gone' .* found model"),
        ({"model": STATE, "n": 3}, Wrapping("n"), "'n' is a int, expected a state dict"),
        ({"model": STATE}, Wrapping(None, "net."), "no key begins with 'net.'"),
        (at("a.") | at("b."), None, "under the prefixes 'a.' and 'b.', expected one"),
        (dict(list(at("net.").items())[:-3]), None, "under the prefix 'net.' lie .* is missing"),
        ({"trainer": Trainer()}, None, r"trainer \(an object of .*\.Trainer, whose code sfkit does not run"),
        (Trainer(), None, r"found an object of .*\.Trainer, whose code"),
    ],
)  # fmt: skip
def test_refusals_name_the_prefix_or_type(
    tmp_path: Path, content: object, wrapping: Wrapping | None, message: str
) -> None:
    torch.save(content, tmp_path / "x.pth")
    with pytest.raises(InputError, match=message) as caught:
        opener().read(tmp_path / "x.pth", is_base=True, wrapping=wrapping)
    assert str(tmp_path / "x.pth") in str(caught.value)


def test_of_two_sets_of_weights_the_choice_is_said(tmp_path: Path) -> None:
    torch.save({"model": STATE, "ema": OTHER}, tmp_path / "x.pth")
    with pytest.warns(SfkitWarning, match="under model and ema, model was read"):
        file = read_checkpoint(tmp_path / "x.pth")
    assert identity(file.tensors) == identity(STATE)
    assert identity(read_checkpoint(tmp_path / "x.pth", Wrapping("ema")).tensors) == identity(OTHER)


class Shell:
    """Something whose reading would start a program."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return os.system, ("touch started",)


def test_the_operating_system_is_never_called(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    torch.save({"model": STATE, "x": Shell()}, "x.pth")
    with pytest.raises(InputError, match="would run pickled code"):
        read_checkpoint("x.pth")
    assert not Path("started").exists()
