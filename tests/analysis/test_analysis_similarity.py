"""Similarity of data: known distances, features of a network of one's own, subsets, warping by hand."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import torch
from tiny import write_pool
from torch import nn

from sfkit.analysis import BlockOutputs, block_modules, data_similarity, similarity_recipes
from sfkit.analysis.similarity import frechet, warping_residual
from sfkit.architectures import architecture, architectures
from sfkit.datasets.benchmark import Benchmark, memory_benchmark
from sfkit.datasets.pairs import Sample
from sfkit.errors import InputError
from sfkit.merging import open_pool
from sfkit.merging.blocks import BlockPartition


def data(name: str, brightness: int, seed: int = 0) -> Benchmark:
    """Two pairs of noise around a brightness."""
    rng = np.random.default_rng(seed)
    samples = []
    for number in range(2):
        image = np.clip(rng.normal(brightness, 20, (32, 64, 3)), 0, 255).astype(np.uint8)
        truth = np.full((32, 64), 3.0, np.float32)
        samples.append(Sample(f"{name}{number}", image, np.roll(image, -3, axis=1), truth))
    return memory_benchmark(name, samples)


def test_the_distance_of_two_gaussians_is_that_of_hand() -> None:
    means, variances = np.array([[0.0, 0.0], [3.0, 0.0]]), np.array([[1.0, 4.0], [1.0, 0.0]])
    # Channel 1: variance over both sets 1 + 2.25, means 3 apart; channel 2: 2 + 0, deviations 2 apart.
    expected = np.sqrt(9.0 / 3.25 + 4.0 / 2.0)
    np.testing.assert_allclose(frechet(means, variances), [[0.0, expected], [expected, 0.0]])


@pytest.mark.parametrize("cue", ["rgb", "feature", "disparity"])
def test_the_same_data_is_nearest_and_gives_the_subset(tmp_path: Path, cue: str) -> None:
    pool = open_pool(write_pool(tmp_path, sources=3))
    domains = {"a": data("a", 60), "b": data("b", 120), "c": data("c", 180)}
    targets = [data("dark", 60), data("bright", 170, seed=5)]
    found = data_similarity(pool, domains, targets, cue)
    assert found.distances.shape == (3, 2)
    assert found.distances[0, 0] == pytest.approx(0.0, abs=1e-6)  # the very same pairs
    assert found.subset("dark", 2)[0] == "a"
    if cue == "rgb":
        assert found.subset("dark", 3) == ("a", "b", "c")
        assert found.subset("bright", 2) == ("c", "b")
    recipes = similarity_recipes(pool, [found], 2)
    assert list(recipes) == [f"{cue} to dark", f"{cue} to bright"]
    assert set(recipes[f"{cue} to dark"].sources) == set(found.subset("dark", 2))
    assert found.table().shape == (3, 2)


def test_warping_by_the_true_disparity_leaves_nothing() -> None:
    (sample, _) = (pair.load() for pair in data("x", 100).pairs)
    right = warping_residual(sample, np.full((32, 64), 3.0, np.float32)).reshape(32, 64, 4)
    assert right[:, 3:, :3].max() == 0.0
    np.testing.assert_allclose(right[..., 3], 300.0 / 64)
    wrong = warping_residual(sample, np.full((32, 64), 9.0, np.float32)).reshape(32, 64, 4)
    assert wrong[:, 9:, :3].mean() > 5.0
    assert np.isfinite(warping_residual(sample, np.full((32, 64), np.nan, np.float32))).all()


# Other tests of the same process register architectures of their own.
SHIPPED = [name for name in architectures() if architecture(name).build.__module__.startswith("sfkit.")]
# An adapter's network comes from a checkout or a package that the user has.
BUILT_IN = [name for name in SHIPPED if ".adapters." not in architecture(name).build.__module__]


def test_the_shipped_architectures_are_found() -> None:
    assert {"anynet", "nmrf-swint", "nmrf-res", "foundation-stereo"} <= set(BUILT_IN)


@pytest.mark.parametrize("name", BUILT_IN)
def test_every_architecture_has_a_backbone_to_listen_to(name: str) -> None:
    entry = architecture(name)
    options = entry.resolve({"vit_size": "vits"} if name == "foundation-stereo" else {})
    network = entry.build(**options)
    partition = BlockPartition.of(entry.blocks(options))
    modules = block_modules(network, partition, "backbone")
    keys = {key for key in network.state_dict() if partition.block_of(key) == 0}
    heard = {f"{module}.{key}" for module, found in modules.items() for key in found.state_dict()}
    assert heard <= keys
    assert len(heard) > 0.9 * len(keys)


class Two(nn.Module):
    """An encoder with a list inside, called once a view, and a head."""

    def __init__(self) -> None:
        super().__init__()
        self.encoder = nn.ModuleList([nn.Conv2d(3, 2, 1, bias=False), nn.Conv2d(2, 4, 1)])
        self.head = nn.Linear(4, 4)

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        views = []
        for view in (left, right):
            for layer in self.encoder:
                view = layer(view)
            views.append(view)
        return self.head((views[0] - views[1]).movedim(1, -1))


def test_hooks_find_a_blocks_modules_in_any_network_and_hear_every_call() -> None:
    network = Two()
    partition = BlockPartition.of({"backbone": ["encoder.*"], "head": ["head.*"], "bias": ["*.bias"]})
    modules = block_modules(network, partition, "backbone")
    assert list(modules) == ["encoder.0", "encoder.1"]  # the list itself has no forward pass
    left, right = torch.rand(2, 1, 3, 5, 7)
    with BlockOutputs(modules) as outputs, torch.inference_mode():
        network(left, right)
    mean, square = outputs.moments()
    assert mean.shape == square.shape == (6,)
    with torch.inference_mode():
        by_hand = torch.stack([network.encoder[0](v).mean(dim=(0, 2, 3)) for v in (left, right)]).mean(dim=0)
    np.testing.assert_allclose(mean[:2], by_hand.numpy(), rtol=1e-4, atol=1e-6)
    with torch.inference_mode():
        network(left, right)  # hooks are gone
    np.testing.assert_array_equal(outputs.moments()[0], mean)
    with pytest.raises(InputError, match="no module that lies in it as a whole"):
        block_modules(network, partition, "bias")
    with pytest.raises(InputError, match="'backbone'"):
        block_modules(network, partition, "backbon")
    with pytest.raises(InputError, match="found no output"):
        BlockOutputs(modules).moments()


@pytest.mark.parametrize("size", [(64, 96), (96, 64)])
def test_maps_with_channels_last_are_recognised_by_the_images_shape(size: tuple[int, int]) -> None:
    network = nn.Identity()
    maps = torch.rand(2, 3, size[0] // 4, size[1] // 4)
    found = []
    for shown in (maps, maps.movedim(1, -1)):
        with BlockOutputs({"all": network}, size=size) as outputs:
            network(shown)
        found.append(outputs.moments())
    np.testing.assert_allclose(found[0], found[1])
    np.testing.assert_allclose(found[0][0], maps.double().mean(dim=(0, 2, 3)).numpy())


def test_what_cannot_be_compared_is_refused(tmp_path: Path) -> None:
    pool = open_pool(write_pool(tmp_path, sources=2))
    with pytest.raises(InputError, match="cue 'RGB'"):
        data_similarity(pool, {"a": data("a", 9)}, [data("t", 9)], "RGB")
    with pytest.raises(InputError, match="found data of 0 sources"):
        data_similarity(pool, {}, [data("t", 9)], "rgb")
    found = data_similarity(pool, {"a": data("a", 9), "b": data("b", 99)}, [data("t", 9)], "rgb")
    with pytest.raises(InputError, match="found size 3, expected 1 to 2"):
        found.subset("t", 3)
    with pytest.raises(InputError, match="target"):
        found.subset("u", 1)
