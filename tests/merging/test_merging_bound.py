"""A file is what it says: recipes are bound to what they were merged from, names to one network each."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
import torch
from flat_world import benchmark, flat_pool, flat_spec

import sfkit
from sfkit.checkpoints.checks import check_values
from sfkit.checkpoints.spec import Member
from sfkit.errors import InputError, SfkitWarning
from sfkit.merging.origin import read_origin, read_recipe
from sfkit.search.plan import SearchPlan

LEVELS = {"low": 4.0, "high": 12.0}


def exchanged(folder: Path) -> sfkit.Pool:
    """The pool with its two sources' files exchanged in its description."""
    spec = flat_spec(folder, LEVELS)
    low, high = spec.sources
    return sfkit.open_pool(
        replace(spec, sources=(replace(low, path=high.path), replace(high, path=low.path)))
    )


def test_exchanged_sources_are_not_merged_in_each_others_place(tmp_path: Path) -> None:
    """Measured before: 8.78 became 7.90 without a word."""
    pool = flat_pool(tmp_path / "pool", LEVELS)
    recipe = sfkit.Recipe.weighted({"low": 0.25, "high": 0.75}, pool.blocks)
    read = read_recipe(sfkit.save_merged(pool, recipe, tmp_path / "m.safetensors"))
    assert read == recipe
    assert float(pool.merge(read).network.level) == 10.0  # type: ignore[arg-type]
    other = exchanged(tmp_path / "pool")
    message = r"merged from another 'low' than that of pool 'flat' .*here 'high' is, were names exchanged"
    for use in (other.merge, other.canonical, sfkit.Evaluator(other, benchmark()).describe):
        with pytest.raises(InputError, match=message):
            use(read)  # type: ignore[operator]
    assert float(other.merge(replace(read, merged_from=None)).network.level) == 6.0  # type: ignore[arg-type]


def test_a_recipe_s_json_knows_its_networks_as_the_merged_file_does(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path / "pool", LEVELS)
    recipe = sfkit.Recipe.weighted({"low": 0.25, "high": 0.75}, pool.blocks)
    (tmp_path / "r.json").write_text(pool.bound(recipe).to_json())
    read = read_recipe(tmp_path / "r.json")
    assert read.merged_from == {"base": pool.base.fingerprint, **pool.identity}
    assert (read, read.as_dict()) == (recipe, recipe.as_dict())
    with pytest.raises(InputError, match="'none'"):
        pool.bound(sfkit.Recipe.weighted({"low": 0.5, "none": 0.5}, pool.blocks))
    other = exchanged(tmp_path / "pool")
    with pytest.raises(InputError, match=r"another 'low' .*; to merge .* take networks out of its JSON"):
        other.merge(read)
    (tmp_path / "r.json").write_text(recipe.to_json())
    assert float(other.merge(read_recipe(tmp_path / "r.json")).network.level) == 6.0  # type: ignore[arg-type]


def test_a_search_does_not_start_from_a_recipe_of_other_networks(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path / "pool", LEVELS)
    start = pool.bound(sfkit.Recipe.weighted({"low": 0.25, "high": 0.75}, pool.blocks))
    plan = SearchPlan(subset=("low", "high"), start=start)
    plan.check(pool)
    with pytest.raises(InputError, match="were names exchanged"):
        plan.check(exchanged(tmp_path / "pool"))


def test_only_networks_with_a_weight_are_bound(tmp_path: Path) -> None:
    """A pool in which a source that does not matter was trained anew goes on with the recipe."""
    pool = flat_pool(tmp_path / "pool", LEVELS)
    alone = pool.bound(sfkit.Recipe.weighted({"low": 1.0, "high": 0.0}, pool.blocks))
    other = flat_pool(tmp_path / "other", {"low": 4.0, "high": 13.0})
    assert float(other.merge(alone).network.level) == 4.0  # type: ignore[arg-type]


def test_what_a_prepared_source_was_made_of_is_bound(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path / "pool", LEVELS)
    made = sfkit.prepare(pool, sfkit.Elect())
    recipe = made.bound(sfkit.Recipe.weighted({made.names[0]: 1.0}, made.blocks))
    assert set(recipe.merged_from or {}) == {"base", "low", "high"}
    with pytest.raises(InputError, match="merged from another"):
        sfkit.prepared_for(flat_pool(tmp_path / "other", {"low": 4.0, "high": 13.0}), recipe)


def test_another_base_is_told_too(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path / "pool", LEVELS)
    read = read_recipe(sfkit.save_merged(pool, pool.uniform(), tmp_path / "m.safetensors"))
    other = sfkit.open_pool(flat_spec(tmp_path / "other", LEVELS, base=6.0))
    with pytest.raises(InputError, match="merged from another 'base'"):
        other.check_recipe(read)


def torch_pool(folder: Path) -> sfkit.Pool:
    spec = flat_spec(folder, LEVELS)
    torch.save({"level": torch.tensor([5.0]), "offset": torch.zeros(1)}, folder / "base.pth")
    return sfkit.open_pool(replace(spec, base=Member("base", folder / "base.pth")))


