"""Our merges and mergekit's of the same random networks, where both conventions can be made to agree."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path

import pytest
import torch
from mergekit.merge_methods.api import merge_state_dicts
from safetensors.torch import load_file, save_file
from tiny import write_pool

from sfkit import Drop, Elect, Mean, Trim, prepare
from sfkit.checkpoints.checks import Kind
from sfkit.merging import Pool, Recipe, open_pool

State = dict[str, torch.Tensor]

EQUAL = {"a": 1.0, "b": 1.0, "c": 1.0}
UNEQUAL = {"a": 0.2, "b": 0.5, "c": 0.3}
GRID = 1 / 64  # weights that are multiples of it have exact differences and sums


@dataclass(frozen=True)
class World:
    """A pool, and the state dicts of its base and its sources."""

    pool: Pool
    states: Mapping[str, State]

    @property
    def weights(self) -> list[str]:
        """Keys of the tensors that are no running statistics: mergekit knows no difference."""
        return [spec.key for spec, _ in self.pool.layout.entries if spec.kind is Kind.WEIGHT]


def make_world(folder: Path, *, grid: float = 0.0) -> World:
    """A base and the sources a, b, c; on a grid, task vectors hold zeros, and often cancel or tie."""
    toml = write_pool(folder)
    for file in folder.glob("*.safetensors"):
        state = load_file(file)
        if grid:
            state = {k: (v / grid).round() * grid if v.is_floating_point() else v for k, v in state.items()}
            save_file(state, file)
    states = {name: load_file(folder / f"{name}.safetensors") for name in ("base", *EQUAL)}
    return World(open_pool(toml), states)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> World:
    return make_world(tmp_path_factory.mktemp("world"))


@pytest.fixture(scope="module")
def coarse(tmp_path_factory: pytest.TempPathFactory) -> World:
    return make_world(tmp_path_factory.mktemp("coarse"), grid=GRID)


def mergekit(world: World, method: str, weights: Mapping[str, float], **parameters: object) -> State:
    """What mergekit makes of the sources; of the base too where the method takes differences from it."""
    base = None if method == "linear" else "base"
    models = {name: state for name, state in world.states.items() if name in weights or name == base}
    values = {"weight": dict(weights), **parameters}
    with torch.inference_mode():
        return merge_state_dicts(models, method, parameters=values, base=base)  # type: ignore[no-any-return]


def strong(pool: Pool, strength: float = 1.0) -> State:
    """The network of a pool whose task vectors became one."""
    (name,) = pool.names
    return pool.state_dict(Recipe.weighted({name: strength}, pool.blocks))


def largest_difference(ours: State, theirs: State, keys: list[str]) -> float:
    assert keys
    assert all(ours[key].shape == theirs[key].shape for key in keys)
    return max(float((ours[key].double() - theirs[key].double()).abs().max()) for key in keys)


ROUNDING = 1e-6  # of weights up to about 1 in float32; the sources differ from the base by about 0.025


# Linear sums


@pytest.mark.parametrize("weights", [EQUAL, UNEQUAL], ids=["equal", "unequal"])
def test_a_weighted_mean_is_linear(world: World, weights: dict[str, float]) -> None:
    """Of every tensor: running statistics are averaged with the same weights."""
    total = sum(weights.values())
    shares = {name: weight / total for name, weight in weights.items()}
    ours = world.pool.state_dict(Recipe.weighted(shares, world.pool.blocks))
    theirs = mergekit(world, "linear", weights)
    assert set(ours) == set(theirs)
    assert largest_difference(ours, theirs, list(theirs)) < ROUNDING


@pytest.mark.parametrize("strength", [0.3, 1 / 3, 1.7])
def test_a_scaled_sum_is_task_arithmetic(world: World, strength: float) -> None:
    ours = world.pool.state_dict(Recipe.weighted(UNEQUAL, world.pool.blocks, scale=strength))
    theirs = mergekit(world, "task_arithmetic", UNEQUAL, **{"lambda": strength})
    assert largest_difference(ours, theirs, world.weights) < ROUNDING


def test_weights_that_sum_to_more_than_one_are_task_arithmetic(world: World) -> None:
    ours = world.pool.state_dict(Recipe.weighted(EQUAL, world.pool.blocks))
    assert largest_difference(ours, mergekit(world, "task_arithmetic", EQUAL), world.weights) < ROUNDING


# TIES


@pytest.mark.parametrize("density", [0.05, 0.2, 0.7, 1.0])
@pytest.mark.parametrize("strength", [1.0, 1.8])
def test_trimmed_by_tensor_and_elected_is_ties(world: World, density: float, strength: float) -> None:
    pool = prepare(world.pool, Trim(density, per="tensor"), Elect(zero="plus"))
    theirs = mergekit(world, "ties", EQUAL, density=density, **{"lambda": strength})
    assert largest_difference(strong(pool, strength), theirs, world.weights) < ROUNDING


@pytest.mark.parametrize("weights", [UNEQUAL, {"a": 3.0, "b": 0.1, "c": 1.0}], ids=["near", "far"])
def test_weights_before_the_election_are_those_of_ties(world: World, weights: dict[str, float]) -> None:
    elect = Elect(sources=tuple(weights), zero="plus", weights=tuple(weights.values()))
    pool = prepare(world.pool, Trim(0.4, per="tensor"), elect)
    theirs = mergekit(world, "ties", weights, density=0.4)
    assert largest_difference(strong(pool), theirs, world.weights) < ROUNDING


def test_the_sum_of_what_agrees_is_ties_without_normalising(world: World) -> None:
    pool = prepare(world.pool, Trim(0.3, per="tensor"), Elect(zero="plus", combine="sum"))
    theirs = mergekit(world, "ties", EQUAL, density=0.3, normalize=False)
    assert largest_difference(strong(pool), theirs, world.weights) < ROUNDING


def test_sums_of_zero_elect_plus_as_in_ties(coarse: World) -> None:
    """Entries that cancel exactly; the paper's rule gives another network."""
    theirs = mergekit(coarse, "ties", EQUAL)
    plus = strong(prepare(coarse.pool, Elect(zero="plus")))
    assert largest_difference(plus, theirs, coarse.weights) < ROUNDING
    paper = strong(prepare(coarse.pool, Elect(zero="majority")))
    assert largest_difference(paper, theirs, coarse.weights) >= GRID / 2


