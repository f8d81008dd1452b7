"""FoundationStereo against arrays of the reference run: every stage, then the disparities.

Weights are filled by rule, so disparities carry no meaning beyond equality. Parameters declared dead
are set to NaN throughout: any influence on an output would show.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import pytest
import torch
from foundation_stereo_reference import MODES, arrays, filled_state, images, network_from
from torch import nn

from sfkit.architectures import architecture
from sfkit.architectures.foundation_stereo import FoundationStereo, RefinementTrace, hierarchical_disparity
from sfkit.architectures.foundation_stereo.neck import Features

# Largest absolute errors, from the specification's section 16.
FEATURES, VOLUME, INITIAL, DISPARITY, SAMPLES = 1e-4, 1e-3, 3e-3, 5e-3, 1e-3

VIT = "feature.dino.depth_anything.pretrained"
SCRATCH = "feature.dino.depth_anything.depth_head.scratch"
GUIDED = ("feature_att_8", "feature_att_16", "feature_att_32", "feature_att_up_16", "feature_att_up_8")
PLAIN = ("conv1", "conv2", "conv3", "conv3_up", "agg_0", "conv2_up", "agg_1", "conv1_up", "conv_patch")

# golden name -> module whose output it is; "<" marks the module's first input, "<2" its second
BEFORE = {
    "vit_patch_embed": f"{VIT}.patch_embed",
    "vit_tokens_in": f"<{VIT}.blocks.0",
    **{f"vit_block{i}": f"{VIT}.blocks.{i}" for i in (0, 2, 5, 8, 11)},
    **{f"dpt_layer{i}_rn": f"{SCRATCH}.layer{i}_rn" for i in (1, 2, 3, 4)},
    **{f"dpt_path{i}": f"{SCRATCH}.refinenet{i}" for i in (1, 2, 3, 4)},
    "dpt_output_conv1": f"{SCRATCH}.output_conv1",
    "stem": "feature.stem",
    **{f"edgenext_stage{i}": f"feature.stages.{i}" for i in range(4)},
    **{name: f"feature.{name}" for name in ("deconv32_16", "deconv16_8", "deconv8_4")},
    "stem_2": "stem_2",
    "comb_volume": "<corr_stem",
    "corr_feature_att": "corr_feature_att",
    **{f"cam.call{i}": "cam" for i in range(3)},
    **{f"sam.call{i}": "sam" for i in range(3)},
}
HOURGLASS = {
    **{f"hg_{name}": f"cost_agg.{name}" for name in (*PLAIN, *GUIDED)},
    "hg_att": "cost_agg.atts.4",
    **{f"hg_att_sa{i}": f"cost_agg.atts.4.sa.{i}" for i in range(4)},
}
RECURRENCE = {
    "geo_feat": "<2update_block.encoder",
    "motion": "update_block.encoder",
    **{name: f"update_block.{name}" for name in ("gru16", "gru08", "gru04", "mask")},
    "delta": "update_block.disp_head",
    "spx2": "spx_2_gru",
    "spx": "spx_gru",
}


@dataclass
class Recorder:
    """Keeps what the named modules saw and gave, call by call."""

    seen: dict[str, list[torch.Tensor]] = field(default_factory=dict)

    def watch(self, network: nn.Module, places: dict[str, str]) -> None:
        for place in set(places.values()):
            module = network.get_submodule(place.lstrip("<2"))
            module.register_forward_hook(self._keeper(place))

    def _keeper(self, place: str):  # type: ignore[no-untyped-def]
        def keep(_module: nn.Module, given: tuple[torch.Tensor, ...], out: torch.Tensor) -> None:
            kept = given[1] if place.startswith("<2") else given[0] if place.startswith("<") else out
            self.seen.setdefault(place, []).append(kept)

        return keep


@dataclass(frozen=True)
class Run:
    """One forward pass of four iterations."""

    trace: RefinementTrace
    recorder: Recorder


@pytest.fixture(scope="module")
def state() -> dict[str, torch.Tensor]:
    weights = filled_state("vits")
    for key, tensor in weights.items():
        if tensor.is_floating_point() and any(
            fnmatchcase(key, glob) for glob in architecture("foundation-stereo").dead
        ):
            tensor.fill_(float("nan"))
    return weights


@pytest.fixture(scope="module")
def case(shipped_goldens: Path) -> dict[str, np.ndarray]:
    return arrays(shipped_goldens, "vits")


@pytest.fixture(scope="module")
def stages(shipped_goldens: Path) -> dict[str, np.ndarray]:
    return arrays(shipped_goldens, "vits_stages")


@pytest.fixture(scope="module")
def runs(state: dict[str, torch.Tensor], case: dict[str, np.ndarray]) -> dict[str, Run]:
    return {mode: record(state, case, mode) for mode in MODES}


def record(state: dict[str, torch.Tensor], case: dict[str, np.ndarray], mode: str) -> Run:
    recorder = Recorder()
    watched = build(state, case, mode)
    extra = {name: name for name in ("feature", "cnet", "corr_stem", "cost_agg", "classifier")}
    recorder.watch(watched, {**BEFORE, **HOURGLASS, **RECURRENCE, **extra})
    with torch.inference_mode():
        return Run(watched.trace(*images(case)), recorder)


def build(
    state: dict[str, torch.Tensor], case: dict[str, np.ndarray], mode: str, vit_size: str = "vits"
) -> FoundationStereo:
    return network_from(
        state,
        vit_size=vit_size,
        max_disp=int(case["max_disp"]),
        iterations=int(case.get("iters", 1)),
        disparity_attention=mode,
    )


def error(ours: torch.Tensor, golden: np.ndarray) -> float:
    assert tuple(ours.shape) == golden.shape
    return float(np.abs(ours.numpy() - golden).max())


def assert_stage(stages: dict[str, np.ndarray], name: str, ours: torch.Tensor) -> None:
    assert list(ours.shape) == stages[f"{name}__shape"].tolist(), name
    flat = ours.contiguous().flatten().numpy()
    samples = flat[np.linspace(0, flat.size - 1, 64).astype(int)]
    assert np.abs(samples - stages[f"{name}__samples"]).max() < SAMPLES, name
    wide = flat.astype(np.float64)
    summary = [wide.mean(), wide.std(ddof=1), np.abs(wide).max()]
    np.testing.assert_allclose(summary, stages[f"{name}__stats"], atol=SAMPLES, rtol=1e-4, err_msg=name)


def test_every_stage_of_the_reference_is_compared(stages: dict[str, np.ndarray]) -> None:
    names = {key.removesuffix("__shape") for key in stages if key.endswith("__shape")}
    by_mode = {f"{name}_{golden}" for name in HOURGLASS for golden in MODES.values()}
    by_call = {f"{name}_{golden}.call{i}" for name in RECURRENCE for golden in MODES.values() for i in (0, 1)}
    assert names == {*BEFORE, *by_mode, *by_call}


@pytest.mark.parametrize("name", BEFORE)
def test_a_stage_before_the_hourglass(runs: dict[str, Run], stages: dict[str, np.ndarray], name: str) -> None:
    call = int(name[-1]) if ".call" in name else 0
    assert_stage(stages, name, runs["disparity"].recorder.seen[BEFORE[name]][call])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", HOURGLASS)
def test_a_stage_of_the_hourglass(
    runs: dict[str, Run], stages: dict[str, np.ndarray], name: str, mode: str
) -> None:
    assert_stage(stages, f"{name}_{MODES[mode]}", runs[mode].recorder.seen[HOURGLASS[name]][0])


@pytest.mark.parametrize("mode", MODES)
@pytest.mark.parametrize("name", RECURRENCE)
def test_a_stage_of_the_recurrence(
    runs: dict[str, Run], stages: dict[str, np.ndarray], name: str, mode: str
) -> None:
    for call in (0, 1):
        ours = runs[mode].recorder.seen[RECURRENCE[name]][call]
        assert_stage(stages, f"{name}_{MODES[mode]}.call{call}", ours)


def test_correlations_of_one_row(runs: dict[str, Run], stages: dict[str, np.ndarray]) -> None:
    volume = runs["disparity"].recorder.seen["<corr_stem"][0]
    assert error(volume[0, :8, ::8, 8], stages["comb_volume_gwc_row8"]) < 1e-5


def assert_features(run: Run, case: dict[str, np.ndarray]) -> None:
    features = run.recorder.seen["feature"][0]
    assert isinstance(features, Features)
    assert error(features.monocular[:, :8], case["vit_feat"]) < FEATURES
    for level in range(4):
        assert error(features[level][:, :4], case[f"feat{level}_slice"]) < FEATURES
    for scale, pair in enumerate(run.recorder.seen["cnet"][0]):
        for index in (0, 1):
            assert error(pair[index][:, :4], case[f"cnet{scale}_{index}_slice"]) < FEATURES


def assert_volume(run: Run, case: dict[str, np.ndarray], mode: str) -> None:
    seen = run.recorder.seen
    assert error(seen["corr_stem"][0][:, 0, ::8], case["corr_stem_slice"]) < VOLUME
    assert error(seen["cost_agg"][0][:, 0, ::8], case[f"cost_agg_slice_{MODES[mode]}"]) < VOLUME
    assert error(seen["classifier"][0][:, 0, ::8], case[f"logits_slice_{MODES[mode]}"]) < VOLUME


def assert_disparities(run: Run, case: dict[str, np.ndarray], mode: str) -> None:
    assert error(run.trace.initial, case[f"init_disp_{MODES[mode]}"]) < INITIAL
    assert error(torch.stack(run.trace.disparities)[:, :, None], case[f"disp_{MODES[mode]}"]) < DISPARITY


def test_features_and_context(runs: dict[str, Run], case: dict[str, np.ndarray]) -> None:
    assert_features(runs["disparity"], case)


@pytest.mark.parametrize("mode", MODES)
def test_the_volume(runs: dict[str, Run], case: dict[str, np.ndarray], mode: str) -> None:
    assert_volume(runs[mode], case, mode)


@pytest.mark.parametrize("mode", MODES)
def test_the_disparities(runs: dict[str, Run], case: dict[str, np.ndarray], mode: str) -> None:
    assert_disparities(runs[mode], case, mode)


@pytest.mark.parametrize("mode", ["disparity", pytest.param("heads", marks=pytest.mark.slow)])
def test_more_candidates_than_columns(goldens: Path, state: dict[str, torch.Tensor], mode: str) -> None:
    case = arrays(goldens, "vits_md416")
    run = record(state, case, mode)
    assert_volume(run, case, mode)
    assert_disparities(run, case, mode)


@pytest.mark.parametrize("mode", ["disparity", pytest.param("heads", marks=pytest.mark.slow)])
def test_a_pair_of_odd_size_through_the_input_convention(
    goldens: Path, state: dict[str, torch.Tensor], mode: str
) -> None:
    case = arrays(goldens, "vits_extra")
    pixels = [case[side][0].transpose(1, 2, 0) for side in ("left", "right")]
    pair = architecture("foundation-stereo").inputs({}).prepare(*pixels)
    assert [pair.window.left, pair.window.top] == [case["pad"][0], case["pad"][2]]
    padded = build(state, {**case, "iters": case["iters_padded"]}, mode)
    with torch.inference_mode():
        disparity = pair.window.crop(padded(pair.left, pair.right))
    assert error(disparity[None], case[f"disp_padded_{MODES[mode]}"]) < DISPARITY


@pytest.mark.parametrize("mode", ["disparity", pytest.param("heads", marks=pytest.mark.slow)])
def test_two_passes(goldens: Path, state: dict[str, torch.Tensor], mode: str) -> None:
    case = arrays(goldens, "vits_extra")
    twice = build(state, {**case, "iters": case["iters_hier"]}, mode)
    with torch.inference_mode():
        disparity = hierarchical_disparity(twice, *images(case))
    assert error(disparity[None], case[f"disp_hier_{MODES[mode]}"]) < DISPARITY


class Replay(nn.Module):
    """Gives again what a module gave."""

    def __init__(self, outputs: list[Features]) -> None:
        super().__init__()
        self.outputs = iter(outputs)

    def forward(self, *_: torch.Tensor) -> Features:
        return next(self.outputs)


@pytest.mark.slow
def test_vit_l(goldens: Path) -> None:
    """The features, most of the work, do not know of the mode: they are computed once and compared."""
    case, state = arrays(goldens, "vitl"), filled_state("vitl")
    features: list[Features] = []
    for mode in MODES:
        recorder = Recorder()
        large = build(state, case, mode, vit_size="vitl")
        if features:
            large.feature = Replay(features)  # type: ignore[assignment]
        names = ("feature", "cnet", "corr_stem", "cost_agg", "classifier")
        recorder.watch(large, {name: name for name in names})
        with torch.inference_mode():
            run = Run(large.trace(*images(case)), recorder)
        features = features or recorder.seen["feature"]  # type: ignore[assignment]
        assert_features(run, case)
        assert_volume(run, case, mode)
        assert_disparities(run, case, mode)
