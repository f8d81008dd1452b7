"""Disparity and error maps of several recipes on one pair, for figures to draw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from sfkit.analysis.pair_maps import ERROR_MAP, RESIDUAL_MAP, Comparand, Map, MapKind
from sfkit.colours import REACH, is_sparse
from sfkit.datasets.benchmark import Benchmark
from sfkit.datasets.metric import Metric
from sfkit.errors import InputError
from sfkit.evaluation.compute import HERE, Compute
from sfkit.evaluation.engines import Worker
from sfkit.evaluation.metrics import Quantities
from sfkit.evaluation.prediction import predict
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.evaluation.stereo_model import StereoModel
from sfkit.merging.live import LiveModel
from sfkit.merging.network import LoadedNetwork
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe

PAIRS_KEPT = 4
"""Pairs whose maps a comparison keeps, so that going back to one costs nothing."""


@dataclass(frozen=True, eq=False)
class NetworkMaps:
    """One network on the pair.

    Attributes:
        name: for the panel's title.
        disparity: (H, W) float32 prediction in pixels; may hold values that are not finite.
        error: (H, W) float32 |prediction - ground truth| in pixels, NaN where the protocol counts no
            pixel, ``inf`` where the prediction is not finite. Of a pair without ground truth the census
            residual in percent, NaN where the match lies outside of the right image.
        scores: metric -> score on this pair.
    """

    name: str
    disparity: Map
    error: Map
    scores: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class DisparityPanels:
    """What a disparity figure draws.

    Attributes:
        benchmark: its name and protocol, for the title.
        protocol: which pixels count.
        pair: the pair's id.
        left: (H, W, 3) RGB uint8.
        truth: (H, W) float32 pixels, NaN where there is no ground truth that counts.
        networks: the maps, in the order of the recipes.
        limits: lowest and highest disparity of the shared colour range, in pixels.
        threshold: where an error map changes colour, in the unit of its kind; see
            :func:`~sfkit.analysis.pair_maps.map_threshold`.
        right: (H, W, 3) RGB uint8 of a pair without ground truth; None where there is some.
    """

    benchmark: str
    protocol: str
    pair: str
    left: NDArray[np.uint8]
    truth: Map
    networks: tuple[NetworkMaps, ...]
    limits: tuple[float, float]
    threshold: float
    right: NDArray[np.uint8] | None = None

    @property
    def kind(self) -> MapKind:
        """What the networks' ``error`` maps hold."""
        return ERROR_MAP if self.right is None else RESIDUAL_MAP

    @property
    def hatched(self) -> str:
        """What hatched pixels of an error map lack, and whether values are painted wider than they are."""
        sparse = self.right is None and is_sparse(np.isfinite(self.truth))
        return f"{self.kind.missing}{f'; sparse values reach {REACH} px' if sparse else ''}"


Network = Recipe | LoadedNetwork | StereoModel
"""What can be compared: a recipe of the pool, or a network of its own (:func:`sfkit.load`)."""


class Comparison:
    """Several networks on the pairs of one benchmark; each pair is loaded and run when it is asked for.

    Args:
        pool: the recipes' pool.
        networks: panel name -> recipe of the pool, or loaded network; at least one.
        benchmark: gives pairs, protocol and metric.
        metrics: scores to show, of pairs without ground truth those that need none; the benchmark's own
            unless given.
        compute: where and how recipes run, in this process; a loaded network runs where it is.

    Raises:
        InputError: no network, a recipe that does not suit the pool, or an unknown metric.
    """

    def __init__(
        self,
        pool: Pool,
        networks: Mapping[str, Network],
        benchmark: Benchmark,
        *,
        metrics: Sequence[str] = (),
        compute: Compute = HERE,
    ) -> None:
        if not networks:
            raise InputError("recipes: found none, expected name -> recipe of at least one network to show")
        for network in networks.values():
            if isinstance(network, Recipe):
                # Refuses what does not suit the pool before any network runs.
                pool.canonical(network)
        self.pool, self.networks, self.benchmark, self.compute = pool, dict(networks), benchmark, compute
        self.metrics = benchmark.measurable(metrics) or (Metric.parse(benchmark.metric),)
        self._kept: dict[str, DisparityPanels] = {}

    @property
    def pairs(self) -> tuple[str, ...]:
        """The ids of the benchmark's pairs."""
        return self.benchmark.ids

    def panels(self, pair: str | None = None) -> DisparityPanels:
        """The maps of one pair, the first unless given; those of the last few pairs are kept.

        Raises:
            InputError: an unknown pair, or one that cannot be scored.
        """
        name = pair or self.pairs[0]
        # Put back behind the others: what was looked at longest ago goes first.
        found = self._kept.pop(name, None) or self._run(name)
        self._kept = {**dict(list(self._kept.items())[-(PAIRS_KEPT - 1) :]), name: found}
        return found

    @cached_property
    def _model(self) -> LiveModel:
        return self.compute.model(self.pool)

    def _run(self, pair: str) -> DisparityPanels:
        one = self.benchmark.select([pair])
        inputs = self.pool.architecture.inputs(self.pool.options)
        prepared = PreparedBenchmark(one, inputs, Quantities.of(*self.metrics))
        found = {name: self._disparity(network, prepared) for name, network in self.networks.items()}
        return panels_of(prepared, found, self.metrics)

    def _disparity(self, network: Network, prepared: PreparedBenchmark) -> Map:
        sample = prepared.samples[0]
        if isinstance(network, StereoModel):
            return network(sample.left, sample.right)
        if isinstance(network, LoadedNetwork):
            return predict(network, sample.left, sample.right)
        self._model.apply(network)
        return Worker(self._model, prepared).predict(0)


def panels_of(
    prepared: PreparedBenchmark, disparities: Mapping[str, Map], metrics: Sequence[Metric]
) -> DisparityPanels:
    """The maps of a benchmark's only pair.

    Args:
        prepared: of that pair.
        disparities: panel name -> prediction (H, W) in pixels.
        metrics: scores to show.
    """
    sample, benchmark = prepared.samples[0], prepared.benchmark
    comparand = Comparand.of(sample, prepared.truth(0), *metrics)
    maps: list[NetworkMaps] = []
    for name, disparity in disparities.items():
        record = prepared.errors(0, disparity)
        scores = {metric.name: record.value(metric) for metric in metrics}
        maps.append(NetworkMaps(name, disparity, comparand.map(disparity), scores))
    return DisparityPanels(
        benchmark=benchmark.name,
        protocol=benchmark.protocol,
        pair=sample.id,
        left=sample.left,
        truth=comparand.truth,
        networks=tuple(maps),
        # Without ground truth all networks together set the one range.
        limits=comparand.limits(np.stack([one.disparity for one in maps])),
        threshold=comparand.threshold,
        right=None if comparand.labelled else sample.right,
    )


def disparity_panels(
    pool: Pool,
    recipes: Mapping[str, Network],
    benchmark: Benchmark,
    *,
    pair: str | None = None,
    metrics: Sequence[str] = (),
    compute: Compute = HERE,
) -> DisparityPanels:
    """Run recipes on one pair of a benchmark.

    Args:
        pool: the recipes' pool.
        recipes: panel name -> recipe or loaded network, at least one.
        benchmark: gives pair, protocol and metric.
        pair: an id; the first pair unless given.
        metrics: scores to show; the benchmark's own unless given.
        compute: where and how recipes run, in this process.

    Raises:
        InputError: no recipe, an unknown pair or metric, or a pair that cannot be scored.
    """
    return Comparison(pool, recipes, benchmark, metrics=metrics, compute=compute).panels(pair)
