"""Keys of evaluations: new with everything that may change a score, and with nothing else."""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import replace
from itertools import combinations
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from flat_world import LEVELS, SIZE, Flat, benchmark, calls, flat_pool, flat_spec, sample

from sfkit.architectures import register_architecture
from sfkit.checkpoints.spec import Member, PoolSpec
from sfkit.datasets.benchmark import Benchmark, memory_benchmark
from sfkit.datasets.pairs import MemoryPair, Sample
from sfkit.evaluation import EvaluationStore, Evaluator
from sfkit.evaluation.store import evaluation_key
from sfkit.merging import BlockPartition, Pool, Recipe, open_pool


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("flat")


@pytest.fixture(scope="module")
def pool(folder: Path) -> Pool:
    return flat_pool(folder)


def key(pool: Pool, recipe: Recipe, measured: Benchmark | None = None, **options: Any) -> str:
    evaluator = Evaluator(pool, measured or eth3d(), **options)
    return evaluation_key(evaluator.describe(recipe))


def eth3d(edit: Callable[[Sample], Sample] = lambda s: s, **options: Any) -> Benchmark:
    """Two pairs under a protocol of ETH3D, each passed through ``edit``."""
    pairs = [edit(sample(f"pair{n}", 5.0 + n, n)) for n in range(2)]
    return memory_benchmark("noise", pairs, **{"family": "eth3d", "protocol": "raft", **options})


def poked(what: str) -> Callable[[Sample], Sample]:
    """Changes one value of one array by the least there is."""

    def edit(one: Sample) -> Sample:
        array = np.copy(getattr(one, what))
        array[0, 0] += 1
        return replace(one, **{what: array})

    return edit


def other_base(folder: Path) -> Pool:
    return open_pool(flat_spec(folder / "base", base=5.5))


def other_source(folder: Path) -> Pool:
    return flat_pool(folder / "source", {**LEVELS, "low": 4.5})


def other_version(folder: Path) -> Pool:
    register_architecture("flat-2", blocks={"level": ["level"], "offset": ["offset"]}, version="2")(Flat)
    pool = open_pool(replace(flat_spec(folder / "version"), architecture="flat-2"))
    return replace(pool, architecture=replace(pool.architecture, name="flat"))


def other_option(folder: Path) -> Pool:
    return open_pool(replace(flat_spec(folder / "option"), options={"factor": 2.0}))


@pytest.mark.parametrize("change", [other_base, other_source, other_version, other_option])
def test_another_network_has_another_key(change: Callable[[Path], Pool], pool: Pool, tmp_path: Path) -> None:
    assert key(change(tmp_path), pool.equal("low", "high")) != key(pool, pool.equal("low", "high"))


def test_every_recipe_has_its_own_key(pool: Pool) -> None:
    subsets = [pool.equal(*names) for size in range(5) for names in combinations(pool.names, size)]
    weighted = [Recipe.weighted({"low": w, "high": 1 - w}, pool.blocks) for w in (0.3, 0.3 + 1e-15, 0.7)]
    scaled = [Recipe.weighted({"low": 0.5, "high": 0.5}, pool.blocks, scale=s) for s in (0.9, 1.1)]
    row, turned = (0.2, 0.8), (0.8, 0.2)
    routed = [
        Recipe(("low", "high"), pool.blocks, rows, (1.0, 1.0)) for rows in ((row, turned), (turned, row))
    ]
    recipes = [*subsets, *weighted, *scaled, *routed]
    assert len({key(pool, recipe) for recipe in recipes}) == len(recipes)


@pytest.mark.parametrize(
    "measured",
    [
        eth3d(poked("left")),
        eth3d(poked("right")),
        eth3d(poked("disparity")),
        eth3d(lambda s: replace(s, nonoccluded=np.ones(SIZE, np.bool_))),
        eth3d(protocol="nmrf"),
        eth3d(protocol="all-valid"),
        replace(eth3d(), pairs=eth3d().pairs[::-1]),
        eth3d().first(1),
        memory_benchmark("noise", eth3d().samples(), family="pairs"),
        eth3d(family="middlebury", protocol="all-valid"),
        replace(eth3d(family="middlebury", protocol="all-valid"), resolution="H"),
        replace(eth3d(family="middlebury", protocol="all-valid"), resolution="Q"),
    ],
    ids=lambda measured: None,
)
def test_other_pairs_or_rules_have_another_key(measured: Benchmark, pool: Pool) -> None:
    assert key(pool, pool.uniform(), measured) != key(pool, pool.uniform())


def test_all_rules_differ_from_each_other(pool: Pool) -> None:
    middlebury = eth3d(family="middlebury", protocol="all-valid")
    measured = [middlebury, *(replace(middlebury, resolution=r) for r in "FHQ")]
    measured += [eth3d(protocol=p) for p in ("raft", "nmrf", "all-valid")]
    assert len({key(pool, pool.uniform(), m) for m in measured}) == len(measured)


