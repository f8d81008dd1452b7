"""Where results come from: versions, machine, checkpoints, benchmarks."""

from __future__ import annotations

import os
import platform
from importlib.metadata import PackageNotFoundError, version

import pandas as pd
import torch

from sfkit.analysis.experiment import Experiment

PACKAGES = ("sfkit", "torch", "numpy", "cma", "opencv-python-headless", "pandas", "plotly")
DIGITS = 12
"""How much of a fingerprint is shown."""


def environment(experiment: Experiment) -> pd.DataFrame:
    """One row a fact: what was used, and its version, size or fingerprint."""
    pool = experiment.pool
    facts = {name: _version(name) for name in PACKAGES}
    facts["Python"] = platform.python_version()
    facts["system"] = f"{platform.system()} {platform.machine()}"
    facts["processors"] = str(os.cpu_count())
    # Another number of threads may sum in another order.
    facts["torch threads"] = str(torch.get_num_threads())
    facts["device"] = experiment.compute.device
    facts["engine"] = experiment.scorer().engine.describe()
    facts[f"base of {pool.name}"] = pool.base.fingerprint[:DIGITS]
    facts |= {f"source {source.name}": source.fingerprint[:DIGITS] for source in pool.sources}
    for benchmark in (experiment.validation, *experiment.reported):
        about = (f"{len(benchmark)} pairs", benchmark.protocol, benchmark.fingerprint()[:DIGITS])
        facts[f"benchmark {benchmark.name}"] = ", ".join(about)
    facts["evaluations in the store"] = f"{len(experiment.store):,}"
    return pd.DataFrame({"value": facts.values()}, index=pd.Index(facts.keys(), name="what"))


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "not installed as a package"
