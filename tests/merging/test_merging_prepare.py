"""Prepared pools: pools like any other, that never pass for the one they were made from."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file
from tiny import write_pairs, write_pool

from sfkit import Drop, Elect, EvaluationStore, Evaluator, FisherMean, Mean, Trim, prepare, prepared_for
from sfkit.checkpoints.checks import Kind
from sfkit.datasets import open_benchmark
from sfkit.errors import InputError
from sfkit.evaluation.engines.shared_pool import SharedPool
from sfkit.merging import BlockPartition, Pool, Recipe, open_pool
from sfkit.merging import prepare as prepare_module
from sfkit.merging.cache import VectorCache
from sfkit.merging.origin import read_origin, read_recipe
from sfkit.merging.prepare import measured
from sfkit.merging.saving import save_merged
from sfkit.merging.sparsity import Thresholds
from sfkit.search import RoutingSearch, RoutingSettings, SubsetSearch, SubsetSettings


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("prepared")


@pytest.fixture(scope="module")
def pool(folder: Path) -> Pool:
    return open_pool(write_pool(folder / "pool"))


@pytest.fixture(scope="module")
def evaluator(folder: Path, pool: Pool) -> Evaluator:
    pairs = open_benchmark("pairs", write_pairs(folder / "pairs"))
    return Evaluator(pool, pairs, store=EvaluationStore(":memory:"))


def weights(pool: Pool, name: str) -> torch.Tensor:
    """A source's task vector without running statistics."""
    parts = [s for s in pool.layout.segments if s.kind is Kind.WEIGHT]
    return torch.cat([pool.vectors[name][s.start : s.stop] for s in parts])


def test_prepared_sources_have_names_and_fingerprints_of_their_own(pool: Pool) -> None:
    trimmed = prepare(pool, Trim(0.2))
    assert trimmed.names == ("a/trim=0.2", "b/trim=0.2", "c/trim=0.2")
    assert not set(trimmed.identity.values()) & set(pool.identity.values())
    assert prepare(pool, Trim(0.2)).identity == trimmed.identity
    assert prepare(pool, Trim(0.3)).identity.keys() != trimmed.identity.keys()
    both = prepare(trimmed, Drop(0.5, seed=2))
    assert both.names[0] == "a/trim=0.2,drop=0.5#2"
    assert both.identity == prepare(pool, Trim(0.2), Drop(0.5, seed=2)).identity
    assert set(prepare(pool, Drop(0.5, seed=3)).names).isdisjoint(prepare(pool, Drop(0.5, seed=2)).names)


def test_a_fifth_of_the_entries_stays_by_magnitude(pool: Pool) -> None:
    full, left = weights(pool, "b"), weights(prepare(pool, Trim(0.2)), "b/trim=0.2")
    kept = left != 0
    assert int(kept.sum()) == int(0.2 * full.numel())
    assert torch.equal(left[kept], full[kept])
    assert float(full[kept].abs().min()) >= float(full[~kept].abs().max())


def test_idle_steps_give_the_pool_itself(pool: Pool) -> None:
    assert prepare(pool) is pool
    assert prepare(pool, Trim(1.0), Drop(0.0)) is pool


def test_dare_without_dropping_is_the_uniform_merge(pool: Pool) -> None:
    dare = prepare(pool, Drop(0.0), Mean("dare"))
    merged, uniform = dare.state_dict(dare.uniform()), pool.state_dict(pool.uniform())
    assert all(torch.allclose(merged[key], uniform[key], atol=1e-6) for key in uniform)


def test_the_order_of_sources_changes_no_bit(folder: Path, pool: Pool) -> None:
    text = (folder / "pool" / "pool.toml").read_text()
    head, *sources = text.split("[sources.")
    turned = folder / "pool" / "turned.toml"
    turned.write_text(head + "".join(f"[sources.{part.rstrip()}\n" for part in reversed(sources)))
    for steps in (
        (Trim(0.3), Elect()),
        (Drop(0.5), Mean()),
        (Elect(sources=("a", "c"), weights=(0.2, 0.7)),),
    ):
        one, other = prepare(pool, *steps), prepare(open_pool(turned), *steps)
        assert one.identity == other.identity
        assert torch.equal(*(p.vectors[p.names[0]] for p in (one, other)))


