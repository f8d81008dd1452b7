from __future__ import annotations

import copy
import json
import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from sfkit.datasets.formats import read_disparity
from sfkit.datasets.pairs import Sample
from sfkit.errors import InputError
from sfkit.evaluation.metrics import (
    THRESHOLDS,
    ImageErrors,
    Metric,
    bad,
    d1,
    epe,
    image_errors,
    thresholds_for,
)
from sfkit.evaluation.regions import EDGE_PIXELS, edge_mask

# Errors 0, 1, 2, 4, 10 and 40 at truths 10, 20, 30, 50, 400 and 100; the seventh pixel is unknown.
TRUTH = np.array([[10, 20, 30, 50, 400, 100, np.nan]], np.float32)
PREDICTION = np.array([[10, 21, 28, 54, 410, 60, 5]], np.float32)


def make_sample(truth: NDArray[np.float32], nonoccluded: NDArray[np.bool_] | None = None) -> Sample:
    image = np.zeros((*truth.shape, 3), np.uint8)
    return Sample("a", image, image, truth, nonoccluded)


def known(sample: Sample) -> NDArray[np.bool_]:
    return np.isfinite(sample.disparity)


def test_values_by_hand() -> None:
    assert epe(PREDICTION, TRUTH) == 57 / 6
    assert bad(PREDICTION, TRUTH, 0.5) == 100 * 5 / 6
    # Strict: the error of exactly 1 px is not above 1.
    assert bad(PREDICTION, TRUTH, 1) == 100 * 4 / 6
    assert bad(PREDICTION, TRUTH, 3) == 100 * 3 / 6
    # 4 px at 50 is 8 %, 40 px at 100 is 40 %; 10 px at 400 is 2.5 % and no outlier.
    assert d1(PREDICTION, TRUTH) == 100 * 2 / 6


def test_d1_is_strict_in_both_terms() -> None:
    truth = np.array([[20.0, 20.0, 100.0, 100.0]])
    assert d1(truth + np.array([[3.0, 3.5, 5.0, 5.5]]), truth) == 50.0


def test_a_given_mask_narrows_the_valid_pixels() -> None:
    mask = np.array([[True, True, False, False, False, False, True]])
    assert epe(PREDICTION, TRUTH, mask) == 0.5
    with pytest.raises(InputError, match=r"valid mask: found shape \(1, 3\), expected \(1, 7\)"):
        epe(PREDICTION, TRUTH, mask[:, :3])


def test_a_perfect_prediction_scores_zero() -> None:
    perfect = np.nan_to_num(TRUTH)
    assert (epe(perfect, TRUTH), bad(perfect, TRUTH, 0.5), d1(perfect, TRUTH)) == (0.0, 0.0, 0.0)


def test_kitti_development_kit(real_data: Path) -> None:
    """The kit's own example, whose program prints these figures."""
    truth = read_disparity(real_data / "kitti2015_devkit/disp_gt.png", "png16")
    estimate = np.nan_to_num(read_disparity(real_data / "kitti2015_devkit/disp_est.png", "png16"))
    assert d1(estimate, truth) == pytest.approx(13.623, abs=5e-4)
    assert bad(estimate, truth, 3) == pytest.approx(14.945, abs=5e-4)
    assert epe(estimate, truth) == pytest.approx(2.3697, abs=5e-5)


