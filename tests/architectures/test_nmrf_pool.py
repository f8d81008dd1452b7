"""NMRF pools: what is merged, every layout there and back, the paper's Stage 2, fine-tuning."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from tiny import fine_tune

from sfkit.architectures import NMRF, architecture
from sfkit.architectures.nmrf.training import losses, parameter_groups
from sfkit.checkpoints import FileForm, Member, PoolSpec
from sfkit.cli import main
from sfkit.datasets.benchmark import memory_benchmark
from sfkit.datasets.pairs import Sample
from sfkit.datasets.synthetic import Domain, domains, synthetic_pair
from sfkit.evaluation import Evaluator, Outcome
from sfkit.merging import Pool, Recipe, open_pool, routed
from sfkit.merging.saving import save_merged
from sfkit.search import RoutingSearch, RoutingSettings, SubsetSearch, SubsetSettings

State = dict[str, torch.Tensor]
SIZE = (64, 96)
BLOCKS = ("backbone", "neck", "cost_volume", "head")

# The encoder's prefix as the network has it, and as the other COMPAT setting saves it.
PREFIXES = {"nmrf-res": ("backbone.", "image_encoder."), "nmrf-swint": ("image_encoder.", "backbone.")}


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SFKIT_CACHE", str(tmp_path / "cache"))


@pytest.fixture
def files(tmp_path: Path) -> Iterator[Path]:
    """A folder for checkpoints, emptied at once: pytest keeps the folders of its last runs."""
    yield tmp_path
    for path in tmp_path.rglob("*"):
        if path.is_file():
            path.unlink()


def random_state(name: str, seed: int = 0) -> State:
    with torch.random.fork_rng():
        torch.manual_seed(seed)
        return dict(architecture(name).build().state_dict())


def wrapped(state: State, layout: str) -> dict[str, Any]:
    """A state dict as training scripts save it."""
    layouts: dict[str, dict[str, Any]] = {
        "bare": state,
        "module": {f"module.{key}": tensor for key, tensor in state.items()},
        "model": {"model": state, "optimizer": {"state": {}, "param_groups": []}, "step": 7, "epoch": 1},
        "model_state": {"model_state": state, "best": 0.5},
    }
    return layouts[layout]


def other_compat(name: str, state: State) -> State:
    own, other = PREFIXES[name]
    return {
        other + key.removeprefix(own) if key.startswith(own) else key: value for key, value in state.items()
    }


def pool_of(folder: Path, name: str, **members: dict[str, Any]) -> Pool:
    """Save members, the base first, and open them."""
    for member, content in members.items():
        torch.save(content, folder / f"{member}.pth")
    base, *sources = (Member(member, folder / f"{member}.pth") for member in members)
    return open_pool(PoolSpec("pool", name, base, tuple(sources)))


def test_constants_are_the_bases_however_far_a_sources_are(files: Path) -> None:
    base = random_state("nmrf-res")
    parameters = {key for key, _ in architecture("nmrf-res").build().named_parameters()}
    index = "inference.layers.0.nmp.attn.relative_position_index"
    source = fine_tune(base, 1) | {index: torch.zeros_like(base[index])}
    pool = pool_of(files, "nmrf-res", base=base, a=source, b=fine_tune(base, 2))
    assert {spec.key for spec, _ in pool.layout.entries} == parameters
    assert {s.block for s in pool.layout.segments} == set(range(len(BLOCKS))), "no parameter stays outside"
    merged = pool.state_dict(pool.uniform())
    assert merged["device_indicator_tensor"].shape == (0,)
    for key in base.keys() - parameters:
        assert torch.equal(merged[key], base[key]), key
    live = pool.merge(pool.uniform()).network.state_dict()
    assert all(torch.equal(live[key], merged[key]) for key in merged)


def test_swin_constants_are_the_bases(files: Path) -> None:
    base = random_state("nmrf-swint")
    moved = {
        key: value + 1
        if key in ("image_encoder.mean", "image_encoder.std", "refinement.norm.bias")
        else value
        for key, value in base.items()
    }
    pool = pool_of(files, "nmrf-swint", base=base, a=moved)
    assert [spec.key for spec, _ in pool.layout.entries] == ["refinement.norm.bias"]
    merged = pool.state_dict(pool.equal("a"))
    assert torch.equal(merged["image_encoder.mean"], base["image_encoder.mean"])
    assert merged["image_encoder.mean"].flatten().tolist() == pytest.approx([123.675, 116.28, 103.53])


@pytest.mark.parametrize("compat", ["own", "other"])
@pytest.mark.parametrize("layout", ["bare", "module", "model", "model_state"])
def test_a_merged_file_has_the_layout_it_came_from(files: Path, layout: str, compat: str) -> None:
    """Whichever prefix and wrapping the base has, the training code that wrote it loads the merged file."""
    name = "nmrf-res"
    base = random_state(name)
    saved = base if compat == "own" else other_compat(name, base)
    source = fine_tune(base, 1)
    pool = pool_of(files, name, base=wrapped(saved, layout), a=wrapped(source, "bare"))
    written = save_merged(pool, pool.equal("a"), files / "merged.pth", form=FileForm.ORIGINAL)

    loaded = torch.load(written, weights_only=True)
    expected = wrapped(saved, layout)
    state, template = (c.get(layout, c) for c in (loaded, expected))
    assert list(state) == list(template)
    assert {key: loaded[key] for key in ("step", "epoch", "best") if key in expected} == {
        key: expected[key] for key in ("step", "epoch", "best") if key in expected
    }
    bare = {key.removeprefix("module."): tensor for key, tensor in state.items()}
    own = bare if compat == "own" else other_compat_undone(name, bare)
    network = architecture(name).build()
    network.load_state_dict(own, strict=True)
    parameters = dict(network.named_parameters())
    assert all(torch.allclose(parameters[key], source[key], atol=1e-6) for key in parameters)

    again = open_pool(PoolSpec("p", name, Member("base", written), (Member("b", files / "base.pth"),)))
    assert again.base.layout == pool.base.layout


def other_compat_undone(name: str, state: State) -> State:
    own, other = PREFIXES[name]
    return {
        own + key.removeprefix(other) if key.startswith(other) else key: value for key, value in state.items()
    }


def test_a_swin_base_of_the_other_compat_setting_comes_back_under_its_names(files: Path) -> None:
    base = random_state("nmrf-swint")
    saved = other_compat("nmrf-swint", base)
    moved = {key: value * 1.01 if value.is_floating_point() else value for key, value in base.items()}
    pool = pool_of(files, "nmrf-swint", base={"model": saved}, a={"model": moved})
    written = save_merged(pool, pool.equal("a"), files / "merged.pth", form=FileForm.ORIGINAL)
    state = torch.load(written, weights_only=True, mmap=True)["model"]
    assert list(state) == list(saved)
    assert torch.allclose(state["backbone.neck.stem.fc.bias"], moved["image_encoder.neck.stem.fc.bias"])


def test_the_command_line_refuses_a_swin_checkpoint_read_as_residual(
    files: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for member in ("base", "a"):
        torch.save({"model": random_state("nmrf-swint")}, files / f"{member}.pth")
    description = (
        'name = "p"\narchitecture = "nmrf-res"\n[base]\nfile = "base.pth"\n[sources.a]\nfile = "a.pth"\n'
    )
    (files / "pool.toml").write_text(description)
    with pytest.raises(SystemExit) as left:
        main(["merge", str(files / "pool.toml"), "--uniform", "-o", str(files / "merged.safetensors")])
    assert left.value.code == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1
    assert said[0].startswith(f"error: {files / 'base.pth'}: ")
    assert "of a Swin-T encoder" in said[0]
    assert "open it as 'nmrf-swint'" in said[0]


def test_the_papers_stage_2_searches_nine_dimensions() -> None:
    """Five sources and four module scales (section 4.1, tied routing): x = [5 logits, 4 scale variables]."""
    sources = tuple("abcde")
    heard: list[Recipe] = []

    def distance(recipes: Any) -> list[Outcome]:
        heard.extend(recipes)
        return [Outcome(abs(r.scales[3] - 1.5) + r.weights[0][0], 0.0, False, None, "") for r in recipes]

    blocks = tuple(architecture("nmrf-swint").blocks({}))
    search = RoutingSearch(sources, blocks, distance, RoutingSettings(evaluations=21, seed=3))
    best = search.run()
    assert blocks == BLOCKS
    assert search.encoding.dimension == 9
    assert search.population == 10, "4 + floor(3 ln 9)"
    assert len(heard) == 21
    assert all(len(candidate.x) == 9 for candidate in search.state.candidates)
    for recipe in heard:
        assert np.shape(recipe.weights) == (4, 5)
        assert np.shape(recipe.scales) == (4,)
        assert recipe.tied
    assert heard[0] == Recipe.equal(sources, blocks)
    assert best.score < search.state.candidates[0].score
    untied = RoutingSearch(sources, blocks, distance, RoutingSettings(tied=False))
    assert untied.encoding.dimension == 4 * 5 + 4


def samples(domain: Domain, count: int, split: str) -> list[Sample]:
    pairs = [synthetic_pair(domain, n, split=split, height=SIZE[0], width=SIZE[1]) for n in range(count)]
    return [Sample(f"{domain.name}-{n}", p.left, p.right, p.disparity) for n, p in enumerate(pairs)]


def batch(chosen: list[Sample]) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
    left, right = (
        torch.stack([torch.from_numpy(image).permute(2, 0, 1).float() for image in images])
        for images in zip(*((s.left, s.right) for s in chosen), strict=True)
    )
    return left, right, torch.stack([torch.from_numpy(s.disparity) for s in chosen])


def trained(base: State, domain: Domain, steps: int) -> State:
    """A copy of the base after a few fine-tuning steps on scenes of one domain."""
    network = architecture("nmrf-res").build()
    assert isinstance(network, NMRF)
    network.load_state_dict(base)
    network.train()
    optimiser = torch.optim.AdamW(parameter_groups(network))
    left, right, truth = batch(samples(domain, 2, "train"))
    for _ in range(steps):
        optimiser.zero_grad()
        losses(network.estimate(left, right), truth).total().backward()
        torch.nn.utils.clip_grad_norm_(network.parameters(), 1.0)
        optimiser.step()
    return dict(network.state_dict())


def test_sources_fine_tuned_from_one_base_merge_and_are_searched(files: Path) -> None:
    base = random_state("nmrf-res")
    worlds = list(domains().values())[:3]
    states = {f"s{n}": trained(base, world, steps=3) for n, world in enumerate(worlds)}
    pool = pool_of(files, "nmrf-res", base={"model": base}, **{n: {"model": s} for n, s in states.items()})
    assert pool.warnings == ()
    mean = pool.state_dict(pool.equal("s0", "s1"))
    for key, value in mean.items():
        if value.is_floating_point():
            expected = (states["s0"][key].double() + states["s1"][key].double()) / 2
            assert torch.allclose(value.double(), expected, atol=1e-6), key

    benchmark = memory_benchmark("held out", samples(worlds[0], 2, "held-out"), metric="epe")
    evaluator = Evaluator(pool, benchmark)
    first = SubsetSearch(
        pool.names, pool.blocks, evaluator, SubsetSettings(population=3, generations=1)
    ).run()
    second = RoutingSearch(first.subset, pool.blocks, evaluator, RoutingSettings(evaluations=6)).run()
    assert np.isfinite(first.score)
    assert second.score <= first.score, "x = 0 is what Stage 1 found"
    assert evaluator.counts.failed == 0
    scored = evaluator([pool.equal(*subset) for subset in (("s0", "s1"), ("s0", "s2"))])
    assert scored[0].score != scored[1].score, "the sources differ"


@pytest.mark.slow
def test_a_pool_of_eleven_swin_sources_opens_merges_and_is_evaluated(files: Path) -> None:
    """The size users have: 12 files of 130 MB."""
    base = random_state("nmrf-swint")
    names = tuple("abcdefghijk")
    members: dict[str, Member] = {}
    for number, name in enumerate(("base", *names)):
        state = fine_tune(base, number) if number else base
        torch.save({"model": state}, files / f"{name}.pth")
        assert 130e6 < (files / f"{name}.pth").stat().st_size < 135e6
        members[name] = Member(name, files / f"{name}.pth")
    spec = PoolSpec("eleven", "nmrf-swint", members.pop("base"), tuple(members.values()))
    pool = open_pool(spec)
    assert pool.layout.size == 32_548_116

    key = "dpn.mlp.0.weight"
    weights = [[1.0 if b == e else 0.0 for e in range(11)] for b in range(4)]
    routes = routed(names, pool.blocks, weights, [1.0] * 4)
    states = {n: torch.load(files / f"{n}.pth", weights_only=True, mmap=True)["model"][key] for n in names}
    live = pool.merge(pool.uniform())
    mean = torch.stack([value.double() for value in states.values()]).mean(0)
    assert torch.allclose(live.network.state_dict()[key].double(), mean, atol=1e-6)
    live.apply(routes)
    assert torch.allclose(live.network.state_dict()[key], states["c"], atol=1e-6), "cost_volume from c alone"

    benchmark = memory_benchmark("one", samples(next(iter(domains().values())), 1, "benchmark"))
    outcomes = Evaluator(pool, benchmark)([pool.uniform(), routes])
    assert all(np.isfinite(outcome.score) and outcome.error is None for outcome in outcomes)