def test_variances_stay_positive_at_any_strength(pool: Pool) -> None:
    ties = prepare(pool, Trim(0.2), Elect())
    for strength in (0.3, 1.0, 2.5):
        state = ties.state_dict(Recipe.weighted({"ties": strength}, ties.blocks))
        assert all(bool((state[key] > 0).all()) for key in state if key.endswith("running_var"))
        assert all(bool(torch.isfinite(tensor).all()) for tensor in state.values())
    mean = pool.state_dict(pool.uniform())
    strong = ties.state_dict(Recipe.weighted({"ties": 2.5}, ties.blocks))
    assert all(torch.allclose(strong[k], mean[k], atol=1e-6) for k in mean if "running" in k)


def test_a_prepared_pool_never_takes_the_recipes_of_another(pool: Pool) -> None:
    trimmed = prepare(pool, Trim(0.2))
    with pytest.raises(InputError, match=r"source of pool 'tiny'.*'a/trim=0\.2'"):
        pool.merge_into(trimmed.uniform(), torch.empty(pool.layout.size))
    with pytest.raises(InputError, match="'a'"):
        trimmed.equal("a")
    with pytest.raises(InputError, match=r"trim \(density 0\.2, per vector\), .* through no such step"):
        pool.check_recipe(trimmed.signed(trimmed.uniform()))
    with pytest.raises(InputError, match="give the pool as it was read"):
        prepared_for(prepare(pool, Trim(0.5)), trimmed.signed(trimmed.uniform()))


STEPS = [
    (Trim(0.2),),
    (Trim(0.4, per="tensor"), Drop(0.5, seed=5, rescale="norm")),
    (Drop(0.7, seed=1), Elect("dare ties", zero="plus")),
    (Trim(0.3), Elect("t", ("c", "a"), weights=(0.25, 0.75), combine="sum")),
]


@pytest.mark.parametrize("steps", STEPS)
def test_a_merged_file_suffices_to_rebuild_the_network_bit_for_bit(
    folder: Path, pool: Pool, tmp_path: Path, steps: tuple[Trim | Drop | Elect, ...]
) -> None:
    prepared = prepare(pool, *steps)
    recipe = Recipe.weighted(dict.fromkeys(prepared.names, 0.4), pool.blocks, scale=1.1)
    path = save_merged(prepared, recipe, tmp_path / "merged.safetensors")
    read = read_recipe(path)
    assert read == prepared.signed(recipe)
    assert read.preparation == steps
    again = open_pool(folder / "pool" / "pool.toml")
    rebuilt = prepared_for(again, read).state_dict(read)
    assert all(torch.equal(rebuilt[key], tensor) for key, tensor in load_file(path).items())
    origin = read_origin(path)
    assert origin is not None
    assert origin.sources["a"]["fingerprint"] == pool.identity["a"], "it names the files it was made from"
    assert origin.licences["a"] == "licence of a"


def test_a_recipe_over_sources_its_steps_do_not_make_is_refused(pool: Pool, tmp_path: Path) -> None:
    recipe = replace(Recipe.weighted({"ties": 1.0}, pool.blocks), preparation=(Trim(0.5), Elect("other")))
    with pytest.raises(InputError, match="'ties', expected one of: other"):
        prepared_for(pool, recipe)
    with pytest.raises(InputError, match="'ties', expected one of: other"):
        save_merged(prepare(pool, Trim(0.5), Elect("other")), recipe, tmp_path / "merged.safetensors")


def test_a_reader_refuses_what_it_cannot_rebuild(pool: Pool) -> None:
    information = {name: torch.rand(pool.layout.size) for name in pool.names}
    step = FisherMean(measured(information), on="eth3d")
    fisher = prepare(pool, step, importances=information)
    recipe = fisher.signed(fisher.uniform())
    with pytest.raises(InputError, match=r"measured on images \(eth3d\), which a recipe does not hold"):
        prepared_for(pool, recipe)
    with pytest.raises(InputError, match="does not hold"):
        prepared_for(pool, recipe, importances={**information, "a": torch.rand(pool.layout.size)})
    assert prepared_for(pool, recipe, importances=information).identity == fisher.identity
    values = json.loads(recipe.to_json())
    values["preparation"][0]["step"] = "slerp"
    with pytest.raises(InputError, match="preparation step"):
        Recipe.from_dict(values)
    values["format"] = "sfkit-recipe/3"
    with pytest.raises(InputError, match="expected 'sfkit-recipe/1' or 'sfkit-recipe/2'"):
        Recipe.from_dict(values)