@pytest.mark.parametrize("broken", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("at", [0, 6])  # a pixel that counts, and one without ground truth
def test_a_prediction_that_is_not_finite_counts_as_bad_everywhere(broken: float, at: int) -> None:
    prediction = PREDICTION.copy()
    prediction[0, at] = broken
    assert (bad(prediction, TRUTH, 100), d1(prediction, TRUTH), epe(prediction, TRUTH)) == (
        100.0,
        100.0,
        math.inf,
    )
    sample = make_sample(TRUTH)
    errors = image_errors(prediction, sample, known(sample))
    assert errors.flagged
    assert errors.nonfinite == 1
    assert errors.value("bad-5.0") == 100.0
    assert errors.value("epe") == math.inf
    assert not image_errors(PREDICTION, sample, known(sample)).flagged


@pytest.mark.parametrize("truth", [np.nan, np.inf, 0.0, -1.0])
def test_nothing_valid_is_an_error(truth: float) -> None:
    with pytest.raises(InputError, match=r"bad-1\.0: found no valid pixel"):
        bad(PREDICTION, np.full_like(TRUTH, truth), 1)


def test_empty_arrays_are_errors() -> None:
    with pytest.raises(InputError, match="epe: found no valid pixel"):
        epe(np.zeros((0, 4)), np.zeros((0, 4)))


def test_shapes_must_agree() -> None:
    with pytest.raises(InputError, match=r"prediction: found shape \(1, 6\), expected \(1, 7\)"):
        epe(PREDICTION[:, :6], TRUTH)
    sample = make_sample(TRUTH)
    with pytest.raises(InputError, match=r"prediction for 'a': found shape \(1, 1, 7\)"):
        image_errors(PREDICTION[None], sample, known(sample))
    with pytest.raises(InputError, match="valid mask for 'a'"):
        image_errors(PREDICTION, sample, known(sample)[0])


def test_record_agrees_with_the_functions() -> None:
    sample = make_sample(TRUTH)
    errors = image_errors(PREDICTION, sample, known(sample))
    assert errors.pixels == 6
    assert errors.value("epe") == epe(PREDICTION, TRUTH)
    assert errors.value("d1") == d1(PREDICTION, TRUTH)
    for threshold in THRESHOLDS:
        assert errors.value(f"bad-{threshold}") == bad(PREDICTION, TRUTH, threshold)
    assert (errors.above(3.0), errors.region("all").d1) == (3, 2)


def test_thresholds_of_ones_own() -> None:
    sample = make_sample(TRUTH)
    errors = image_errors(
        PREDICTION, sample, known(sample), thresholds=thresholds_for("bad-20", "epe", "bad1")
    )
    assert errors.thresholds == (*THRESHOLDS, 20.0)
    assert errors.value("bad-20") == 100 / 6
    with pytest.raises(
        InputError, match=r"'a': bad-0.7 was not recorded, found .*thresholds_for\('bad-0.7'\)"
    ):
        errors.value("bad-0.7")


def test_regions() -> None:
    truth = np.full((40, 50), 10, np.float32)
    truth[:, 0] = np.nan
    visible = np.ones((40, 50), bool)
    visible[:20] = False
    sample = make_sample(truth, visible)
    prediction = np.where(visible, 10, 12).astype(np.float32)
    prediction[20, 25] = 30  # visible, but inside; the edge is 16 px wide
    errors = image_errors(prediction, sample, known(sample))
    assert errors.value("epe", "visible") == 20 / (20 * 49)
    assert errors.value("epe", "occluded") == 2
    assert errors.value("bad-1.0", "occluded") == 100
    assert errors.regions["edge"].pixels == 40 * 49 - 8 * 18
    assert errors.value("bad-5.0", "edge") == 0
    assert errors.value("bad-5.0") > 0


def test_regions_the_data_cannot_tell() -> None:
    sample = make_sample(TRUTH)
    errors = image_errors(PREDICTION, sample, known(sample))
    with pytest.raises(InputError, match="region 'visible' was not recorded, it needs an occlusion mask"):
        errors.value("epe", "visible")
    with pytest.raises(
        InputError, match="unknown region 'border', expected one of: all, edge, occluded, visible"
    ):
        errors.value("epe", "border")
    everywhere = replace(sample, nonoccluded=np.ones((1, 7), bool))
    with pytest.raises(InputError, match="'a': found no valid pixel in region 'occluded'"):
        image_errors(PREDICTION, everywhere, known(sample)).value("epe", "occluded")


@pytest.mark.parametrize(("size", "inside"), [((40, 50), 8 * 18), ((32, 50), 0), ((3, 4), 0), ((33, 33), 1)])
def test_edge_mask(size: tuple[int, int], inside: int) -> None:
    mask = edge_mask(size)
    assert np.count_nonzero(~mask) == inside
    distance = np.minimum(
        *np.meshgrid(*(np.minimum(np.arange(n), n - 1 - np.arange(n)) for n in size), indexing="ij")
    )
    np.testing.assert_array_equal(mask, distance < EDGE_PIXELS)


def test_unknown_truth_never_counts() -> None:
    sample = make_sample(np.array([[5, 0, -1, np.nan, np.inf]], np.float32))
    errors = image_errors(np.full((1, 5), 5.0, np.float32), sample, np.ones((1, 5), bool))
    assert errors.pixels == 1


@given(
    hnp.arrays(np.float32, (3, 4), elements=st.floats(0, 200, width=32)),
    hnp.arrays(np.float32, (3, 4), elements=st.floats(1, 200, width=32)),
    hnp.arrays(np.bool_, (3, 4)),
)
def test_visible_and_occluded_add_up_to_all(
    prediction: NDArray[np.float32], truth: NDArray[np.float32], visible: NDArray[np.bool_]
) -> None:
    errors = image_errors(prediction, make_sample(truth, visible), np.ones((3, 4), bool))
    whole, parts = errors.regions["all"], [errors.regions[name] for name in ("visible", "occluded")]
    assert whole.pixels == sum(p.pixels for p in parts)
    assert whole.d1 == sum(p.d1 for p in parts)
    assert whole.above == tuple(map(sum, zip(*(p.above for p in parts), strict=True)))
    assert whole.sum_abs == pytest.approx(sum(p.sum_abs for p in parts))
    assert list(whole.above) == sorted(whole.above, reverse=True)
    off = np.abs(prediction.astype(np.float64) - truth)
    assert whole.d1 == np.count_nonzero((off > 3) & (off > 0.05 * truth.astype(np.float64)))


@given(
    hnp.arrays(np.float32, (2, 5), elements=st.floats(-5, 200, width=32) | st.just(np.nan)),
    hnp.arrays(np.float32, (2, 5), elements=st.floats(-5, 200, width=32) | st.just(np.nan)),
    st.booleans(),
)
def test_json_round_trip(prediction: NDArray[np.float32], truth: NDArray[np.float32], masked: bool) -> None:
    sample = make_sample(truth, np.ones((2, 5), bool) if masked else None)
    errors = image_errors(prediction, sample, known(sample))
    text = json.dumps(errors.to_dict(), allow_nan=False)
    assert ImageErrors.from_dict(json.loads(text)) == errors


@pytest.mark.parametrize(
    "damage", [{"thresholds": None}, {"regions": []}, {"thresholds": [1.0]}, {"nonfinite": "many"}]
)
def test_damaged_records_are_refused(damage: dict[str, object]) -> None:
    sample = make_sample(TRUTH)
    record = image_errors(PREDICTION, sample, known(sample)).to_dict()
    with pytest.raises(InputError, match=r"expected what ImageErrors\.to_dict wrote"):
        ImageErrors.from_dict({**record, **damage})


def test_metric_names() -> None:
    spellings = ("bad-1.0", "bad1", "bad-1", "BAD_1", " bad 1.0 ", "bad1.00")
    assert {Metric.parse(text) for text in spellings} == {Metric.parse("bad-1.0")}
    assert [Metric.parse(t).name for t in ("bad1", "bad-0.25", "D1", "epe")] == [
        "bad-1.0",
        "bad-0.25",
        "d1",
        "epe",
    ]
    assert [Metric.parse(t).unit for t in ("bad1", "d1", "epe")] == ["%", "%", "px"]
    assert str(Metric.parse("bad2")) == "bad-2.0"
    for name in ("bad-1.5", "d1", "epe"):
        assert copy.deepcopy(Metric.parse(name)) == Metric.parse(name)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("rmse", "unknown metric 'rmse', expected epe, d1, .*or bad-T with T in pixels$"),
        ("eps", "unknown metric 'eps'.*did you mean 'epe'"),
        ("bad-1.o", "unknown metric 'bad-1.o'.*did you mean 'bad-1.0'"),
        ("bad", "unknown metric 'bad'"),
        ("bad--1", "unknown metric"),
        ("bad-0", "found the threshold 0, expected more than 0 pixels"),
    ],
)
def test_unknown_metrics(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        Metric.parse(text)


@given(st.floats(min_value=1e-3, max_value=1e3))
def test_a_metric_parses_its_own_name(threshold: float) -> None:
    text = f"{threshold:.6f}".rstrip("0")
    metric = Metric.parse(f"bad-{text}0")
    assert Metric.parse(metric.name) == metric
