"""How a metric is called on an axis: its name with its unit."""

from __future__ import annotations

from sfkit.datasets.metric import Metric


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
