"""``--dtype``: a network is rounded before it is scored, so that what was scored is what is written."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from flat_world import benchmark, flat_pool
from safetensors.torch import load_file

import sfkit
from sfkit.errors import InputError
from sfkit.evaluation.engines.plan import WorkerPlan
from sfkit.evaluation.engines.shared_pool import SharedPool
from sfkit.evaluation.metrics import Quantities
from sfkit.merging import BlockPartition
from sfkit.merging.device_merging import DeviceMerger
from sfkit.merging.dtypes import written_as
from sfkit.search import SubsetSettings
from sfkit.search.pipeline import search_pool
from sfkit.search.plan import SearchPlan

PLAN = SearchPlan(stage1=SubsetSettings(population=4, generations=2), stage2=None)
THIRD = 20 / 3  # the mean of all three levels
HELD = {"float32": float(np.float32(THIRD)), "float16": 6.66796875, "bfloat16": 6.65625}
"""The nearest number to 20 / 3 that each type holds: of 11 and of 8 binary digits."""


def pool(folder: Path) -> sfkit.Pool:
    return flat_pool(folder, {"a": 4.0, "b": 9.0, "c": 7.0})


@pytest.mark.parametrize("dtype", HELD)
def test_what_is_scored_is_what_is_written(tmp_path: Path, dtype: str) -> None:
    rounded = written_as(pool(tmp_path / "pool"), dtype)
    evaluator = sfkit.Evaluator(rounded, benchmark(truths=(THIRD,), metric="epe"))
    found = search_pool(rounded, evaluator, PLAN, tmp_path / "out")
    written = load_file(found.merged)
    assert {str(tensor.dtype) for tensor in written.values()} == {f"torch.{dtype}"}
    assert float(written["level"]) == HELD[dtype]
    assert evaluator([rounded.uniform()])[0].score == pytest.approx(abs(HELD[dtype] - THIRD), abs=1e-6)


def test_tensors_that_no_source_changed_are_rounded_for_the_score_too(tmp_path: Path) -> None:
    opened = pool(tmp_path)
    base = {**opened.base_tensors, "offset": torch.tensor([0.3])}
    rounded = written_as(replace(opened, base_tensors=base), "bfloat16")
    assert float(rounded.merge(rounded.base_recipe()).network.offset) == 0.30078125  # type: ignore[arg-type]


def test_scores_of_other_types_are_kept_apart_and_those_of_float32_are_not(tmp_path: Path) -> None:
    opened = pool(tmp_path)
    one = benchmark()
    key = {
        name: sfkit.Evaluator(written_as(opened, name), one).describe(opened.uniform())
        for name in (None, *HELD)
    }
    assert key[None] == key["float32"]
    assert len({str(value) for value in key.values()}) == 3


def test_workers_and_devices_round_alike(tmp_path: Path) -> None:
    rounded = written_as(pool(tmp_path), "bfloat16")
    shared = SharedPool.of(rounded).open()
    one = benchmark()
    plan = WorkerPlan.of(rounded, one, Quantities.of(one.metric), mode=sfkit.Compute().mode, threads=1)
    elsewhere = plan.open("cpu").model
    elsewhere.apply(rounded.uniform())
    resident, passing = (
        DeviceMerger(rounded.task_vectors, torch.device("cpu"), budget=budget) for budget in (None, 0)
    )
    merged = [
        shared.merge_into(rounded.uniform(), torch.empty(rounded.layout.size)),
        elsewhere.flat,
        resident.merge_into(rounded.ordered(rounded.uniform()), torch.empty(rounded.layout.size)),
        passing.merge_into(rounded.ordered(rounded.uniform()), torch.empty(rounded.layout.size)),
    ]
    assert [float(rounded.layout.views(flat)["level"]) for flat in merged] == [HELD["bfloat16"]] * 4
    parted = rounded.with_blocks(BlockPartition.of({"all": ["*"]}))
    assert float(parted.merge(parted.uniform()).network.level) == HELD["bfloat16"]  # type: ignore[arg-type]


def test_values_beyond_a_type_are_refused_by_key(tmp_path: Path) -> None:
    rounded = written_as(pool(tmp_path), "float16")
    strong = sfkit.Recipe.weighted({"b": 1.0}, rounded.blocks, scale=30000.0)
    with pytest.raises(InputError, match="'level' has merged values beyond what float16 holds"):
        sfkit.save_merged(rounded, strong, tmp_path / "m.safetensors")
    assert not (tmp_path / "m.safetensors").exists()
    large = flat_pool(tmp_path / "large", {"a": 70001.0})
    large.base_tensors["level"].fill_(70000.0)
    with pytest.raises(InputError, match=r"'level' has values up to 7e\+04, beyond what float16 holds"):
        written_as(large, "float16")
    with pytest.raises(InputError, match="unknown dtype 'float8'"):
        written_as(large, "float8")