def test_a_recipe_beside_belongs_to_its_weights(tmp_path: Path) -> None:
    pool = torch_pool(tmp_path / "pool")
    written = sfkit.save_merged(pool, pool.uniform(), tmp_path / "m.pth", form="original")
    origin = read_origin(written)
    assert origin is not None
    assert origin.recipe == pool.uniform()
    torch.save({"level": torch.tensor([7.0]), "offset": torch.zeros(1)}, written)
    with pytest.warns(
        SfkitWarning, match=r"m\.pth\.recipe\.json: belongs to other weights than those of m\.pth"
    ):
        assert read_origin(written) is None


def test_a_recipe_beside_from_before_it_named_its_weights_is_read(tmp_path: Path) -> None:
    pool = torch_pool(tmp_path / "pool")
    written = sfkit.save_merged(pool, pool.uniform(), tmp_path / "m.pth", form="original")
    sidecar = tmp_path / "m.pth.recipe.json"
    held = json.loads(sidecar.read_text())
    del held["sfkit.weights"]
    sidecar.write_text(json.dumps(held))
    assert read_recipe(written) == pool.uniform()


def test_a_users_file_of_that_name_stays(tmp_path: Path) -> None:
    pool = torch_pool(tmp_path / "pool")
    (tmp_path / "m.pth.recipe.json").write_text("mine")
    for overwrite in (False, True):
        with pytest.raises(
            InputError, match=r"m\.pth\.recipe\.json: exists and would hold the recipe of m\.pth"
        ):
            sfkit.save_merged(pool, pool.uniform(), tmp_path / "m.pth", form="original", overwrite=overwrite)
    assert (tmp_path / "m.pth.recipe.json").read_text() == "mine"
    assert not (tmp_path / "m.pth").exists()


@pytest.mark.parametrize("name", ["base", "uniform", "low+high"])
def test_names_that_tables_give_other_networks_are_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(InputError, match=rf"source name '{name.replace('+', '.')}', expected another"):
        flat_spec(tmp_path, {name: 4.0})


def test_two_benchmarks_of_one_name(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path / "pool", LEVELS)
    two = [benchmark("pairs"), benchmark("pairs", truths=(4.0,))]
    with pytest.raises(InputError, match="found 'pairs' under protocol 'all-valid' twice"):
        sfkit.score_recipes(pool, {"uniform": pool.uniform()}, two)
    scores = [sfkit.score_recipes(pool, {"uniform": pool.uniform()}, [one]) for one in two]
    with pytest.raises(InputError, match="found 'pairs' under protocol 'all-valid' twice"):
        sfkit.pivot(pd.concat(scores, ignore_index=True))


KINDS: dict[str, tuple[Callable[[], torch.Tensor], str]] = {
    "complex": (lambda: torch.zeros(1, dtype=torch.complex64), "of complex64"),
    "whole numbers": (lambda: torch.zeros(1, dtype=torch.int8), "of int8"),
    "truth": (lambda: torch.zeros(1, dtype=torch.bool), "of bool"),
    "float8": (lambda: torch.zeros(1, dtype=torch.float8_e4m3fn), "of float8_e4m3fn"),
    "sparse": (lambda: torch.zeros(1).to_sparse(), "a sparse tensor"),
    "meta": (lambda: torch.zeros(1, device="meta"), "without values"),
    "quantised": (lambda: torch.quantize_per_tensor(torch.zeros(1), 0.1, 0, torch.qint8), "quantised"),
}


@pytest.mark.filterwarnings("ignore::UserWarning")  # torch calls quantised tensors deprecated
@pytest.mark.parametrize("kind", KINDS)
def test_tensors_that_are_no_plain_numbers_are_refused_by_key(tmp_path: Path, kind: str) -> None:
    make, words = KINDS[kind]
    spec = flat_spec(tmp_path, {"low": 4.0})
    torch.save({"level": make(), "offset": torch.zeros(1)}, tmp_path / "low.pth")
    with pytest.raises(InputError, match=rf"low\.pth: 'level' is {words}.*, expected float16"):
        sfkit.open_pool(replace(spec, sources=(Member("low", tmp_path / "low.pth"),)))


def test_parameters_are_meant_as_values(tmp_path: Path) -> None:
    spec = flat_spec(tmp_path / "pool", {"low": 4.0})
    state = {"level": torch.nn.Parameter(torch.tensor([4.0])), "offset": torch.nn.Parameter(torch.zeros(1))}
    torch.save(state, tmp_path / "low.pth")
    torch.save(state, tmp_path / "base.pth")
    base, low = Member("base", tmp_path / "base.pth"), replace(spec.sources[0], path=tmp_path / "low.pth")
    pool = sfkit.open_pool(replace(spec, base=spec.base, sources=(low,)))
    written = sfkit.save_merged(pool, pool.uniform(), tmp_path / "m.safetensors")
    with pytest.warns(SfkitWarning, match="is the base itself"):
        twin = sfkit.open_pool(replace(spec, base=base, sources=(low,)))
    sfkit.save_merged(twin, twin.base_recipe(), tmp_path / "b.safetensors")
    assert float(sfkit.load(written).loaded.network.level) == 4.0  # type: ignore[arg-type]


def test_variances_below_zero_are_refused(tmp_path: Path) -> None:
    check_values(tmp_path / "x.pth", "bn.running_var", torch.zeros(2))
    with pytest.raises(InputError, match=r"x\.pth: 'bn\.running_var' holds 1 variances below 0"):
        check_values(tmp_path / "x.pth", "bn.running_var", torch.tensor([1.0, -0.5]))
