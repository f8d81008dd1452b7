"""A search that validates on pairs which a source was trained on is told so, wherever the two meet."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from safetensors.torch import load_file
from training_worlds import SETTINGS, tiny_sample, tiny_set
from typer.testing import CliRunner

import sfkit
from sfkit.checkpoints.targets import FileForm
from sfkit.cli.app import app
from sfkit.datasets import memory_benchmark
from sfkit.datasets.pairs import MemoryPair
from sfkit.datasets.training_set import TrainingSet
from sfkit.datasets.training_sets import open_training_set
from sfkit.evaluation import Evaluator, separation
from sfkit.training.finetune import finetune

NAME, OPTIONS = "anynet", {"ranges": [2, 2, 2], "spn": False}
BRIEF = replace(SETTINGS, epochs=1)


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("base") / "base.safetensors"
    return finetune(None, tiny_set(), path, name=NAME, options=OPTIONS, settings=BRIEF).path


def written(folder: Path, indices: range) -> Path:
    """A folder of rendered pairs, as one's own pairs lie on disk."""
    for index in indices:
        sample = tiny_sample(index)
        place = folder / sample.id
        place.mkdir(parents=True)
        for name in ("left", "right"):
            cv2.imwrite(str(place / f"{name}.png"), cv2.cvtColor(getattr(sample, name), cv2.COLOR_RGB2BGR))
        np.save(place / "disparity.npy", sample.disparity)
    return folder


def pool_of(base: Path, **sources: Path) -> Path:
    spec = next(iter(sources.values())).with_name("pool.toml")
    lines = "".join(f'[sources.{name}]\nfile = "{path}"\n' for name, path in sources.items())
    spec.write_text(
        f'name = "tiny"\narchitecture = "{NAME}"\nroot = "/"\n[options]\nranges = [2, 2, 2]\nspn = false\n'
        f'[base]\nfile = "{base}"\n{lines}'
    )
    return spec


@pytest.mark.filterwarnings("ignore:.*looks wrong")
def test_a_search_on_the_pairs_of_a_source_is_warned_and_on_others_is_not(base: Path, tmp_path: Path) -> None:
    seen, other = written(tmp_path / "seen", range(4)), written(tmp_path / "other", range(4, 6))
    data = open_training_set("pairs", seen)
    # A training set and a benchmark need not be the same to share some pairs.
    learned = finetune(base, data.first(3), tmp_path / "learned.safetensors", settings=BRIEF)
    plain = finetune(base, tiny_set(), tmp_path / "plain.safetensors", settings=BRIEF)
    spec = pool_of(base, learned=learned.path, plain=plain.path)
    pool = sfkit.open_pool(spec)
    with pytest.warns(sfkit.SfkitWarning, match=r"'seen': members.*: 'learned' \(3 of 4\);"):
        Evaluator(pool, sfkit.open_benchmark("pairs", seen))
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*looks wrong")  # so small that much lies outside
        warnings.filterwarnings("error", message=".*members of the pool were trained")
        Evaluator(pool, sfkit.open_benchmark("pairs", other))

    command = ["search", str(spec), "-b", "pairs", "--root", str(other), "--test", f"pairs,root={seen}"]
    command += ["--population", "4", "--generations", "1", "--evaluations", "0"]
    with pytest.warns(sfkit.SfkitWarning, match=r"'seen': members.*: 'learned' \(3 of 4\);"):
        done = CliRunner().invoke(app, [*command, "-o", str(tmp_path / "found")])
    assert done.exit_code == 0, done.output


@pytest.mark.filterwarnings("ignore:.*looks wrong")
def test_a_torch_file_and_pairs_in_memory_are_told_of_as_well(base: Path, tmp_path: Path) -> None:
    held = [tiny_sample(index) for index in (0, 1, 20)]
    own = TrainingSet("own", tuple(MemoryPair(s.id, s) for s in held[1:]))
    wrapped = tmp_path / "wrapped.tar"
    torch.save({"state_dict": load_file(base)}, wrapped)
    few, form = replace(BRIEF, batch=2), FileForm.ORIGINAL
    source = finetune(wrapped, own, tmp_path / "own.tar", name=NAME, options=OPTIONS, settings=few, form=form)
    pool = sfkit.open_pool(pool_of(base, own=source.path))
    with pytest.warns(sfkit.SfkitWarning, match=r"'base' \(2 of 3\), 'own' \(2 of 3\)"):
        Evaluator(pool, memory_benchmark("held", held, metric="epe"))


def test_large_sets_are_not_named_pair_by_pair(monkeypatch: pytest.MonkeyPatch) -> None:
    pairs = tiny_set(3).pairs
    assert len(separation.seen_in_training(pairs).split()) == 3
    monkeypatch.setattr(separation, "MOST_SEEN", 2)
    assert separation.seen_in_training(pairs) == ""
