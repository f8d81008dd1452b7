"""Errors by region: where both views see, where one is occluded, at the image's edge, without texture.

The first three are kept with every evaluation. Textureless pixels are those whose squared horizontal
intensity gradient, averaged over a 3 x 3 window, is below 4 grey levels squared (Scharstein and Szeliski,
IJCV 2002, section 5.1); they are measured on demand, under keys of their own, from fresh predictions.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from sfkit.analysis.scores import ScoreColumn, ScoreGrid
from sfkit.datasets.metric import Metric
from sfkit.errors import InputError
from sfkit.evaluation.engines import Worker
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.metrics import REGIONS, ImageErrors, image_errors
from sfkit.evaluation.store import Evaluation, evaluation_key
from sfkit.merging.live import LiveModel
from sfkit.merging.recipe import Recipe

TEXTURELESS = "textureless"
WINDOW = 3
LIMIT = 4.0
"""Squared grey levels of 0 to 255: Scharstein and Szeliski's defaults."""


@dataclass(frozen=True, eq=False)
class RegionScores:
    """Networks by region of one benchmark's images.

    Attributes:
        benchmark: its name.
        protocol: which pixels count at all.
        metric: such as ``bad-1.0``.
        networks: N names.
        regions: R names, ``all`` first; regions the data cannot tell apart are absent.
        shares: (R,) percent of the pixels that count, or of those with ground truth for visible and
            occluded ones, that lie in each region.
        values: (N, R) lower is better; NaN where the network failed or a region has no pixel.
    """

    benchmark: str
    protocol: str
    metric: str
    networks: tuple[str, ...]
    regions: tuple[str, ...]
    shares: NDArray[np.float64]
    values: NDArray[np.float64]

    def grid(self) -> ScoreGrid:
        """A column a region, for :func:`sfkit.figures.scores_figure`."""
        unit = Metric.parse(self.metric).unit
        shares = [f"{share:.1f}" if share >= 1.0 else f"{share:.1g}" for share in self.shares]
        labels = [f"{r}, {share} % of pixels" for r, share in zip(self.regions, shares, strict=True)]
        columns = tuple(ScoreColumn(label, self.metric, unit, validation=False) for label in labels)
        return ScoreGrid(self.networks, columns, self.values)


def textureless_mask(
    image: NDArray[np.uint8], *, window: int = WINDOW, limit: float = LIMIT
) -> NDArray[np.bool_]:
    """(H, W) bool: True where an RGB image (H, W, 3) has no horizontal texture to match by.

    The squared difference to the right neighbour, averaged over ``window`` x ``window`` pixels and the three
    channels, is below ``limit`` (grey levels squared, of 0 to 255). Edges are replicated.
    """
    # Appended: the last column has no right neighbour, and differs by 0.
    difference = np.diff(image.astype(np.float32), axis=1, append=image[:, -1:].astype(np.float32))
    squared = np.square(difference).mean(axis=2)
    return np.asarray(cv2.blur(squared, (window, window), borderType=cv2.BORDER_REPLICATE) < limit)


def region_scores(
    evaluator: Evaluator,
    recipes: Mapping[str, Recipe],
    *,
    metric: str | None = None,
    textureless: bool = True,
) -> RegionScores:
    """Score networks region by region.

    Args:
        evaluator: of the benchmark; its store keeps what is computed.
        recipes: network name -> recipe.
        metric: the evaluator's unless given.
        textureless: whether to measure textureless pixels, which runs each network once more the first time.

    Raises:
        InputError: no recipe, or a metric that was not recorded or is none of regions, such as ``census``.
    """
    if not recipes:
        raise InputError("regions: found no recipe, expected name -> recipe of at least one network")
    parsed = Metric.parse(metric) if metric else evaluator.metric
    if parsed.counts is None:
        raise InputError(
            f"regions: found the metric {parsed}, which is counted over whole images, expected one of errors "
            "such as bad-3.0, on pairs with ground truth"
        )
    evaluations = evaluator.evaluate(list(recipes.values()))
    # Its network would lie in memory beside the one that is made below.
    evaluator.release()
    by_region = {region: [_images(e, region) for e in evaluations] for region in REGIONS}
    # Regions that the data cannot tell apart have no image.
    found = {region: each for region, each in by_region.items() if any(each)}
    if textureless:
        model = evaluator.compute.model(evaluator.pool)
        worker = Worker(model, evaluator.prepared)
        found[TEXTURELESS] = [
            _textureless(evaluator, recipe, worker, model) if not evaluation.failure else ()
            for recipe, evaluation in zip(recipes.values(), evaluations, strict=True)
        ]
    values = [
        [_value(evaluator, images, region, parsed) for images in each] for region, each in found.items()
    ]
    return RegionScores(
        benchmark=evaluator.benchmark.name,
        protocol=evaluator.benchmark.protocol,
        metric=parsed.name,
        networks=tuple(recipes),
        regions=tuple(found),
        shares=_shares(found),
        values=np.array(values).T,
    )


def _images(evaluation: Evaluation, region: str) -> tuple[ImageErrors, ...]:
    return tuple(image for image in evaluation.images if region in image.regions)


def _textureless(
    evaluator: Evaluator, recipe: Recipe, worker: Worker, model: LiveModel
) -> tuple[ImageErrors, ...]:
    """Errors over textureless pixels alone, which stand under ``all``; from the store where it has them."""
    # A key of its own, with window and limit: by others it is another measurement.
    description = {**evaluator.describe(recipe), "only": f"{TEXTURELESS} {WINDOW} {LIMIT:g}"}
    key = evaluation_key(description)
    held = evaluator.store.get(key)
    if held is None:
        started = time.perf_counter()
        model.apply(recipe)
        prepared, images = evaluator.prepared, []
        for number, sample in enumerate(prepared.samples):
            mask = prepared.valid[number] & textureless_mask(sample.left)
            thresholds = evaluator.quantities.thresholds
            images.append(image_errors(worker.predict(number), sample, mask, thresholds=thresholds))
        seconds = time.perf_counter() - started
        held = evaluator.store.put(Evaluation(key, description, tuple(images), None, seconds))
    return held.images


def _value(evaluator: Evaluator, images: Sequence[ImageErrors], region: str, metric: Metric) -> float:
    stored = "all" if region == TEXTURELESS else region
    counted = [image for image in images if image.region(stored).pixels]
    if not counted:
        return float("nan")
    return evaluator.benchmark.rule.aggregate(counted, metric, region=stored)


def _shares(found: Mapping[str, Sequence[Sequence[ImageErrors]]]) -> NDArray[np.float64]:
    """Percent of pixels by region, by the first network that did not fail."""
    count = {}
    for region, each in found.items():
        images = next((images for images in each if images), ())
        stored = "all" if region == TEXTURELESS else region
        count[region] = sum(image.region(stored).pixels for image in images)
    # Where no mask tells them apart neither is counted; of what is told apart both make up the whole.
    split = count.get("visible", 0) + count.get("occluded", 0)
    whole = {region: split if region in ("visible", "occluded") else count["all"] for region in count}
    return np.array([100.0 * count[region] / whole[region] if whole[region] else 0.0 for region in count])
