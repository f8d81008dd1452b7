"""Maps of what is wrong on a pair: by ground truth, and by the images of a pair without any."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from tiny import write_pairs, write_pool

from sfkit.analysis import advantage_panels, disparity_panels
from sfkit.analysis.pair_maps import ERROR_MAP, RESIDUAL_MAP, RESIDUAL_THRESHOLD, Comparand
from sfkit.datasets.benchmark import open_benchmark
from sfkit.datasets.metric import Metric
from sfkit.datasets.pairs import Sample
from sfkit.evaluation import Evaluator
from sfkit.figures import advantage_figure, disparity_figure
from sfkit.merging import open_pool

SHIFT = 5  # what the pairs of tiny are shifted by


@pytest.fixture(scope="module")
def sample(tmp_path_factory: pytest.TempPathFactory) -> Sample:
    return open_benchmark("pairs", write_pairs(tmp_path_factory.mktemp("pairs"))).pairs[0].load()


def unlabelled(sample: Sample) -> Comparand:
    return Comparand.of(sample, np.full(sample.size, np.nan, np.float32), Metric.parse("census"))


def test_the_right_disparity_has_no_residual_and_a_wrong_one_that_of_chance(sample: Sample) -> None:
    comparand = unlabelled(sample)
    right = comparand.map(np.full(sample.size, SHIFT, np.float32))
    wrong = comparand.map(np.full(sample.size, SHIFT + 20, np.float32))
    assert np.isnan(right[:, :SHIFT]).all()  # no match inside the right image
    inner = np.s_[8:-8, 24:-8]
    assert right[inner].max() < 4  # the coarse scale looks between pixels where the shift is odd
    assert 40 < wrong[8:-8, 40:-8].mean() < 60
    assert (comparand.kind, comparand.threshold) == (RESIDUAL_MAP, RESIDUAL_THRESHOLD)


def test_what_is_not_finite_is_as_wrong_as_can_be_under_both(sample: Sample) -> None:
    prediction = np.full(sample.size, SHIFT, np.float32)
    prediction[20, 50] = np.nan
    labelled = Comparand.of(sample, sample.disparity, Metric.parse("bad-2.0"))
    assert (labelled.kind, labelled.threshold) == (ERROR_MAP, 2.0)
    for comparand in (labelled, unlabelled(sample)):
        assert np.isinf(comparand.map(prediction)[20, 50])


def test_colours_span_the_truth_or_else_the_prediction(sample: Sample) -> None:
    prediction = np.linspace(0, 40, sample.left.shape[1], dtype=np.float32) * np.ones(sample.size, np.float32)
    labelled = Comparand.of(sample, sample.disparity, Metric.parse("epe"))
    assert labelled.limits(prediction) == (SHIFT, SHIFT + 1)
    assert unlabelled(sample).limits(prediction) == (0, 40)
    assert unlabelled(sample).limits(np.full_like(prediction, np.nan)) == (0, sample.size[1] / 4)


def test_half_the_size_finds_the_same_places_wrong(sample: Sample) -> None:
    small = unlabelled(sample).reduced(sample.left[::2, ::2].copy(), sample.right[::2, ::2].copy(), 2)
    residual = small.map(np.full((24, 48), SHIFT + 20, np.float32) / 2)
    assert 40 < np.nanmean(residual) < 60
    assert small.kind is RESIDUAL_MAP


def test_figures_of_a_pair_without_truth_show_the_right_image_and_residuals(tmp_path: Path) -> None:
    pool = open_pool(write_pool(tmp_path / "pool", sources=2))
    pairs = open_benchmark("unlabelled", write_pairs(tmp_path / "pairs", count=1))
    panels = disparity_panels(pool, {"base": pool.base_recipe(), "uniform": pool.uniform()}, pairs)
    score = Evaluator(pool, pairs).evaluate([pool.uniform()])[0].images[0].value("census")
    assert panels.networks[1].scores == {"census": score}
    texts = [note.text for note in disparity_figure(panels).layout.annotations]
    assert texts[1:2] + texts[3:4] == [
        "right image",
        f"base: residual (census {panels.networks[0].scores['census']:.2f} %)",
    ]
    figure = advantage_figure(advantage_panels(panels, "base", "uniform"))
    assert "no match inside the right image" in figure.layout.title.subtitle.text