def test_entries_as_large_as_the_smallest_kept_stay_with_us_alone(coarse: World) -> None:
    """Where magnitudes tie, mergekit stops at int(density * n) entries, in the order its sort leaves."""
    theirs = mergekit(coarse, "ties", {"a": 1.0}, density=0.1)
    trimmed = prepare(coarse.pool, Trim(0.1, per="tensor"))
    ours = trimmed.state_dict(trimmed.equal(trimmed.names[0]))
    base, more = coarse.states["base"], 0
    for key in coarse.weights:
        left, kept = ours[key] - base[key], theirs[key] - base[key]
        extra = (left != 0) & (kept == 0)
        assert torch.equal(left[kept != 0], kept[kept != 0])
        if bool(extra.any()):
            more += 1
            assert float(left[extra].abs().max()) == float(left[left != 0].abs().min())
    assert more > 0


# DARE: generators differ, so mergekit is handed our masks where it would draw its own.


def with_our_masks(
    world: World, dropped: Pool, method: str, patch: pytest.MonkeyPatch, **parameters: object
) -> State:
    """A merge by mergekit, tensor by tensor: it asks for one mask a source, in the order they are given."""
    masks = [dropped.layout.views(dropped.vectors[name]) for name in dropped.names]

    def drawn(key: str) -> Iterator[torch.Tensor]:
        yield from ((mask[key] != 0).float() for mask in masks)

    merged = {}
    for key in world.weights:
        queue = drawn(key)
        patch.setattr(torch, "bernoulli", lambda probabilities, queue=queue: next(queue))
        one = World(world.pool, {name: {key: state[key]} for name, state in world.states.items()})
        merged |= mergekit(one, method, EQUAL, **parameters)
        assert next(queue, None) is None, f"{key}: mergekit asked for fewer masks than there are sources"
    return merged


@pytest.mark.parametrize("probability", [0.3, 0.9])
def test_rescaling_by_norm_is_that_of_dare(
    world: World, probability: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    drop = Drop(probability, seed=4, rescale="norm")
    theirs = with_our_masks(
        world,
        prepare(world.pool, drop),
        "dare_linear",
        monkeypatch,
        density=1 - probability,
        normalize=True,
    )
    ours = strong(prepare(world.pool, drop, Mean("dare")))
    assert largest_difference(ours, theirs, world.weights) < ROUNDING


def test_rescaling_by_probability_is_dare_with_a_strength_of_its_own(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The paper's 1 / (1 - p), which is mergekit's lambda where it does not rescale."""
    theirs = with_our_masks(
        world,
        prepare(world.pool, Drop(0.6, seed=5)),
        "dare_linear",
        monkeypatch,
        density=0.4,
        normalize=True,
        rescale=False,
        **{"lambda": 1 / 0.4},
    )
    ours = strong(prepare(world.pool, Drop(0.6, seed=5), Mean("dare")))
    assert largest_difference(ours, theirs, world.weights) < ROUNDING


@pytest.mark.parametrize("combine", ["mean", "sum"])
def test_dropped_and_elected_is_dare_ties(
    world: World, combine: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    drop = Drop(0.6, seed=6, rescale="norm")
    theirs = with_our_masks(
        world,
        prepare(world.pool, drop),
        "dare_ties",
        monkeypatch,
        density=0.4,
        normalize=combine == "mean",
    )
    ours = strong(prepare(world.pool, drop, Elect("dare_ties", zero="plus", combine=combine)))
    assert largest_difference(ours, theirs, world.weights) < ROUNDING


def test_dropping_nothing_is_dare_without_a_mask(world: World) -> None:
    ours = strong(prepare(world.pool, Drop(0.0), Mean("dare")))
    theirs = mergekit(world, "dare_linear", EQUAL, density=1.0, normalize=True)
    assert largest_difference(ours, theirs, world.weights) < ROUNDING


def test_as_many_entries_are_dropped_by_both(world: World) -> None:
    """Of all entries of one source, within four standard deviations of what each draws by itself."""
    with torch.random.fork_rng():
        torch.manual_seed(0)
        theirs = mergekit(world, "dare_linear", {"a": 1.0}, density=0.4)
    base, source = world.states["base"], world.states["a"]
    dropped = prepare(world.pool, Drop(0.6, seed=7))
    ours = dropped.layout.views(dropped.vectors[dropped.names[0]])
    moved = {key: source[key] != base[key] for key in world.weights}
    count = sum(int(entries.sum()) for entries in moved.values())
    kept_by_us = sum(int((ours[key] != 0).sum()) for key in world.weights)
    kept_by_them = sum(int((theirs[key] != base[key]).sum()) for key in world.weights)
    spread = 4 * (0.4 * 0.6 / count) ** 0.5
    assert kept_by_us / count == pytest.approx(0.4, abs=spread)
    assert kept_by_them / count == pytest.approx(0.4, abs=spread)
