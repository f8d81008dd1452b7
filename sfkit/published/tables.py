"""The tables of StereoFactory, transcribed number by number; ``*`` marks bold, ``_`` underlined cells.

Benchmarks bear the names they have here; KITTI columns are D1 in percent, Middlebury is bad-2.0 and ETH3D
bad-1.0, as the paper reports them. Rows that the paper's source has commented out are left out.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import pandas as pd

from sfkit.errors import unknown_name

NMRF, FOUNDATION_STEREO = "NMRF", "FoundationStereo"
BENCHMARKS = ("kitti2012", "kitti2015", "middlebury", "eth3d")
SOURCES = (
    "Sintel",
    "FallingThings",
    "VirtualKITTI2",
    "TartanAir",
    "InStereo2K",
    "UnrealStereo4K",
    "CREStereo",
    "Spring",
    "DynamicReplica",
    "Carla",
    "FoundationStereo",
)
"""The sources in the order of the paper's indices 0 to 10."""

HEURISTICS = ("feature", "RGB", "disparity")
Key = str | tuple[str, ...]
"""A row's name, or its architecture and its name."""

_SCORES = (*BENCHMARKS, "mean")
_COMBINED = tuple(f"{heuristic} to {benchmark}" for heuristic in HEURISTICS for benchmark in BENCHMARKS)

_FUSION = """
Uniform Avg.     | All       | Equal (1/N)    | Global     | Single
Task Arith.      | All       | Manual lambda  | Global     | Single
AdaMerging       | All       | Learned        | Task/Layer | Single
Model Soups      | Greedy    | Equal          | Global     | Single
Ours (Stage 1)   | EA        | Equal (1/k)    | Global     | Single
Ours (Stage 1+2) | EA+CMA-ES | Adaptive       | Module     | Single
"""

_COST = """
Joint retraining (h)             | 48.2  | 128.7
Stage 1 (h)                      | 1.2   | 2.4
Stage 2 (h)                      | 0.6   | 1.1
Total (h)                        | *1.8* | *3.5*
Overhead vs. joint retraining (%) | 3.7  | 2.7
"""

_MERGING = """
NMRF             | Single Best          | 4.13   | _3.64_ | 6.56   | 2.76   | 4.27
NMRF             | Uniform Avg.         | 3.29   | 4.08   | 6.61   | 2.27   | 4.06
NMRF             | Task Arith.          | 3.27   | 4.02   | 6.48   | 2.24   | 4.00
NMRF             | Model Soups          | _3.18_ | 3.85   | _5.95_ | _2.22_ | _3.80_
NMRF             | TIES                 | 3.42   | 4.06   | 7.17   | 2.85   | 4.38
NMRF             | DARE                 | 3.39   | 4.15   | 7.01   | 2.36   | 4.23
NMRF             | StereoFactory (Ours) | *3.15* | *3.29* | *5.26* | *1.51* | *3.30*
FoundationStereo | Single Best          | 3.48   | 3.35   | _3.07_ | 1.61   | _2.88_
FoundationStereo | Uniform Avg.         | 3.15   | 3.94   | 5.31   | 2.14   | 3.64
FoundationStereo | Task Arith.          | *2.21* | _3.17_ | 3.90   | 5.32   | 3.65
FoundationStereo | Model Soups          | 3.60   | 4.62   | 3.68   | _1.19_ | 3.27
FoundationStereo | TIES                 | 6.32   | 4.63   | 4.78   | 7.06   | 5.70
FoundationStereo | DARE                 | 3.64   | 3.74   | 7.76   | 3.64   | 4.70
FoundationStereo | StereoFactory (Ours) | _2.45_ | *2.92* | *2.29* | *1.10* | *2.19*
"""