def test_devices_differ_by_type_alone(pool: Pool) -> None:
    cpu, first, second = (key(pool, pool.uniform(), device=d) for d in ("cpu", "cuda:0", "cuda:1"))
    assert cpu != first
    assert first == second


def test_thresholds_beyond_the_usual_ones_are_part_of_the_key(pool: Pool) -> None:
    usual = [key(pool, pool.uniform(), metric=m) for m in ("bad-1.0", "bad-3.0", "epe", "d1")]
    assert len(set(usual)) == 1, "every usual metric comes from the same sums and counts"
    assert key(pool, pool.uniform(), metric="bad-2.5") not in usual
    assert key(pool, pool.uniform(), metric="bad-2.5") == key(
        pool, pool.uniform(), metric="epe", also=("bad-2.5",)
    )


def test_blocks_matter_where_they_are_treated_differently(pool: Pool, folder: Path) -> None:
    spec = replace(flat_spec(folder), blocks={"all": ("*",)})
    whole = open_pool(spec)
    assert key(whole, whole.equal("low", "high")) == key(pool, pool.equal("low", "high")), (
        "Stage 1 has one key"
    )
    assert key(whole, Recipe.weighted({"low": 1.0}, whole.blocks, scale=1.2)) != key(
        pool, Recipe.weighted({"low": 1.0}, pool.blocks, scale=1.2)
    )
    swapped = replace(pool.partition, patterns=pool.partition.patterns[::-1])
    assert isinstance(swapped, BlockPartition)
    assert swapped.fingerprint() != pool.partition.fingerprint()


def moved(folder: Path) -> tuple[Pool, Recipe]:
    """Other folder, other file names and kinds, other names of pool and sources, another order of all."""
    spec = flat_spec(folder)
    for member in (spec.base, *spec.sources):
        state = {"module.level": torch.tensor([{"base": 5.0, **LEVELS}[member.name]])}
        state["module.offset"] = torch.zeros(1)
        torch.save({"state_dict": state, "epoch": 7}, folder / f"run-{member.name}.tar")
    sources = tuple(Member(f"my-{n}", folder / f"run-{n}.tar", note="x") for n in reversed(LEVELS))
    other = open_pool(
        PoolSpec("other", "flat", Member("base", folder / "run-base.tar", licence="x"), sources)
    )
    return other, Recipe.weighted({"my-high": 0.75, "my-wild": 0.0, "my-low": 0.25}, other.blocks)


def test_names_places_wrappings_and_orders_change_no_key(pool: Pool, tmp_path: Path) -> None:
    recipe = Recipe.weighted({"low": 0.25, "high": 0.75}, pool.blocks)
    other, same = moved(tmp_path)
    renamed = replace(eth3d(), name="other name", citation="x", licence="y", notes=("z",), expected=27)
    assert key(other, same, renamed) == key(pool, recipe)
    scaled = Recipe(("high", "low"), pool.blocks, ((0.75, 0.25), (0.5, 0.5)), (1.25, 1.0))
    turned = Recipe(("low", "high"), pool.blocks, ((0.25, 0.75), (0.5, 0.5)), (1.25, 1.0))
    assert key(pool, scaled) == key(pool, turned)


def test_a_digest_may_stand_for_the_pixels(pool: Pool) -> None:
    """Rendered pairs are named by their seed, so that nothing is hashed."""
    pairs = [MemoryPair(s.id, s, digest=f"seed {s.id}") for s in eth3d().samples()]
    first = memory_benchmark("noise", pairs, family="eth3d", protocol="raft")
    pairs[1] = replace(pairs[1], digest="seed 7")
    second = memory_benchmark("noise", pairs, family="eth3d", protocol="raft")
    assert key(pool, pool.uniform(), first) != key(pool, pool.uniform(), second)


def test_a_pool_that_gains_a_source_scores_no_subset_again(tmp_path: Path) -> None:
    levels = dict(list(LEVELS.items())[:3])
    calls.clear()
    with EvaluationStore(tmp_path / "s.sqlite") as store:
        small = flat_pool(tmp_path / "pool", levels)
        subsets = [names for size in (1, 2, 3) for names in combinations(levels, size)]
        before = Evaluator(small, benchmark(), store=store)([small.equal(*names) for names in subsets])
        passes = len(calls)
        shutil.move(tmp_path / "pool", tmp_path / "moved")
        grown = flat_pool(tmp_path / "moved", {"new": 6.0, **levels})
        evaluator = Evaluator(grown, benchmark(), store=store)
        after = evaluator([grown.equal(*names) for names in subsets])
        assert [o.score for o in after] == [o.score for o in before]
        assert evaluator.counts.computed == 0
        assert len(calls) == passes
        evaluator([grown.equal("new", *names) for names in subsets])
        assert evaluator.counts.computed == len(subsets)
