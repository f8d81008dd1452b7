"""Networks from their files, held against each other on one benchmark: no pool, no common base, no store."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from sfkit.analysis.disparities import DisparityPanels, panels_of
from sfkit.analysis.measured import Measured
from sfkit.checkpoints.spec import Member, PoolSpec
from sfkit.datasets.benchmark import Benchmark
from sfkit.datasets.metric import Metric
from sfkit.errors import InputError, SfkitError
from sfkit.evaluation.compute import HERE, Compute
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.metrics import ImageErrors, Quantities
from sfkit.evaluation.prediction_files import predict_checked
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.evaluation.stereo_model import StereoModel, load
from sfkit.merging.opening import open_pool


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
        # Pair by pair: the maps of all pairs at once would fill the memory.
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
    return _measured(benchmark, wanted[0], {name: tuple(errors) for name, errors in images.items()})


def measure_files(
    files: Mapping[str, Path],
    benchmark: Benchmark,
    *,
    metrics: Sequence[str] = (),
    architecture: str | None = None,
    options: Mapping[str, Any] | None = None,
    compute: Compute = HERE,
    progress: Callable[[int, int], None] | None = None,
    look: Callable[[DisparityPanels], None] | None = None,
) -> Measured:
    """As :func:`measure_networks`, of networks by their files, where and how ``compute`` says.

    Workers elsewhere share the pairs of one network after the other; ``progress`` is told after each then.

    Args:
        files: name -> what sfkit merged, or a checkpoint.
        benchmark: gives pairs, protocol and metric.
        metrics: as there.
        architecture: for files that do not say it.
        options: the architecture's; those in a file are the default.
        compute: where and how networks run.
        progress: as there.
        look: as there, which the inline engine alone can.

    Raises:
        InputError: as there and as :func:`sfkit.load`, or maps are asked for of workers.
        SfkitError: a network failed on a pair.
    """
    known: dict[str, Any] = {"architecture": architecture, "options": options}
    if compute.engine == "inline":
        models = {name: load(file, **compute.passes, **known) for name, file in files.items()}
        return measure_networks(models, benchmark, metrics=metrics, progress=progress, look=look)
    if look is not None:
        raise InputError(f"look: found engine {compute.engine!r}, expected 'inline', which sees the maps")
    benchmark.ensure_scorable()
    wanted = benchmark.measurable(metrics) or (Metric.parse(benchmark.metric),)
    images: dict[str, tuple[ImageErrors, ...]] = {}
    for number, (name, file) in enumerate(files.items(), 1):
        # Loaded for what it says of itself: workers read the file again.
        loaded = load(file, **known).loaded
        # A pool of a base alone: its merge is the file's own values, to the last bit.
        spec = PoolSpec(name, loaded.name, Member(name, file.absolute()), (), loaded.options)
        also = [metric.name for metric in wanted]
        with Evaluator(
            open_pool(spec), benchmark, metric=also[0], also=also[1:], compute=compute
        ) as evaluator:
            (found,) = evaluator.evaluate([evaluator.pool.base_recipe()])
        if found.failure:
            raise SfkitError(f"{name} on {benchmark.name}: the network failed ({found.failure})")
        images[name] = found.images
        if progress is not None:
            progress(number * len(benchmark), len(files) * len(benchmark))
    return _measured(benchmark, wanted[0], images)


def _measured(
    benchmark: Benchmark, metric: Metric, images: Mapping[str, tuple[ImageErrors, ...]]
) -> Measured:
    return Measured(
        benchmark=benchmark.name,
        protocol=benchmark.protocol,
        family=benchmark.family,
        metric=metric.name,
        validation=False,
        images=images,
    )
