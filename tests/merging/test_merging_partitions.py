"""Partitions made from the network itself: every parameter once, balance, and clusters by hand."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest
import torch
from flat_world import flat_pool
from hypothesis import given
from hypothesis import strategies as st
from safetensors.torch import save_file
from torch import nn

from sfkit.architectures import register_architecture
from sfkit.bank import pool_path
from sfkit.checkpoints.checks import Kind
from sfkit.checkpoints.spec import Member, PoolSpec, read_pool_spec
from sfkit.errors import InputError
from sfkit.merging import BlockPartition, Pool, open_pool
from sfkit.merging.blocks import WAYS, parse_partition
from sfkit.merging.partitions import _clusters, _cuts, auto_partition, disagreements


@register_architecture("tower", blocks={"all": ["*"]}, version="1")
class Tower(nn.Module):
    """Four layers of 2, 4, 6 and 8 weights, and one number at the top level."""

    def __init__(self) -> None:
        super().__init__()
        self.body = nn.ModuleDict(
            {name: nn.Linear(size, 1, bias=False) for name, size in (("a", 2), ("b", 4))}
        )
        self.head = nn.ModuleDict(
            {name: nn.Linear(size, 1, bias=False) for name, size in (("c", 6), ("d", 8))}
        )
        self.bare = nn.Parameter(torch.zeros(1))

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        raise RuntimeError("never run")


LAYERS = {"body.a.weight": 2, "body.b.weight": 4, "head.c.weight": 6, "head.d.weight": 8}


def tower(folder: Path, moves: dict[str, dict[str, float]]) -> Pool:
    """A base of ones and a source each: how far it moves every weight of a layer."""
    base = {**{key: torch.ones(1, size) for key, size in LAYERS.items()}, "bare": torch.ones(1)}
    members = {"base": base}
    for name, layers in moves.items():
        members[name] = {key: tensor + layers.get(key, 0.0) for key, tensor in base.items()}
    for name, state in members.items():
        save_file(state, folder / f"{name}.safetensors")
    files = [Member(name, folder / f"{name}.safetensors") for name in members]
    return open_pool(PoolSpec("tower", "tower", files[0], tuple(files[1:])))


@pytest.fixture(scope="module")
def bank() -> Pool:
    return open_pool(pool_path())


@pytest.mark.parametrize("by", WAYS)
@pytest.mark.parametrize("blocks", [1, 2, 4, 7])
def test_every_parameter_lies_in_exactly_one_block(bank: Pool, by: str, blocks: int) -> None:
    partition = auto_partition(bank, blocks, by)
    assert partition.names == tuple(f"part{n}" for n in range(1, blocks + 1))
    partition.check(spec.key for spec in bank.specs)
    parts = [BlockPartition(("one",), (patterns,)) for patterns in partition.patterns]
    for spec in bank.specs:
        if spec.kind is not Kind.CONSTANT:
            assert [part.block_of(spec.key) for part in parts].count(0) == 1, spec.key
    assert auto_partition(bank, blocks, by) == partition, "the same every time"


@pytest.mark.parametrize("by", WAYS)
def test_a_pool_under_another_partition_merges_the_same_networks(bank: Pool, by: str) -> None:
    parted = bank.with_blocks(auto_partition(bank, by=by))
    assert parted.layout.size == bank.layout.size
    ours, theirs = (pool.state_dict(pool.equal(*bank.names[:3])) for pool in (parted, bank))
    assert all(torch.equal(ours[key], theirs[key]) for key in theirs)
    assert parted.canonical(parted.uniform()) == bank.canonical(bank.uniform()), "one evaluation for both"
    back = parted.with_blocks(bank.partition)
    assert all(torch.equal(back.vectors[name], bank.vectors[name]) for name in bank.names)


def test_a_scale_acts_on_its_own_block_alone(bank: Pool) -> None:
    parted = bank.with_blocks(auto_partition(bank, by="modules"))
    whole = parted.equal(*bank.names[:2])
    scaled = type(whole)(whole.sources, whole.blocks, whole.weights, (1.5, 1.0, 1.0, 1.0))
    before, after = parted.state_dict(whole), parted.state_dict(scaled)
    moved = {key for key in before if not torch.equal(before[key], after[key])}
    inside = {s.key for s in parted.specs if s.kind is Kind.WEIGHT and parted.partition.block_of(s.key) == 0}
    assert moved == inside


@given(st.lists(st.integers(0, 20), min_size=1, max_size=8), st.data())
def test_runs_are_as_light_as_exhaustive_search_finds(weights: list[int], data: st.DataObject) -> None:
    runs = data.draw(st.integers(1, len(weights)))

    def heaviest(cuts: tuple[int, ...]) -> int:
        edges = [0, *cuts, len(weights)]
        return max(sum(weights[a:b]) for a, b in itertools.pairwise(edges))

    found = tuple(_cuts(weights, runs))
    assert len(found) == runs - 1
    assert list(found) == sorted(set(found))
    assert all(0 < cut < len(weights) for cut in found)
    assert heaviest(found) == min(map(heaviest, itertools.combinations(range(1, len(weights)), runs - 1)))


def test_modules_by_hand(tmp_path: Path) -> None:
    everything = dict.fromkeys(LAYERS, 0.01)
    pool = tower(tmp_path, {"one": everything, "two": dict.fromkeys(LAYERS, 0.02)})
    assert auto_partition(pool, 2).patterns == (("bare", "body.*", "head.c.*"), ("head.d.*",))
    assert auto_partition(pool, 3).patterns == (("bare", "body.*"), ("head.c.*",), ("head.d.*",))
    with pytest.raises(InputError, match="blocks: found 6, expected at most 5"):
        auto_partition(pool, 6)


def test_disagreement_by_hand(tmp_path: Path) -> None:
    """The sources agree in a and d, oppose each other in b, and only one moves in c."""
    pool = tower(
        tmp_path,
        {
            "one": {"body.a.weight": 0.1, "body.b.weight": 0.1, "head.c.weight": 0.1, "head.d.weight": 0.1},
            "two": {"body.a.weight": 0.2, "body.b.weight": -0.1, "head.d.weight": 0.3},
        },
    )
    found = {layer.layer: layer for layer in disagreements(pool)}
    assert [(name, layer.size) for name, layer in found.items()] == [
        ("body.a", 2),
        ("body.b", 4),
        ("head.c", 6),
        ("head.d", 8),
    ]
    cosines = [layer.cosines[0, 1] for layer in found.values()]
    assert cosines == pytest.approx([1.0, -1.0, 0.0, 1.0], abs=1e-5)
    assert [layer.conflict for layer in found.values()] == [0.0, 0.5, 0.0, 0.0]
    partition = auto_partition(pool, 3, by="disagreement")
    groups = {frozenset(patterns) for patterns in partition.patterns}
    assert frozenset({"bare", "body.a.weight", "head.d.weight"}) in groups, "unchanged: as the one before"
    assert frozenset({"body.b.weight"}) in groups
    assert frozenset({"head.c.weight"}) in groups
    with pytest.raises(InputError, match="blocks: found 5, expected at most 4, as many as there are changed"):
        auto_partition(pool, 5, by="disagreement")


@given(st.integers(1, 4), st.integers(0, 99))
def test_clusters_that_lie_apart_are_found(count: int, seed: int) -> None:
    rng = np.random.default_rng(seed)
    truth = np.concatenate([np.arange(count), rng.integers(0, count, 12)])
    points = 10.0 * np.eye(count)[truth] + rng.uniform(-0.5, 0.5, (len(truth), count))
    labels = _clusters(points, [int(w) for w in rng.integers(1, 4, len(truth))], count)
    pairs = {(int(a), b) for a, b in zip(truth, labels, strict=True)}
    assert len(pairs) == count, "one label a group, one group a label"


def test_points_that_coincide_still_fill_every_cluster() -> None:
    assert set(_clusters(np.zeros((5, 2)), [1] * 5, 3)) == {0, 1, 2}


def test_a_pool_is_opened_under_a_partition_of_ones_own(tmp_path: Path) -> None:
    spec = read_pool_spec(pool_path())
    ours = open_pool(spec, blocks={"front": ["feature_extraction.*"], "back": ["volume_postprocess.*"]})
    assert ours.blocks == ("front", "back")
    assert open_pool(spec, blocks="modules:3").blocks == ("part1", "part2", "part3")
    text = pool_path().read_text(encoding="utf-8")
    written = tmp_path / "pool.toml"
    root = pool_path().parent.as_posix()
    written.write_text(f'blocks = "modules"\nroot = "{root}"\n{text}', encoding="utf-8")
    again = open_pool(written)
    assert again.partition == auto_partition(ours, 4, "modules")
    assert again.spec.partition is None, "a worker opens the very partition, and does not look for one"
    assert open_pool(again.spec).partition == again.partition


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("module", "unknown way to partition 'module'.*did you mean 'modules'"),
        ("modules:0", "blocks: found 'modules:0', expected a number of blocks after the colon"),
        ("modules:many", "expected a number of blocks after the colon, as modules:4"),
    ],
)
def test_a_partition_that_is_none_is_refused(text: str, expected: str) -> None:
    with pytest.raises(InputError, match=expected):
        parse_partition(text)


def test_wrong_arguments_are_refused(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path)
    with pytest.raises(InputError, match="unknown way to partition 'depth'"):
        auto_partition(pool, by="depth")
    with pytest.raises(InputError, match="blocks: found 0, expected a whole number of at least 1"):
        auto_partition(pool, 0)
    with pytest.raises(InputError, match="block 'x': the pattern 'nothing' matches no parameter"):
        pool.with_blocks(BlockPartition.of({"x": ["nothing"]}))
