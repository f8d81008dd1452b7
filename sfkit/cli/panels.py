"""The groups of options that commands share; what a record's field says of itself is not said here."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from sfkit.cli.foreseen import ensure_benchmark
from sfkit.cli.groups import Group, names
from sfkit.evaluation.compute import PARAMETERS, PASSES, Compute, check_device
from sfkit.search import (
    BayesianRoutingSettings,
    BayesianSubsetSettings,
    Constraints,
    RoutingSettings,
    SubsetSettings,
)
from sfkit.settings import setting

if TYPE_CHECKING:
    from sfkit.datasets.benchmark import Benchmark


@dataclass(frozen=True, kw_only=True)
class FolderChoice:
    """Where stereo pairs are, and how they are read."""

    root: Path | None = setting(None, "--root", "-r", help="The benchmark's folder.")
    resolution: str | None = setting(None, help="Middlebury: F, H or Q.")
    csv: Path | None = setting(
        None,
        help="For pairs: a CSV with left,right,disparity[,mask][,coding][,id].",
    )
    coding: str | None = setting(
        None, help="For pairs: how ground truth is coded, such as pfm, png16 or png8:4."
    )
    every: int | None = setting(None, help="For unlabelled video: keep every so many pairs of each folder.")


@dataclass(frozen=True, kw_only=True)
class BenchmarkChoice(FolderChoice):
    """Which benchmark a command evaluates on, and what it measures there."""

    benchmark: str = setting(
        *(..., "--benchmark", "-b"),
        help="eth3d, kitti2012, kitti2015, middlebury, pairs, unlabelled, bank:NAME.",
    )
    protocol: str | None = setting(None, help="openstereo, raft, igev, nmrf or all-valid.")
    metric: str | None = setting(
        None, help="bad-1.0 (any threshold in pixels), d1, epe, or census (no labels)."
    )

    def open(self) -> Benchmark:
        """The benchmark, its files found and not yet read.

        Raises:
            InputError: as :func:`sfkit.datasets.open_benchmark`, or where no folder is named; the embedded
                bank's benchmarks (``bank:NAME``) have none.
        """
        # The folder of a table is the root of its paths.
        root = self.csv.parent if self.root is None and self.csv is not None else self.root
        ensure_benchmark(self.benchmark, root, protocol=self.protocol, metric=self.metric)
        from sfkit.datasets.benchmark import open_benchmark

        benchmark = open_benchmark(
            self.benchmark,
            root,
            protocol=self.protocol,
            metric=self.metric,
            resolution=self.resolution,
            table=self.csv,
            coding=self.coding,
            every=self.every,
        )
        benchmark.ensure_scorable()
        return benchmark

    def open_by_several(self) -> tuple[Benchmark, tuple[str, ...]]:
        """The benchmark by the first of ``--metric A,B``, and all of these.

        Raises:
            InputError: as :meth:`open`, or pairs cannot be measured by one of them.
        """
        metrics = names(self.metric or "")
        benchmark = replace(self, metric=metrics[0] if metrics else self.metric).open()
        benchmark.ensure_measurable(metrics)
        return benchmark, metrics


@dataclass(frozen=True)
class Guidance:
    """What guides a search beside the benchmark."""

    also: list[str] | None = setting(
        None, help="Validate on a further benchmark, NAME,root=FOLDER,protocol=...; or several."
    )
    combine: str = setting("mean", help="With --also: guided by the mean or the worst of them.")


def _benchmark_or_none(**values: Any) -> BenchmarkChoice | None:
    return None if values["benchmark"] is None else BenchmarkChoice(**values)


def _compute(**values: Any) -> Compute:
    # Here, where the sentence can name the option.
    check_device(values["device"], "--device")
    return Compute(**values)


def _routing(**values: Any) -> RoutingSettings:
    # A rank is for blocks that are not tied.
    return RoutingSettings(**{**values, "tied": values["tied"] and values["rank"] is None})


def _added(model: type[Any], paper: type[Any]) -> tuple[str, ...]:
    """The settings that a model has and the paper's search of that stage has not."""
    before = {entry.name for entry in fields(paper)}
    return tuple(entry.name for entry in fields(model) if entry.name not in before)


_ROOT = {"csv": "Its folder is the root."}
FolderOptions = Annotated[FolderChoice, Group(FolderChoice, "Folder", notes=_ROOT)]
_BENCHMARK = Group(BenchmarkChoice, "Benchmark", notes=_ROOT)
BenchmarkOptions = Annotated[BenchmarkChoice, _BENCHMARK]
OptionalBenchmarkOptions = Annotated[
    BenchmarkChoice | None,
    replace(_BENCHMARK, make=_benchmark_or_none, defaults={"benchmark": None}),
]
GuidanceOptions = Annotated[Guidance, Group(Guidance, "Benchmark")]
_COMPUTE = Group(Compute, "Where networks run", make=_compute, defaults={"engine": "auto"})
ComputeOptions = Annotated[Compute, _COMPUTE]
DeviceOptions = Annotated[Compute, replace(_COMPUTE, only=("device",), defaults={})]
PassOptions = Annotated[Compute, replace(_COMPUTE, only=PASSES, defaults={})]
InlineOptions = Annotated[Compute, replace(_COMPUTE, defaults={})]
NotebookComputeOptions = Annotated[Compute, replace(_COMPUTE, only=PARAMETERS)]
# What was said alone: the method chooses the rest, and refuses what it would not use.
STAGE1 = Group(
    SubsetSettings,
    "Stage 1: which sources",
    make=dict,
    defaults={"population": None, "generations": None},
    notes={
        "population": "50, by bayesian 8.",
        "generations": "15, by bayesian 41 / batch and at least 3.",
        **dict.fromkeys(BayesianSubsetSettings.UNUSED, "Only by paper."),
    },
    said=True,
)
STAGE2 = Group(
    RoutingSettings,
    "Stage 2: how",
    make=dict,
    defaults={"evaluations": None},
    notes={
        "evaluations": "300, by bayesian 80.",
        "sigma": "By bayesian the first radius of the region.",
        **dict.fromkeys(("holdout", *BayesianRoutingSettings.UNUSED), "Only by paper."),
    },
    said=True,
)
MODEL1, MODEL2 = (
    Group(model, "Only by bayesian: the model", make=dict, only=_added(model, paper), notes=notes, said=True)
    for model, paper, notes in (
        (BayesianSubsetSettings, SubsetSettings, {"beta": "Stage 1."}),
        (BayesianRoutingSettings, RoutingSettings, {"beta": "Stage 2."}),
    )
)
Stage1Options = Annotated[dict[str, Any], STAGE1]
Stage2Options = Annotated[dict[str, Any], STAGE2]
Model1Options = Annotated[dict[str, Any], MODEL1]
Model2Options = Annotated[dict[str, Any], MODEL2]
ConstraintOptions = Annotated[Constraints, Group(Constraints, "Limits of both stages")]

Stage1Settings = Annotated[SubsetSettings, Group(SubsetSettings, "Stage 1, as a method")]
# Of both stages alone: a method starts where Stage 1 ended, and leaving Stage 2 out is a method of its own.
Stage2Settings = Annotated[
    RoutingSettings,
    Group(
        RoutingSettings,
        "Stage 2, as a method",
        make=_routing,
        only=tuple(entry.name for entry in fields(RoutingSettings) if entry.name != "floor"),
    ),
]
