"""Networks from their files, held against each other on one benchmark: no pool, no common base, no store."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

from sfkit.analysis.disparities import DisparityPanels, panels_of
from sfkit.analysis.measured import Measured
from sfkit.datasets.benchmark import Benchmark
from sfkit.datasets.metric import Metric
from sfkit.errors import InputError
from sfkit.evaluation.metrics import ImageErrors, Quantities
from sfkit.evaluation.prediction_files import predict_checked
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.evaluation.stereo_model import StereoModel


def measure_networks(
    models: Mapping[str, StereoModel],
    benchmark: Benchmark,
    *,
    metrics: Sequence[str] = (),
    progress: Callable[[int, int], None] | None = None,
    look: Callable[[DisparityPanels], None] | None = None,
) -> Measured:
    """Measure networks that are ready to run on every pair of a benchmark, one pair in memory at a time.

    Args:
        models: name -> network, from :func:`sfkit.load`; of one architecture or of several.
        benchmark: gives pairs, protocol and metric.
        metrics: what will be asked of the result; the benchmark's own unless given, of pairs without ground
            truth those that need none.
        progress: told how many pairs are done, and of how many.
        look: shown the maps of each pair.

    Raises:
        InputError: no network, an unknown metric, or a pair that cannot be scored.
        SfkitError: a network failed on a pair.
    """
    if not models:
        raise InputError("models: found none, expected name -> network of at least one")
    benchmark.ensure_scorable()
    wanted = benchmark.measurable(metrics) or (Metric.parse(benchmark.metric),)
    inputs = next(iter(models.values())).loaded.inputs  # of no matter here: each model prepares its own
    images: dict[str, list[ImageErrors]] = {name: [] for name in models}
    for number, pair in enumerate(benchmark.ids):
        if progress is not None:
            progress(number, len(benchmark))
        prepared = PreparedBenchmark(benchmark.select([pair]), inputs, Quantities.of(*wanted))
        sample = prepared.samples[0]
        maps = {}
        for name, model in models.items():
            where = f"{name} on {pair}"
            maps[name], _ = predict_checked(model.loaded, sample.left, sample.right, where, check=False)
        for name, disparity in maps.items():
            images[name].append(prepared.errors(0, disparity))
        if look is not None:
            look(panels_of(prepared, maps, wanted))
    if progress is not None:
        progress(len(benchmark), len(benchmark))
    return Measured(
        benchmark=benchmark.name,
        protocol=benchmark.protocol,
        family=benchmark.family,
        metric=wanted[0].name,
        validation=False,
        images={name: tuple(errors) for name, errors in images.items()},
    )
