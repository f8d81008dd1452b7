"""What lies between two networks? Scores along the straight line from one recipe to another.

A valley without a ridge between base and source is what makes their task vector worth mixing (linear mode
connectivity: Frankle et al., ICML 2020).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfkit.analysis.measured import Measured, measure_with
from sfkit.errors import InputError
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.table import ProgressCallback
from sfkit.merging.recipe import Recipe


@dataclass(frozen=True, eq=False)
class InterpolationCurve:
    """One line between two networks on one benchmark.

    Attributes:
        name: of the line, such as the source at its end.
        benchmark: where it was scored.
        metric: such as ``bad-1.0``.
        unit: ``%`` or ``px``.
        validation: True where the benchmark guided a search.
        positions: (T,) from 0 (start) over 1 (end); beyond 1 it goes on in the same direction.
        scores: (T,) lower is better; NaN where the network failed.
    """

    name: str
    benchmark: str
    metric: str
    unit: str
    validation: bool
    positions: NDArray[np.float64]
    scores: NDArray[np.float64]

    @property
    def best(self) -> float:
        """The position with the lowest score; NaN where no network of the line has one."""
        finite = np.isfinite(self.scores)
        return float(self.positions[finite][self.scores[finite].argmin()]) if finite.any() else math.nan

    @property
    def barrier(self) -> float:
        """How far the worst network from 0 to 1 stands above the straight line between both ends' scores.

        In the metric's unit; 0 where the curve lies below that line, NaN where a network failed.
        """
        inside = (self.positions >= 0.0) & (self.positions <= 1.0)
        at, scores = self.positions[inside], self.scores[inside]
        # Against the chord: ends of unlike scores are no barrier.
        line = scores[0] + (scores[-1] - scores[0]) * (at - at[0]) / (at[-1] - at[0])
        return float(np.max(scores - line))


def interpolated(start: Recipe, end: Recipe, position: float) -> Recipe:
    """The recipe at ``position`` on the straight line from ``start`` (0) to ``end`` (1).

    Its parameters are exactly (1 - t) start + t end in every block. Its weights keep a sum between those of
    both ends and its scales carry the rest, so that running statistics, which scales never touch, stay
    convex and end where the two recipes have them.

    Raises:
        InputError: the recipes have different blocks, or a coefficient would be negative beyond an end.
    """
    if start.blocks != end.blocks:
        raise InputError(
            f"interpolation: found the blocks {', '.join(start.blocks)} and {', '.join(end.blocks)}, "
            "expected two recipes of one pool and partition"
        )
    sources = tuple(dict.fromkeys((*start.sources, *end.sources)))
    rows, scales = [], []
    for block in start.blocks:
        (first, first_scale), (last, last_scale) = start.of(block), end.of(block)
        # Shaped (2, E) also where no source takes part.
        ends = np.array([[side.get(s, 0.0) for s in sources] for side in (first, last)]).reshape(2, -1)
        toward = np.array([1.0 - position, position])
        # What lies on the line is weight times scale, which a task vector is multiplied by.
        coefficients = (toward * (first_scale, last_scale)) @ ends
        total = float(toward @ ends.sum(axis=1))
        effect = float(coefficients.sum())
        if effect == 0.0 or total == 0.0:  # nothing is added here: the base's parameters, whatever the mix
            row, scale = toward @ ends, float(toward @ (first_scale, last_scale))
        else:
            # Parted again, so that rows have the sum that lies between the ends' rows.
            row, scale = coefficients * (total / effect), effect / total
        if min([scale, *row]) < 0.0:
            raise InputError(
                f"interpolation: position {position:g} gives block {block!r} a negative weight, "
                "expected a position nearer to 0 to 1"
            )
        rows.append(tuple(float(value) for value in row))
        scales.append(scale)
    return Recipe(sources, start.blocks, tuple(rows), tuple(scales))


def interpolation_curves(
    evaluators: Sequence[Evaluator],
    lines: Mapping[str, tuple[Recipe, Recipe]],
    *,
    positions: Sequence[float] = tuple(np.linspace(0.0, 1.0, 11).tolist()),
    validation: Sequence[str] = (),
    progress: ProgressCallback | None = None,
) -> tuple[InterpolationCurve, ...]:
    """Score networks along straight lines, on every benchmark; ends that lines share are scored once.

    Args:
        evaluators: one a benchmark.
        lines: name -> start and end.
        positions: ascending, with 0 and 1 among them.
        validation: names of the benchmarks that guided a search.
        progress: called for each evaluation when it is done.

    Raises:
        InputError: no line, or positions without both ends.
    """
    at = np.array(positions, dtype=np.float64)
    if not lines or not {0.0, 1.0} <= set(at.tolist()) or (np.diff(at) <= 0).any():
        raise InputError(
            f"interpolation: found {len(lines)} lines at {list(positions)}, expected at least one, and "
            "ascending positions with 0 and 1 among them"
        )
    # Lines that share an end share its recipe, which is scored once.
    recipes = {
        f"{name} {number}": interpolated(start, end, float(position))
        for name, (start, end) in lines.items()
        for number, position in enumerate(at)
    }
    measured = measure_with(evaluators, recipes, validation=validation, progress=progress)
    return tuple(_curve(one, name, at) for name in lines for one in measured)


def _curve(one: Measured, name: str, at: NDArray[np.float64]) -> InterpolationCurve:
    scores = np.array([one.score(f"{name} {number}") for number in range(len(at))])
    return InterpolationCurve(name, one.benchmark, one.metric, one.unit, one.validation, at, scores)