_ZERO_SHOT = """
published | CREStereo++                  | 4.7    | 5.2    | 14.8   | 4.4    | 7.28
published | DSMNet                       | 6.2    | 6.5    | 13.8   | 6.2    | 8.18
published | Mask-CFNet                   | 4.8    | 5.8    | 13.7   | 5.7    | 7.50
published | HVT-RAFT                     | 3.7    | 5.2    | 10.4   | 3.0    | 5.58
published | RAFT-Stereo                  | 4.7    | 5.5    | 12.6   | 3.3    | 6.52
published | Selective-IGEV               | 4.5    | 5.6    | 9.2    | 5.7    | 6.25
published | IGEV                         | 5.2    | 5.7    | 8.8    | 4.0    | 5.92
published | Former-RAFT-DAM              | 3.9    | 5.1    | 8.1    | 3.3    | 5.10
published | IGEV++                       | 5.1    | 5.9    | 7.8    | 4.1    | 5.72
published | NMRF                         | 4.2    | 5.1    | 7.5    | 3.8    | 5.15
published | FoundationStereo (SceneFlow) | 3.2    | 4.9    | 5.5    | 1.8    | 3.85
published | FoundationStereo (paper) *   | 2.3    | 2.8    | 1.1    | 0.5    | 1.67
published | Selective-IGEV *             | 3.2    | 4.5    | 7.5    | 3.4    | 4.65
NMRF      | NMRF-SwinT                   | 8.67   | 7.46   | 16.36  | 23.46  | 13.99
NMRF      | NMRF-SwinT *                 | 3.48   | 3.88   | 7.03   | 1.83   | 4.06
NMRF      | NMRF-SwinT (Ours)            | *3.15* | *3.29* | *5.26* | *1.51* | *3.30*
FoundationStereo | FoundationStereo        | 3.2    | 4.9    | 5.5    | 1.8    | 3.85
FoundationStereo | FoundationStereo *      | 3.01   | 3.26   | 2.69   | 0.77   | 2.43
FoundationStereo | FoundationStereo (Ours) | *2.45* | *2.92* | *2.29* | *1.10* | *2.19*
"""

_INDIVIDUAL = """
NMRF | kitti2012  | 8.67  | 6.09  | 4.28  | _3.96_ | 4.16 | 13.33 | 8.68  | 8.01  | 6.59  | 11.84 | 4.11 | 4.13   | *3.29*
NMRF | kitti2015  | 7.46  | 6.28  | 4.23  | _4.00_ | 4.71 | 15.21 | 6.90  | 6.18  | 6.23  | 15.36 | 4.87 | *3.64* | 4.08
NMRF | middlebury | 16.36 | 19.28 | 13.17 | 22.23 | 13.95 | 11.75 | 44.98 | 13.73 | 16.04 | 12.84 | 9.12 | *6.56* | _6.61_
NMRF | eth3d      | 23.46 | 6.18  | 27.93 | 73.78 | 5.25  | 11.23 | 64.51 | 5.75  | 6.96  | 5.32  | 3.17 | _2.76_ | *2.27*
FoundationStereo | kitti2012  | 5.53 | 4.45  | 3.50  | _3.21_ | 3.88 | 4.27 | 6.87 | 5.02 | 5.73 | 6.02 | 3.48 | 3.48 | *3.15*
FoundationStereo | kitti2015  | 5.93 | 5.13  | 4.20  | *3.25* | 4.55 | 4.74 | 5.93 | 5.02 | 6.04 | 6.57 | 4.91 | _3.35_ | 3.94
FoundationStereo | middlebury | 7.69 | 11.17 | 5.54 | 11.82 | _5.18_ | 8.01 | 6.86 | 8.16 | 13.57 | 6.83 | 7.28 | *3.07* | 5.31
FoundationStereo | eth3d      | 2.13 | 2.13  | 26.19 | 3.93 | 2.54 | 4.22 | 59.23 | 4.54 | 4.68 | 5.93 | _2.02_ | *1.61* | 2.14
"""  # noqa: E501

