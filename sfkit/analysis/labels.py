"""How a metric is called on an axis: its name with its unit."""

from __future__ import annotations

from sfkit.datasets.measure import Kind, Metric


def metric_label(metric: str | None) -> str:
    """``bad-1.0 (% of pixels)``, ``EPE (px)``; ``score`` where the metric is not known.

    Raises:
        InputError: a name that is no metric.
    """
    if metric is None:
        return "score"
    parsed = Metric.parse(metric)
    name = parsed.name if parsed.kind is Kind.BAD else parsed.name.upper()
    return f"{name} ({'px' if parsed.unit == 'px' else '% of pixels'})"


def score_text(metric: str | None, score: float) -> str:
    """A score with its unit, such as ``bad-1.0 20.29 %`` or ``EPE 1.13 px``."""
    if metric is None:
        return f"score {score:.4g}"
    parsed = Metric.parse(metric)
    name = parsed.name if parsed.kind is Kind.BAD else parsed.name.upper()
    return f"{name} {score:.2f} {parsed.unit}"
