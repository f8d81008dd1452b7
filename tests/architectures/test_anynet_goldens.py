"""AnyNet against arrays from an independent implementation, on real checkpoints and real images."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from anynet_fill import fill, filled_pair
from golden_arrays import SHIPPED

from sfkit.architectures import architecture
from sfkit.architectures.anynet import AnyNet, Route, StageTrace

Weights = dict[str, torch.Tensor]

MODES = {"ac1": True, "ac0": False}
IMAGES_OF = {"base": ("motorcycle", "playground"), "avg": ("motorcycle", "playground")}
IMAGES_OF["k12"] = ("motorcycle", "playground", "pad")
CASES = [(i, w, m) for w, images in IMAGES_OF.items() for i in images for m in MODES]

# Largest error of a disparity in pixels, its mean, and the largest error of a low-resolution value.
# The arrays are rounded to 2^-12 px; the float32 bounds are what float32 rounding alone does to the network.
TOLERANCES = {torch.float64: (1.3e-4, 1.3e-4, 1e-6), torch.float32: (5e-3, 2e-4, 2e-3)}


@pytest.fixture(scope="module")
def arrays(goldens: Path) -> dict[str, np.ndarray]:
    with np.load(goldens / "anynet" / "golden_anynet.npz") as file:
        return dict(file)


@pytest.fixture(scope="module")
def weights(real_data: Path) -> dict[str, Weights]:
    base = _read(real_data / "anynet" / "base_sceneflow.tar")
    k12 = _read(real_data / "anynet" / "ft_kitti2012_official.tar")
    return {"base": base, "k12": k12, "avg": {k: (base[k] + k12[k]) / 2 for k in base}}


@pytest.fixture(scope="module")
def truths(real_data: Path) -> dict[str, np.ndarray]:
    """Ground truth disparity of the three crops in pixels; infinite where unknown."""
    with np.load(real_data / "pairs" / "motorcycle" / "motorcycle_disp.npz") as file:
        motorcycle = file["arr_0"]
    scans = real_data / "eth3d" / "two_view_training_gt"
    playground = cv2.imread(str(scans / "playground" / "disp0GT.pfm"), cv2.IMREAD_UNCHANGED)
    return {
        "motorcycle": motorcycle[150:390, 220:540],
        "playground": playground[120:360, 300:620],
        "pad": motorcycle[200:301, 300:450],
    }


def _read(path: Path) -> Weights:
    state: Weights = torch.load(path, map_location="cpu", weights_only=True)["state_dict"]
    return {key.removeprefix("module."): value for key, value in state.items()}


def _network(state: Weights, dtype: torch.dtype, **options: bool) -> AnyNet:
    network = AnyNet(**options)
    missing, unexpected = network.load_state_dict(state, strict=False)
    assert not unexpected
    assert all(key.endswith("num_batches_tracked") for key in missing)
    return network.to(dtype).eval()


def _prepared(image: np.ndarray) -> torch.Tensor:
    """The input convention in float64, where its rounding to float32 would hide that of the network."""
    inputs = architecture("anynet").inputs({})
    height, width = image.shape[:2]
    x = (image / 255 - np.array(inputs.mean)) / np.array(inputs.std)
    x = np.pad(x, ((0, -height % 16), (0, -width % 16), (0, 0)), mode="edge")
    return torch.from_numpy(x.transpose(2, 0, 1)[None].copy())


def _trace(network: AnyNet, arrays: dict[str, np.ndarray], image: str, dtype: torch.dtype) -> StageTrace:
    height, width = arrays[f"{image}.L"].shape[:2]
    left, right = (_prepared(arrays[f"{image}.{side}"]).to(dtype) for side in "LR")
    with torch.no_grad():
        trace = network.trace(left, right)
    return replace(trace, disparities=tuple(d[..., :height, :width] for d in trace.disparities))


def _decoded(array: np.ndarray) -> np.ndarray:
    return np.cumsum(np.cumsum(array.astype(np.int64), 1), 1) / 4096


@pytest.mark.parametrize("route", list(Route))
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32], ids=["float64", "float32"])
@pytest.mark.parametrize(("image", "name", "mode"), CASES, ids=[".".join(c) for c in CASES])
def test_every_stage_equals_the_golden_arrays(
    arrays: dict[str, np.ndarray],
    weights: dict[str, Weights],
    image: str,
    name: str,
    mode: str,
    dtype: torch.dtype,
    route: Route,
) -> None:
    network = _network(weights[name], dtype, align_corners=MODES[mode])
    network.use_route(route)
    trace = _trace(network, arrays, image, dtype)
    largest, mean, largest_low = TOLERANCES[dtype]
    compared = 0
    for stage, (low, disparity) in enumerate(zip((*trace.low, None), trace.disparities, strict=True), 1):
        key = f"{image}.{name}.{mode}"
        if low is not None and f"{key}.low{stage}" in arrays:
            assert np.abs(low[0].numpy() - arrays[f"{key}.low{stage}"]).max() <= largest_low
            compared += 1
        if f"{key}.disp{stage}" in arrays:
            error = np.abs(disparity[0].numpy() - _decoded(arrays[f"{key}.disp{stage}"]))
            assert error.max() <= largest
            assert error.mean() <= mean
            compared += 1
    expected = {"ac1": 7 if name == "k12" else 6, "ac0": 2}[mode]
    assert compared == expected + ((image, name, mode) == ("motorcycle", "base", "ac0"))


@pytest.mark.parametrize(("image", "name", "mode"), CASES, ids=[".".join(c) for c in CASES])
def test_end_point_errors_are_those_of_the_original(
    goldens: Path,
    truths: dict[str, np.ndarray],
    arrays: dict[str, np.ndarray],
    weights: dict[str, Weights],
    image: str,
    name: str,
    mode: str,
) -> None:
    known = json.loads((goldens / "anynet" / "golden_epe.json").read_text())
    network = _network(weights[name], torch.float32, align_corners=MODES[mode])
    truth = truths[image]
    valid = np.isfinite(truth)
    for stage, disparity in enumerate(_trace(network, arrays, image, torch.float32).disparities, 1):
        error = np.abs(disparity[0].numpy() - truth)[valid].mean()
        if (stage, mode) != (1, "ac0"):  # the first stage does not warp; its error is on record once
            assert error == pytest.approx(known[f"{image}.{name}.{mode}.{stage}"], abs=1e-3)


def test_without_propagation_the_output_is_stage_three(
    arrays: dict[str, np.ndarray], weights: dict[str, Weights]
) -> None:
    state = {k: v for k, v in weights["k12"].items() if not k.startswith("refine_spn.")}
    trace = _trace(_network(state, torch.float64, spn=False), arrays, "pad", torch.float64)
    assert len(trace.disparities) == 3
    error = np.abs(trace.disparities[-1][0].numpy() - _decoded(arrays["pad.k12.ac1.disp3"]))
    assert error.max() <= TOLERANCES[torch.float64][0]


@pytest.mark.parametrize("route", list(Route))
@pytest.mark.parametrize("dtype", [torch.float64, torch.float32], ids=["float64", "float32"])
@pytest.mark.parametrize("mode", MODES)
def test_filled_weights_give_what_the_original_gives(mode: str, dtype: torch.dtype, route: Route) -> None:
    """All four stages without any checkpoint; of the disparities every fourth row and column is kept."""
    network = AnyNet(ranges=(4, 3, 3), align_corners=MODES[mode])
    fill(network)
    network.to(dtype).eval().use_route(route)
    left, right = (torch.from_numpy(image).to(dtype) for image in filled_pair())
    with torch.no_grad():
        trace = network.trace(left, right)
    found = {f"low{stage}": low[0] for stage, low in enumerate(trace.low, 1)}
    found |= {f"disp{stage}": disp[0, ::4, ::4] for stage, disp in enumerate(trace.disparities, 1)}
    with np.load(SHIPPED / "anynet" / "golden_anynet_filled.npz") as file:
        known = {key.removeprefix(f"{mode}."): file[key] for key in file if key.startswith(mode)}
    assert known.keys() == found.keys()
    rounding = 2e-7 if dtype is torch.float64 else 1e-4  # the arrays are float32
    for key, values in known.items():
        error = np.abs(found[key].numpy() - values).max()
        assert error <= rounding * np.abs(values).max(), key


@pytest.mark.parametrize("spn", [True, False])
def test_state_dict_has_the_published_keys_and_shapes(shipped_goldens: Path, spn: bool) -> None:
    known = json.loads((shipped_goldens / "anynet" / "anynet_keys.json").read_text())
    expected = {k: tuple(v) for k, v in known["with_spn"].items()}
    expected |= dict.fromkeys(known["num_batches_tracked_keys_optional"], ())
    if not spn:
        expected = {k: v for k, v in expected.items() if k not in known["spn_keys"]}
    found = {k: tuple(v.shape) for k, v in AnyNet(spn=spn).state_dict().items()}
    assert found == expected
