"""Better, worse, or within noise: the words for what is known of a difference, in one place."""

from __future__ import annotations

from enum import StrEnum


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
