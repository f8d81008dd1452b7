"""DisparityCompare's Python side: how maps travel, what is remembered, what is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from browser_compare import HEIGHT, HOLE, WIDTH, panels, widget, world
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.typing import NDArray
from sfkit_widgets import _compare_scene
from sfkit_widgets._compare_scene import (
    HIGHEST,
    LOWEST,
    NO_RESIDUAL,
    NO_VALUE,
    NOT_FINITE,
    REACH,
    RESIDUAL_NOT_FINITE,
    RESIDUAL_STEPS,
    MapCoding,
    scene,
)
from sfkit_widgets.disparity_compare import DisparityCompare
from tiny import write_pairs
from traitlets import TraitError

from sfkit.analysis.disparities import DisparityPanels, NetworkMaps, disparity_panels
from sfkit.analysis.pair_maps import error_map
from sfkit.datasets.benchmark import Benchmark, open_benchmark
from sfkit.errors import InputError
from sfkit.merging import Pool


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> tuple[Pool, Benchmark]:
    return world(tmp_path_factory.mktemp("compare"))


@pytest.fixture
def compare(made: tuple[Pool, Benchmark]) -> DisparityCompare:
    pool, benchmark = made
    recipes = {"base": pool.base_recipe(), "uniform": pool.uniform(), "a alone": pool.equal("a")}
    return DisparityCompare(pool, recipes, benchmark)


def decoded(state: dict[str, Any], code: bytes) -> NDArray[np.float64]:
    """Disparities from codes, by the words of MapCoding's docstring."""
    codes = np.frombuffer(code, "<u2").astype(np.float64).reshape(state["height"], state["width"])
    pixels = state["offset"] + (codes - 1) * state["step"]
    return np.where((codes == NO_VALUE) | (codes == NOT_FINITE), np.nan, pixels)


def tell(compare: DisparityCompare, command: str, **arguments: object) -> None:
    message = {"command": command, "arguments": arguments, "view": "v", "sequence": 1}
    compare._receive(compare, message, [])


def test_maps_come_back_to_half_a_step() -> None:
    state = scene(panels())
    assert state["step"] == pytest.approx(18 / (HIGHEST - LOWEST), rel=0.6)
    truth = decoded(state, state["truth"])
    assert np.isnan(truth[:, :HOLE]).all()
    np.testing.assert_allclose(truth[:, HOLE:], panels().truth[:, HOLE:], atol=state["step"])
    for network, held in zip(panels().networks, state["networks"], strict=True):
        np.testing.assert_allclose(decoded(state, held["map"]), network.disparity, atol=state["step"])


def test_no_truth_no_finite_value_and_zero_are_three_things() -> None:
    coding = MapCoding.of(panels())
    values = np.array([[np.nan, 0.0, np.inf]], np.float32)
    assert coding.codes(values, missing=NO_VALUE).tolist() == [[NO_VALUE, LOWEST, NO_VALUE]]
    assert coding.codes(values, missing=NOT_FINITE).tolist() == [[NOT_FINITE, LOWEST, NOT_FINITE]]


maps = arrays(
    np.float32,
    (3, 5),
    elements=st.one_of(st.floats(-1e6, 1e6, width=32), st.just(math.nan), st.just(math.inf)),
)


@given(prediction=maps)
def test_wild_predictions_keep_the_coding_fine(prediction: NDArray[np.float32]) -> None:
    truth = np.full((3, 5), 10.0, np.float32)
    network = NetworkMaps("wild", prediction, error_map(prediction, truth), {})
    left = np.zeros((3, 5, 3), np.uint8)
    wild = DisparityPanels("b", "all-valid", "p", left, truth, (network,), (5.0, 15.0), 1.0)
    coding = MapCoding.of(wild)
    assert coding.step <= (10 + 2 * REACH) / 65_000
    finite = prediction[np.isfinite(prediction)]
    assert coding.above == bool((finite > 15 + REACH).any())
    assert coding.below == bool((finite < 5 - REACH).any())
    codes = coding.codes(prediction, missing=NOT_FINITE)
    pixels = coding.offset + (codes.astype(np.float64) - 1) * coding.step
    near = np.isfinite(prediction) & (np.abs(prediction - 10) < REACH)
    np.testing.assert_allclose(pixels[near], prediction[near], atol=coding.step)
    assert ((codes == NOT_FINITE) == ~np.isfinite(prediction)).all()


def test_a_scene_is_json_beside_its_bytes() -> None:
    state = scene(panels())
    regions = state["networks"][1]["regions"]
    assert [(r["x"], r["y"], r["width"], r["height"], r["peak"]) for r in regions] == [
        (30, 6, 12, 8, [35, 10])
    ]
    json.dumps(state, default=lambda value: f"{len(value)} bytes", allow_nan=False)
    assert len(state["truth"]) == 2 * HEIGHT * WIDTH
    assert state["networks"][1]["against"][0] == {
        "fixed": 0.0,
        "broken": pytest.approx(100 * 96 / (HEIGHT * (WIDTH - HOLE))),
    }


def test_a_region_that_is_not_finite_has_no_number() -> None:
    broken = np.full((20, 20), np.nan, np.float32)
    truth = np.full((20, 20), 3.0, np.float32)
    network = NetworkMaps("n", broken, error_map(broken, truth), {})
    left = np.zeros((20, 20, 3), np.uint8)
    state = scene(DisparityPanels("b", "all-valid", "p", left, truth, (network,), (3.0, 4.0), 1.0))
    (region,) = state["networks"][0]["regions"]
    assert (region["worst"], region["mean"], region["pixels"]) == (None, None, 400)
    json.dumps(region, allow_nan=False)


