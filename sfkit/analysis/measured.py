"""Networks measured on one benchmark with the errors of every image, which comparisons resample."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from sfkit.datasets.benchmark import Benchmark
from sfkit.datasets.metric import Metric
from sfkit.datasets.protocols import rule
from sfkit.errors import InputError, ensure_known
from sfkit.evaluation.compute import HERE, Compute
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.metrics import ImageErrors
from sfkit.evaluation.store import EvaluationStore
from sfkit.evaluation.table import ProgressCallback
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe

Values = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Measured:
    """Networks on one benchmark, image by image.

    Attributes:
        benchmark: its name.
        protocol: which pixels count, and how images become one number.
        family: the benchmark's family, for the protocol's rule.
        metric: such as ``bad-1.0``; what :meth:`score` gives unless asked for another.
        validation: True where the benchmark guided a search, so that its scores are no test.
        images: network -> errors of every image in the benchmark's order; empty where the network failed.
    """

    benchmark: str
    protocol: str
    family: str
    metric: str
    validation: bool
    images: Mapping[str, tuple[ImageErrors, ...]]

    def __post_init__(self) -> None:
        """Check that all networks saw the same images in one order; raises InputError otherwise."""
        # A network that failed has no images, and fits any order.
        seen = {tuple(image.id for image in errors): name for name, errors in self.images.items() if errors}
        if len(seen) > 1:
            (ids, first), (others, second), *_ = seen.items()
            raise InputError(
                f"benchmark {self.benchmark!r}: found {len(ids)} images under {first!r} and {len(others)} "
                f"under {second!r}, expected the same images in one order: measure both on one benchmark"
            )

    @property
    def networks(self) -> tuple[str, ...]:
        """The names, in order."""
        return tuple(self.images)

    @property
    def unit(self) -> str:
        """Of the metric: ``%`` or ``px``."""
        return self.unit_of(None)

    def unit_of(self, metric: str | None) -> str:
        """Of a metric, the benchmark's own unless given; raises InputError for one that is unknown."""
        return Metric.parse(metric or self.metric).unit

    @property
    def ids(self) -> tuple[str, ...]:
        """The images' ids; none where every network failed."""
        return next((tuple(image.id for image in errors) for errors in self.images.values() if errors), ())

    def score(self, network: str, *, metric: str | None = None) -> float:
        """A network's score under the protocol, lower is better; NaN where it failed.

        Raises:
            InputError: an unknown network or metric, or a threshold that was not recorded.
        """
        errors = self.of(network)
        if not errors:
            return math.nan
        return rule(self.protocol, self.family).aggregate(errors, metric or self.metric)

    def of(self, network: str) -> tuple[ImageErrors, ...]:
        """A network's errors by image.

        Raises:
            InputError: no such network.
        """
        ensure_known(f"network measured on {self.benchmark!r}", network, self.images)
        return self.images[network]

    def terms(self, network: str, *, metric: str | None = None) -> tuple[Values, Values]:
        """The score as a ratio of two sums over images (:meth:`~sfkit.datasets.protocols.Rule.terms`).

        Both are empty where the network failed.

        Raises:
            InputError: as :meth:`score`.
        """
        return rule(self.protocol, self.family).terms(self.of(network), metric or self.metric)


def measure_recipes(
    pool: Pool,
    recipes: Mapping[str, Recipe],
    benchmarks: Sequence[Benchmark],
    *,
    metric: str | None = None,
    also: Sequence[str] = (),
    validation: Sequence[str] = (),
    store: EvaluationStore | None = None,
    compute: Compute = HERE,
    progress: ProgressCallback | None = None,
) -> tuple[Measured, ...]:
    """Measure named recipes on benchmarks; what the store holds is not computed again.

    All benchmarks are loaded and checked before the first evaluation.

    Args:
        pool: the recipes' pool.
        recipes: network name -> recipe.
        benchmarks: what to measure on.
        metric: of every benchmark; each one's own unless given.
        also: further metrics that will be asked of the same evaluations.
        validation: names of the benchmarks that guided a search.
        store: where evaluations are kept.
        compute: where and how networks run.
        progress: called for each evaluation when it is done.

    Raises:
        InputError: a recipe does not suit the pool, a metric is unknown, or a benchmark cannot be scored.
    """
    for recipe in recipes.values():
        pool.check_recipe(recipe)
    evaluators = [
        Evaluator(pool, benchmark, store=store, metric=metric, also=also, compute=compute)
        for benchmark in benchmarks
    ]
    return measure_with(evaluators, recipes, validation=validation, progress=progress)


def measure_with(
    evaluators: Sequence[Evaluator],
    recipes: Mapping[str, Recipe],
    *,
    validation: Sequence[str] = (),
    progress: ProgressCallback | None = None,
) -> tuple[Measured, ...]:
    """As :func:`measure_recipes`, with evaluators that are ready."""
    found = []
    for evaluator in evaluators:
        benchmark = evaluator.benchmark
        named = None if progress is None else partial(progress, benchmark.name)
        evaluations = evaluator.evaluate(list(recipes.values()), progress=named)
        evaluator.release()  # one network in memory at a time, however many benchmarks there are
        images = {name: made.images for name, made in zip(recipes, evaluations, strict=True)}
        found.append(
            Measured(
                benchmark=benchmark.name,
                protocol=benchmark.protocol,
                family=benchmark.family,
                metric=evaluator.metric.name,
                validation=benchmark.name in validation,
                images=images,
            )
        )
    return tuple(found)
