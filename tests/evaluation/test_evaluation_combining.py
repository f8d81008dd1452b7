"""Several guides: one that gives no number leaves none for the candidate."""

from __future__ import annotations

import math
from collections.abc import Sequence

from sfkit.evaluation.combining import CombinedScorer
from sfkit.evaluation.outcome import Outcome
from sfkit.merging import Recipe


def test_a_guide_without_a_number_is_not_passed_over() -> None:
    """The other guide's 2.0 used to be the score."""

    def blind(recipes: Sequence[Recipe]) -> list[Outcome]:
        return [Outcome(math.nan) for _ in recipes]

    def seeing(recipes: Sequence[Recipe]) -> list[Outcome]:
        return [Outcome(2.0) for _ in recipes]

    for how in ("mean", "worst"):
        (outcome,) = CombinedScorer([blind, seeing], how)([Recipe.base(["all"])])
        assert math.isnan(outcome.score)
        assert outcome.failed
