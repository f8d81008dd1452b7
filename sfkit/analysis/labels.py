"""How things are called on axes and in sentences: metrics, differences, what guided a search."""

from __future__ import annotations

from sfkit.datasets.metric import Metric
from sfkit.evaluation.separation import marked as marked  # figures know no room but analysis


def metric_label(metric: str | None) -> str:
    """``bad-1.0 (% of pixels)``, ``EPE (px)``; ``score`` where the metric is not known.

    Raises:
        InputError: a name that is no metric.
    """
    if metric is None:
        return "score"
    return Metric.parse(metric).axis


def score_text(metric: str | None, score: float) -> str:
    """A score with its unit, such as ``bad-1.0 20.29 %`` or ``EPE 1.13 px``."""
    if metric is None:
        return f"score {score:.4g}"
    parsed = Metric.parse(metric)
    return f"{parsed.label} {score:.2f} {parsed.unit}"


def points(unit: str, *, full: bool = False) -> str:
    """The unit of a difference of scores: that of two percentages is in (percentage) points."""
    return unit if unit != "%" else "percentage points" if full else "points"
