"""A verdict in plain sentences, the most important first."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from sfkit.analysis.intervals import FEWEST_IMAGES, LEVEL, PairedEstimate
from sfkit.analysis.labels import points, score_text
from sfkit.analysis.verdict_records import Support, Verdict
from sfkit.datasets.metric import Metric

STAGE2 = ("Stage 1+2", "Stage 2")
"""How the networks of Stage 2 are called."""


def with_reason(
    found: Verdict,
    unlike: str | None,
    evaluations: Mapping[str, int],
) -> Verdict:
    """The verdict with its reason.

    Args:
        found: the verdict.
        unlike: the simpler network to name beside it; None where there is none.
        evaluations: network name -> what finding it took, where that is known.
    """
    said = [*_first(found), *_second(found, unlike)]
    if unlike is not None and {unlike, found.preferred} <= evaluations.keys():
        more = evaluations[found.preferred] - evaluations[unlike]
        if more > 0:
            said.append(f"Finding {found.preferred} took {more:,} evaluations more than {unlike}.")
    return replace(found, reason=tuple(said))


def _first(found: Verdict) -> list[str]:
    """What to deploy; where the tests contradict validation, that comes first."""
    guide = f"{' and '.join(found.validation)} ({found.pairs} pair{'s' * (found.pairs != 1)})"
    if found.support is Support.OVERRULED:
        what = "Stage 2" if found.preferred.startswith(STAGE2) else found.preferred
        against = found.against(found.recommended)
        assert against.tests is not None
        return [
            f"{what} is not supported here: take {found.recommended}.",
            f"{found.preferred} scores lowest on {guide}, which chose it, but on what guided nothing "
            f"({', '.join(found.tests)}) it is worse than {found.recommended} by "
            f"{_difference(against.tests, found.metric)}.",
        ]
    among = f", chosen among {found.candidates} networks there" if found.candidates > 1 else ""
    return [f"Deploy {found.recommended}: {score_text(found.metric, found.score)} on {guide}{among}."]


def _second(found: Verdict, unlike: str | None) -> list[str]:
    """The simpler network beside it, on validation and on tests."""
    if unlike is None or found.support is Support.OVERRULED:
        return []
    against = found.against(unlike)
    shown = "" if against.validation is None else f" ({_difference(against.validation, found.metric)})"
    if found.pairs < FEWEST_IMAGES * len(found.validation):
        said = [f"So few pairs cannot tell it from {unlike}, which is simpler{shown}."]
    elif found.simplest is not None:
        said = [f"Validation cannot tell it from {unlike}, which is simpler{shown}."]
    else:
        said = [f"Validation tells it from every simpler network, the nearest being {unlike}{shown}."]
    if against.tests is None:
        said.append("No benchmark is left that guided nothing, so that nothing here is a test.")
    else:
        word = (
            "better than" if against.confirmed else "worse than" if against.refuted else "not told apart from"
        )
        said.append(
            f"On what guided nothing ({', '.join(found.tests)}) it is {word} {unlike}: "
            f"{_difference(against.tests, found.metric)}."
        )
    return said


def _difference(estimate: PairedEstimate, metric: str) -> str:
    unit = points(Metric.parse(metric).unit)
    if math.isinf(estimate.error):
        return f"{estimate.value:+.2f} {unit}, no interval from one pair"
    low, high = estimate.interval()
    return f"{estimate.value:+.2f} {unit}, {100 * LEVEL:.0f} % interval {low:+.2f} to {high:+.2f}"
