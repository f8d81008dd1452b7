"""What the views of both stages show of a search by a model: proposals, what was expected, what came."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Any

from sfkit.analysis.drawn_points import drawn_points
from sfkit.analysis.labels import metric_label
from sfkit.analysis.predictions import Predictions, calibration

WITHIN, LEVEL = 1.96, 0.95
"""Standard deviations to either side of the mean, and the share of a normal distribution that they hold."""


def shown_predictions(told: Predictions | None) -> dict[str, Any]:
    """What the script draws, as JSON values; None stands for a score that is not finite.

    Empty where no model proposes. Else ``metric`` with its unit; ``number`` of at most 400 proposals,
    ascending, and for each ``mean``, ``sd``, ``low`` and ``high`` (ends of the 95 % interval), ``bound``,
    ``best`` (found before it) and ``score``; ``says``, how often the intervals held what came.
    """
    if told is None or not told.by_model:
        return {}
    drawn = drawn_points(len(told))
    mean, sd = told.mean[drawn], told.sd[drawn]
    return {
        "metric": metric_label(told.metric),
        "number": told.number[drawn].tolist(),
        "mean": finite(mean),
        "sd": finite(sd),
        "low": finite(mean - WITHIN * sd),
        "high": finite(mean + WITHIN * sd),
        "bound": finite(told.bound[drawn]),
        "best": finite(told.best[drawn]),
        "score": finite(told.score[drawn]),
        "says": _says(told),
    }


def _says(told: Predictions) -> str:
    knew = f"It knew {told.learned} evaluations before this search. " if told.learned else ""
    if not told.measured.any():
        return f"{knew}No proposal has a score yet."
    found = calibration(told, (LEVEL,))
    (low, high), covered = found.honest[0], found.coverage[0]
    word = "too few" if covered < low else "too many" if covered > high else "which chance allows"
    failed = f"; {found.failed} failed" if found.failed else ""
    return (
        f"{knew}Its 95 % intervals hold {100 * covered:.0f} % of {len(found.score)} measured scores, {word}; "
        f"measured - predicted is {found.error:+.2g} at the mean{failed}."
    )


def finite(values: Iterable[float], digits: int = 5) -> list[float | None]:
    """Numbers as JSON has them: of so many digits, None for one that is not finite."""
    return [float(f"{value:.{digits}g}") if math.isfinite(value) else None for value in values]