def test_the_palettes_are_the_figures() -> None:
    held = _compare_scene.palettes()
    assert list(held["disparity"][:3]) == [68, 1, 84]
    assert list(held["error"][-3:]) == [122, 44, 0]
    assert len(held["hatch"]) == 8 * 8 * 3


def test_it_shows_what_the_analysis_computes(compare: DisparityCompare, made: tuple[Pool, Benchmark]) -> None:
    pool, benchmark = made
    expected = disparity_panels(pool, {"uniform": pool.uniform()}, benchmark)
    shown = compare.scene["networks"][1]
    assert (shown["name"], compare.first, compare.second) == ("uniform", "base", "uniform")
    np.testing.assert_allclose(
        decoded(compare.scene, shown["map"]),
        expected.networks[0].disparity,
        atol=compare.scene["step"],
    )
    assert shown["score"] == f"bad-2.0 {expected.networks[0].scores['bad-2.0']:.2f} %"


def test_a_pair_without_truth_brings_its_right_image_and_residuals(
    made: tuple[Pool, Benchmark], tmp_path: Path
) -> None:
    pool, _ = made
    pairs = open_benchmark("unlabelled", write_pairs(tmp_path, count=1))
    recipes = {"base": pool.base_recipe(), "uniform": pool.uniform()}
    state = DisparityCompare(pool, recipes, pairs, shown="better").scene
    assert (state["kind"], state["unit"], state["truth"]) == ("residual", "%", None)
    assert cv2.imdecode(np.frombuffer(state["right"], np.uint8), cv2.IMREAD_COLOR).shape == (48, 96, 3)
    expected = disparity_panels(pool, recipes, pairs).networks[1].error
    codes = np.frombuffer(state["networks"][1]["residual"], np.uint8).reshape(48, 96)
    assert ((codes == NO_RESIDUAL) == np.isnan(expected)).all()
    known = np.isfinite(expected)
    np.testing.assert_allclose(codes[known] / RESIDUAL_STEPS, expected[known], atol=0.201)
    assert state["networks"][1]["score"].startswith("census ")
    json.dumps(state["networks"][1]["against"], allow_nan=False)


def test_codes_of_residuals_tell_no_match_from_not_finite() -> None:
    values = np.array([[0.0, 100.0, np.inf, np.nan]], np.float32)
    assert _compare_scene.residual_codes(values).tolist() == [[0, 250, RESIDUAL_NOT_FINITE, NO_RESIDUAL]]
    nowhere = np.full((2, 2), np.nan, np.float32)
    assert _compare_scene._against(nowhere, nowhere, 1.0) == {"fixed": None, "broken": None}


def test_another_pair_comes_with_its_scores_and_an_open_view(compare: DisparityCompare) -> None:
    tell(compare, "look", camera={"x": 10, "y": 10, "zoom": 4}, cursor=[3, 4], shown="error")
    assert (compare.camera["zoom"], compare.cursor, compare.shown) == (4, [3, 4], "error")
    tell(compare, "choose", pair="pair1")
    assert (compare.scene["pair"], compare.camera, compare.cursor) == ("pair1", {}, [])
    assert compare.shown == "error"
    tell(compare, "choose", pair="pair9")
    assert "pair9" in compare.error
    assert compare.scene["pair"] == "pair1"


def test_a_look_leaves_what_it_does_not_name(compare: DisparityCompare) -> None:
    tell(compare, "look", divider=0.25, first="a alone")
    tell(compare, "look", arrangement="swipe", limits=[1.0, 9.5])
    assert (compare.divider, compare.first, compare.arrangement) == (0.25, "a alone", "swipe")
    assert compare.limits == [1.0, 9.5]
    tell(compare, "look", limits=[])
    assert compare.limits == []


def test_settings_are_looks(tmp_path: Path) -> None:
    shown = widget(tmp_path, shown="better", first="a alone", pair="pair1", metrics=["epe"])
    assert (shown.shown, shown.first, shown.second) == ("better", "a alone", "uniform")
    assert shown.scene["pair"] == "pair1"
    assert shown.scene["networks"][0]["score"].startswith("EPE ")


@pytest.mark.parametrize(
    ("settings", "sentence"),
    [
        ({"first": "bas"}, "unknown network for 'first' 'bas'.*did you mean 'base'"),
        (
            {"limits": [5, 5]},
            r"limits: found \[5.0, 5.0\], expected a lower and a higher disparity in pixels",
        ),
        ({"limits": [5]}, "limits: found"),
        ({"limits": [0, math.inf]}, "limits: found"),
        ({"arangement": "swipe"}, "unknown argument of DisparityCompare 'arangement'.*'arrangement'"),
        ({"pair": "pair7"}, "pair7"),
        ({"metrics": ["worst"]}, "unknown metric 'worst'"),
    ],
)
def test_what_is_wrong_is_said(made: tuple[Pool, Benchmark], settings: dict[str, Any], sentence: str) -> None:
    pool, benchmark = made
    with pytest.raises(InputError, match=sentence):
        DisparityCompare(pool, {"base": pool.base_recipe()}, benchmark, **settings)


def test_arrangements_are_a_closed_set(made: tuple[Pool, Benchmark]) -> None:
    pool, benchmark = made
    with pytest.raises(TraitError, match="side by side"):
        DisparityCompare(pool, {"base": pool.base_recipe()}, benchmark, arrangement="flicker")
    with pytest.raises(InputError, match="at least one network"):
        DisparityCompare(pool, {}, benchmark)


def test_one_network_is_a_and_b(made: tuple[Pool, Benchmark]) -> None:
    pool, benchmark = made
    alone = DisparityCompare(pool, {"base": pool.base_recipe()}, benchmark)
    assert (alone.first, alone.second) == ("base", "base")