_COMBINATIONS = """
NMRF | kitti2012  | 3.29 | _3_  | _3_  | 3.01 | 3.01 | 3.31 | 3.32 | 3.32   | 3.31 | 3.02 | 3.12 | *2.98* | 3.6  | 3.15
NMRF | kitti2015  | 4.08 | 3.67 | 3.67 | 3.68 | 3.68 | 4.04 | 4.05 | 4.04   | 4.06 | 3.71 | 3.83 | _3.66_ | 4.34 | *3.29*
NMRF | middlebury | 6.61 | 6.64 | 6.63 | 6.64 | 6.64 | 6.79 | 6.78 | 6.77   | 6.73 | 6.6  | 6.67 | _6.5_  | 7.15 | *5.26*
NMRF | eth3d      | 2.27 | 2.31 | 2.32 | 2.31 | 2.31 | 2.27 | 2.26 | _2.24_ | 2.27 | 2.3  | 2.3  | 2.29   | 2.35 | *1.51*
FoundationStereo | kitti2012  | 3.15 | 3.17 | 3.16 | 3.17 | 3.21 | _3.06_ | 3.09 | 3.07 | 3.13 | 3.18 | 3.20 | 3.20 | 3.67 | *2.45*
FoundationStereo | kitti2015  | 3.94 | 3.90 | _3.89_ | 4.00 | 4.00 | 4.11 | 4.10 | 4.13 | 4.08 | 3.94 | 3.97 | 3.92 | 4.22 | *2.92*
FoundationStereo | middlebury | 5.31 | 5.39 | 5.41 | 5.30 | 5.43 | 4.76 | 4.78 | _4.66_ | 5.03 | 5.31 | 5.30 | 5.29 | 6.33 | *2.29*
FoundationStereo | eth3d      | 2.14 | 2.14 | 1.90 | 1.88 | 2.25 | 1.73 | 1.83 | _1.67_ | 2.08 | 2.19 | 2.15 | 2.27 | 3.00 | *1.10*
"""  # noqa: E501

_FITNESS = """
NMRF             | Middlebury | 3.04 | 3.24 | 4.92 | 1.65 | 3.21
NMRF             | ETH3D      | 3.15 | 3.29 | 5.26 | 1.51 | 3.30
FoundationStereo | Middlebury | 2.80 | 3.06 | 2.02 | 0.91 | 2.20
FoundationStereo | ETH3D      | 2.45 | 2.92 | 2.29 | 1.10 | 2.19
"""

_VALIDATION = """
ETH3D      | 0,3,7,9,10 | 3.15 | 3.29 | 5.26 | 1.51 | 3.30
Middlebury | 0,2,3,9,10 | 3.18 | 3.31 | 5.18 | 1.58 | 3.31
KITTI 15   | 0,3,7,9,10 | 3.12 | 3.24 | 5.31 | 1.54 | 3.30
"""

_STAGES = """
Stage 1 only | 3.20 | 3.96 | 5.85 | 1.73 | 3.69
Stage 1 + 2  | 3.15 | 3.29 | 5.26 | 1.51 | 3.30
"""

_REUSE = """
NMRF             | Non-reusable | 3.15 | 3.29 | 5.26 | 1.51 | 3.30
NMRF             | Reusable     | 3.07 | 3.31 | 5.13 | 1.60 | 3.28
FoundationStereo | Non-reusable | 2.85 | 3.23 | 1.91 | 0.85 | 2.21
FoundationStereo | Reusable     | 2.45 | 2.92 | 2.29 | 1.10 | 2.19
"""


@dataclass(frozen=True, eq=False)
class PublishedTable:
    """One table of the paper.

    Attributes:
        label: its LaTeX label, such as ``tab:merging_comparison``.
        about: what it shows, in one line.
        values: rows and columns as printed; numbers in percent, or hours in the table of costs.
        marks: ``best`` where the paper prints bold, ``second`` where it underlines, else empty.
    """

    label: str
    about: str
    values: pd.DataFrame
    marks: pd.DataFrame