def test_names_that_do_not_fit_are_refused(pool: Pool) -> None:
    with pytest.raises(InputError, match="unknown source 'z' of pool 'tiny', expected: a, b, c"):
        prepare(pool, Elect(sources=("a", "z")))
    with pytest.raises(InputError, match="name one twice"):
        prepare(pool, Mean(sources=("a", "a")))
    with pytest.raises(InputError, match="the name 'b' is taken"):
        prepare(pool, Mean("b"))


def test_both_stages_run_over_trimmed_and_dropped_vectors(pool: Pool, evaluator: Evaluator) -> None:
    for step in (Trim(0.5), Drop(0.5, seed=1)):
        prepared = prepare(pool, step)
        scorer = evaluator.with_pool(prepared)
        which = SubsetSearch(
            prepared.names, prepared.blocks, scorer, SubsetSettings(population=3, generations=1)
        ).run()
        how = RoutingSearch(which.subset, prepared.blocks, scorer, RoutingSettings(evaluations=6)).run()
        assert how.score <= which.score
        keys = {evaluator.with_pool(pool)([pool.uniform()])[0].key, scorer([prepared.uniform()])[0].key}
        assert len(keys) == 2, "a prepared network has an evaluation of its own"


def test_the_base_is_one_evaluation_in_every_pool(pool: Pool, evaluator: Evaluator) -> None:
    one = evaluator([pool.base_recipe()])[0]
    other = evaluator.with_pool(prepare(pool, Trim(0.2)))([pool.base_recipe()])[0]
    assert (one.key, other.cached) == (other.key, True)


def test_a_parcel_carries_a_prepared_pool(pool: Pool) -> None:
    prepared = prepare(pool, Trim(0.2), Elect())
    opened = SharedPool.of(prepared).open()
    assert opened.identity == prepared.identity
    assert opened.preparation == prepared.preparation
    assert torch.equal(opened.vectors["ties"], prepared.vectors["ties"])


def test_thresholds_are_found_once_a_source_and_density(pool: Pool, monkeypatch: pytest.MonkeyPatch) -> None:
    known = Thresholds()
    prepare(pool, Trim(0.2), Elect(), thresholds=known)
    monkeypatch.setattr("sfkit.merging.sparsity.kth_magnitude", lambda *_: pytest.fail("asked again"))
    prepare(pool, Trim(0.2), Elect("sums", combine="sum"), thresholds=known)


def test_large_vectors_are_kept_in_the_cache(
    pool: Pool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    small = prepare(pool, Trim(0.2), Elect())
    monkeypatch.setattr(prepare_module, "MAPPED_ABOVE", 0)
    cache = VectorCache(tmp_path)
    large = prepare(pool, Trim(0.2), Elect(), cache=cache)
    assert torch.equal(large.vectors["ties"], small.vectors["ties"])
    assert [entry.source for entry in cache.entries()] == ["ties"]
    monkeypatch.setattr(prepare_module, "fuse", lambda *_, **__: pytest.fail("computed again"))
    again = prepare(pool, Trim(0.2), Elect(), cache=cache)
    assert torch.equal(again.vectors["ties"], small.vectors["ties"])


def test_another_partition_keeps_what_was_done_to_the_vectors(tmp_path: Path) -> None:
    trimmed = prepare(open_pool(write_pool(tmp_path)), Trim(0.5))
    parted = trimmed.with_blocks(BlockPartition.of({"all": ["*"]}))
    assert parted.preparation == trimmed.preparation
    assert parted.origins == trimmed.origins
    merged, expected = (pool.state_dict(pool.uniform()) for pool in (parted, trimmed))
    assert all(torch.equal(merged[key], tensor) for key, tensor in expected.items())
