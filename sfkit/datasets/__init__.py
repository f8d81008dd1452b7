"""Stereo pairs with ground truth: file formats, public data sets, benchmarks, and checks of the data."""

from typing import TYPE_CHECKING

from sfkit.on_demand import on_demand

if TYPE_CHECKING:
    from sfkit.datasets.benchmark import memory_benchmark, open_benchmark, open_benchmarks
    from sfkit.datasets.benchmark_record import Benchmark
    from sfkit.datasets.check import DataReport, check_data
    from sfkit.datasets.formats import (
        read_disparity,
        read_image,
        read_pfm,
        write_disparity_png16,
        write_pfm,
    )
    from sfkit.datasets.manifests import Manifest, load_manifest, manifest_names
    from sfkit.datasets.metric import Metric, register_metric
    from sfkit.datasets.pairs import MemoryPair, Pair, Sample, StereoPair
else:
    __getattr__, __dir__ = on_demand(__name__)

__all__ = [
    "Benchmark",
    "DataReport",
    "Manifest",
    "MemoryPair",
    "Metric",
    "Pair",
    "Sample",
    "StereoPair",
    "check_data",
    "load_manifest",
    "manifest_names",
    "memory_benchmark",
    "open_benchmark",
    "open_benchmarks",
    "read_disparity",
    "read_image",
    "read_pfm",
    "register_metric",
    "write_disparity_png16",
    "write_pfm",
]