_BY_METHOD, _BY_BENCHMARK = ("architecture", "method"), ("architecture", "benchmark")
_RAW: dict[str, tuple[str, tuple[str, ...], tuple[str, ...], str]] = {
    "tab:fusion_compare": (
        "Fusion strategies compared",
        ("method",),
        ("selection", "weights", "granularity", "inference"),
        _FUSION,
    ),
    "tab:computational_cost": (
        "Wall-clock cost of the search on four A100 GPUs",
        ("item",),
        (NMRF, FOUNDATION_STEREO),
        _COST,
    ),
    "tab:merging_comparison": ("Merging strategies on one pool", _BY_METHOD, _SCORES, _MERGING),
    "tab:zero_shot": (
        "Generalisation without training; * has a stronger training recipe",
        ("block", "method"),
        _SCORES,
        _ZERO_SHOT,
    ),
    "tab:individual_datasets": (
        "Individual checkpoints and their uniform average",
        _BY_BENCHMARK,
        ("SceneFlow", *SOURCES, "uniform"),
        _INDIVIDUAL,
    ),
    "tab:benchmark_results": (
        "Subsets by similarity of data to a target",
        _BY_BENCHMARK,
        ("uniform", *_COMBINED, "adaptive"),
        _COMBINATIONS,
    ),
    "tab:ablation_1": ("Fitness metric", _BY_METHOD, _SCORES, _FITNESS),
    "tab:validation_subset_robustness": (
        "Validation set, on NMRF",
        ("validation",),
        ("subset", *_SCORES),
        _VALIDATION,
    ),
    "tab:s1_vs_s2": ("Stage 1 against both stages, on NMRF", ("method",), _SCORES, _STAGES),
    "tab:ablation_2": ("Reusing a subset on the other architecture", _BY_METHOD, _SCORES, _REUSE),
}

LABELS = tuple(_RAW)
"""The labels of the paper's tables, in its order."""


@cache
def published_table(label: str) -> PublishedTable:
    """The paper's table with a LaTeX label; do not write into its frames.

    Raises:
        InputError: no table has it; the nearest is suggested.
    """
    if label not in _RAW:
        raise unknown_name("table of the paper", label, LABELS)
    about, keys, columns, text = _RAW[label]
    rows = [[cell.strip() for cell in line.split("|")] for line in text.strip().splitlines()]
    names = [row[: len(keys)] for row in rows]
    index = (
        pd.MultiIndex.from_tuples([tuple(name) for name in names], names=list(keys))
        if len(keys) > 1
        else pd.Index([name[0] for name in names], name=keys[0])
    )
    cells = [row[len(keys) :] for row in rows]
    values = pd.DataFrame([[_value(c) for c in row] for row in cells], index=index, columns=list(columns))
    words = {"*": "best", "_": "second"}
    found = [[words.get(cell[:1], "") for cell in row] for row in cells]
    marks = pd.DataFrame(found, index=index, columns=list(columns))
    return PublishedTable(label, about, values, marks)


def published(label: str) -> pd.DataFrame:
    """The numbers of one table, to be set beside one's own: a fresh frame.

    Raises:
        InputError: no table has this label.
    """
    return published_table(label).values.copy()


def numbers(label: str) -> dict[tuple[Key, str], float]:
    """The numeric cells of one table by row and column, in reading order.

    Raises:
        InputError: no table has this label.
    """
    table = published_table(label).values
    rows: list[Key] = [name if isinstance(name, tuple) else str(name) for name in table.index]
    cells = zip(((r, str(c)) for r in rows for c in table.columns), table.to_numpy().ravel(), strict=True)
    return {place: float(cell) for place, cell in cells if isinstance(cell, float)}


def _value(cell: str) -> float | str:
    bare = cell.strip("*_")
    try:
        return float(bare)
    except ValueError:
        return cell
