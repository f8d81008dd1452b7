"""From a real base and real frames to sources, in a pool with other people's sources, to one network."""

from __future__ import annotations

import warnings
from dataclasses import replace
from pathlib import Path

import pytest
import torch

import sfkit
from sfkit.checkpoints.spec import read_pool_spec
from sfkit.datasets import memory_benchmark
from sfkit.datasets.pairs import Sample
from sfkit.datasets.training_sets import open_training_set
from sfkit.merging.network import load_network
from sfkit.search import RoutingSettings, SubsetSettings
from sfkit.search.pipeline import search_pool
from sfkit.search.plan import SearchPlan
from sfkit.training import Augmentation, TrainingSettings
from sfkit.training.finetune import finetune, read_training
from sfkit.training.scoring import scorer_of

REAL = Path(__file__).parents[1] / "pools" / "anynet_real.toml"
FRAMES = {"sceneflow": "SceneFlow", "instereo2k": "InStereo2K", "tartanair": "TartanAir"}
SETTINGS = TrainingSettings(
    epochs=100, max_steps=3, batch=1, augmentation=Augmentation(crop=(64, 128)), save_every=3, workers=0
)


def cut(sample: Sample) -> Sample:
    """The middle 128 x 256 px of a pair."""
    top, left = ((whole - part) // 2 for whole, part in zip(sample.size, (128, 256), strict=True))
    part = (slice(top, top + 128), slice(left, left + 256))
    return Sample(sample.id, sample.left[part], sample.right[part], sample.disparity[part], None)


@pytest.mark.slow
def test_sources_of_real_frames_join_real_sources_and_are_searched(real_data: Path, tmp_path: Path) -> None:
    base = real_data.resolve() / "anynet" / "base_sceneflow.tar"
    for name, folder in FRAMES.items():
        frames = open_training_set(name, real_data / "sources" / folder, hold_out=False)
        out = tmp_path / f"{name}.safetensors"
        made = finetune(base, frames, out, name="anynet", settings=SETTINGS)
        said = read_training(made.path)
        assert said is not None
        assert (made.steps, said["base"]["file"], said["data"]["name"]) == (3, base.name, name)
        before, after = (load_network(file, name="anynet").network.state_dict() for file in (base, out))
        assert any(not before[key].equal(after[key]) for key in before), "it learned something"
    stranger = tmp_path / "stranger.safetensors"
    finetune(None, frames, stranger, name="anynet", settings=replace(SETTINGS, max_steps=1))

    theirs = {source.name: source.path for source in read_pool_spec(REAL).sources}
    ours = {name: tmp_path / f"{name}.safetensors" for name in FRAMES}
    with warnings.catch_warnings():
        warnings.simplefilter("error")  # which says of a source that it is no fine-tune of the base
        pool = sfkit.open_pool(write_pool(tmp_path / "pool.toml", base, {**theirs, **ours}))
    assert pool.warnings == ()
    kin = pool.summary()["cosine to base"]
    assert kin[list(ours)].min() > kin[list(theirs)].max(), "three steps lead less far than a whole training"
    with pytest.warns(sfkit.SfkitWarning, match="'stranger' does not look like a fine-tune of the base"):
        sfkit.open_pool(write_pool(tmp_path / "mixed.toml", base, {**ours, "stranger": stranger}))

    sample = cut(
        sfkit.open_benchmark("pairs", real_data / "pairs" / "cones", coding="png8:4").pairs[0].load()
    )
    scorer = sfkit.Evaluator(pool, memory_benchmark("cones", [sample], metric="epe"))
    plan = SearchPlan(
        stage1=SubsetSettings(population=4, generations=1), stage2=RoutingSettings(evaluations=4)
    )
    found = search_pool(pool, scorer, plan, tmp_path / "search")
    assert found.stage1 is not None
    assert 2 <= len(found.stage1.subset) <= len(pool.names) == 7
    (again,) = scorer([sfkit.read_recipe(tmp_path / "search" / "recipe.json")])
    assert again.score == found.score
    written = load_network(found.merged, name="anynet")
    (alone,) = scorer_of(scorer.benchmark, written.inputs, torch.device("cpu"))(written.network.eval())
    assert alone == pytest.approx(found.score, abs=1e-4), "the file alone, without pool or recipe"


def write_pool(path: Path, base: Path, sources: dict[str, Path]) -> Path:
    """Every path is absolute: the sources lie in two places."""
    lines = ['name = "real"\narchitecture = "anynet"\nroot = "/"', f'[base]\nfile = "{base}"']
    lines += [f'[sources.{name}]\nfile = "{file.resolve()}"' for name, file in sources.items()]
    path.write_text("\n\n".join(lines) + "\n")
    return path
