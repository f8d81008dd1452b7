"""Stereo pairs with ground truth: file formats, public data sets, benchmarks, and checks of the data."""

from typing import TYPE_CHECKING

from sfkit.on_demand import on_demand

if TYPE_CHECKING:
    from sfkit.datasets.benchmark import memory_benchmark, open_benchmark, open_benchmarks
    from sfkit.datasets.benchmark_record import Benchmark
    from sfkit.datasets.check import DataReport, check_data
    from sfkit.datasets.formats import read_disparity, read_pfm, write_disparity_png16
    from sfkit.datasets.images import read_image
    from sfkit.datasets.manifests import Manifest, load_manifest
    from sfkit.datasets.metric import Metric, register_metric
    from sfkit.datasets.pairs import MemoryPair, Pair, Sample, StereoPair
    from sfkit.datasets.pfm import write_pfm
    from sfkit.datasets.shipped import manifest_names
else:
    __getattr__, __dir__ = on_demand(__name__)
