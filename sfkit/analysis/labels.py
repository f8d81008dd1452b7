"""How things are called on axes and in sentences: metrics, differences, what is known of one."""

from __future__ import annotations

from enum import StrEnum

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


class Judgement(StrEnum):
    """What can be said of a difference."""

    BETTER = "better"
    WORSE = "worse"
    WITHIN_NOISE = "within noise"
    UNKNOWN = "no interval"

    @property
    def against(self) -> str:
        """The words before what it is compared with, such as ``better than``."""
        return f"{self} {'of' if self is Judgement.WITHIN_NOISE else 'than'}"

    @property
    def beyond_noise(self) -> bool:
        """True where the difference is more than noise, either way."""
        return self in (Judgement.BETTER, Judgement.WORSE)


def judge(value: float, within_noise: bool | None, *, lower_is_better: bool = True) -> Judgement:
    """What can be said of a difference.

    Args:
        value: a score minus the other's.
        within_noise: whether it may be noise; None where nothing tells.
        lower_is_better: of the metric.
    """
    if within_noise is None:
        return Judgement.UNKNOWN
    if within_noise:
        return Judgement.WITHIN_NOISE
    return Judgement.BETTER if (value < 0.0) == lower_is_better else Judgement.WORSE
