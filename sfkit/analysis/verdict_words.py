"""A verdict in plain sentences, the most important first."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

from sfkit.analysis.intervals import FEWEST_IMAGES, LEVEL, PairedEstimate
from sfkit.analysis.labels import points, score_text
from sfkit.analysis.paired import allowance
from sfkit.analysis.verdict_records import Support, Verdict
from sfkit.datasets.metric import Metric

STAGE2 = ("Stage 1+2", "Stage 2")
"""How the networks of Stage 2 are called."""


def with_reason(
    found: Verdict,
    unlike: str | None,
    evaluations: Mapping[str, int],
    clear: bool,
    rival: str | None = None,
) -> Verdict:
    """The verdict with its reason.

    Args:
        found: the verdict.
        unlike: the simpler network to name beside it; None where there is none.
        evaluations: network name -> what finding it took, where that is known.
        clear: whether the intervals to all simpler networks on validation leave 0 out.
        rival: the simpler network that the tests put furthest ahead of what validation prefers, if any.
    """
    sentences = [*_first(found), *_second(found, unlike, clear), *_on_tests(found, unlike, rival)]
    if unlike is not None and {unlike, found.preferred} <= evaluations.keys():
        more = evaluations[found.preferred] - evaluations[unlike]
        if more > 0:
            sentences.append(f"Finding {found.preferred} took {more:,} evaluations more than {unlike}.")
    return replace(found, reason=tuple(sentences))


def _first(found: Verdict) -> list[str]:
    """What to deploy; where the tests contradict validation, that comes first."""
    guide = f"{' and '.join(found.validation)} ({found.pairs} pair{'s' * (found.pairs != 1)})"
    if found.support is Support.OVERRULED:
        what = "Stage 2" if found.preferred.startswith(STAGE2) else found.preferred
        chose = f"scores lowest on {guide}, which chose it"
        if found.averaged:
            chose = f"averages what wins resamples of {guide}"
        against = found.against(found.recommended)
        assert against.tests is not None
        return [
            f"{what} is not supported here: take {found.recommended}.",
            f"{found.preferred} {chose}, but on what guided nothing "
            f"({', '.join(found.tests)}) it is worse than {found.recommended} by "
            f"{_difference(against.tests, found.metric)}.",
        ]
    if found.averaged:
        return _average(found, guide)
    among = f", chosen among {found.candidates} networks there" if found.candidates > 1 else ""
    sentences = [f"Deploy {found.recommended}: {score_text(found.metric, found.score)} on {guide}{among}."]
    return [*sentences, *_passed_over(found)]


def _average(found: Verdict, guide: str) -> list[str]:
    """The averaged winner, and what is given up for it."""
    sentence = (
        f"Deploy {found.recommended}: {score_text(found.metric, found.score)} on {guide}, the average of "
        "what wins resamples of these pairs."
    )
    if found.score <= found.lowest_score:
        return [f"{sentence} It also scores lowest there, among {found.candidates} networks."]
    lowest = f"{found.lowest} scores lowest there ({score_text(found.metric, found.lowest_score)})"
    return [
        sentence,
        f"{lowest}, but what is best on few pairs need not be best elsewhere (docs/results.md).",
    ]


def _passed_over(found: Verdict) -> list[str]:
    """Why the averaged winner is not taken, where there is one and it is not."""
    against = None if found.passed_over is None else found.against(found.passed_over).validation
    if against is None:
        return []
    return [
        f"{found.passed_over}, the average of what wins resamples of these pairs, is passed over: validation "
        f"shows {found.lowest} better ({_difference(against, found.metric)})."
    ]


def _second(found: Verdict, unlike: str | None, clear: bool) -> list[str]:
    """The simpler network beside it, on validation and on tests."""
    if unlike is None or found.support is Support.OVERRULED:
        return []
    against = found.against(unlike)
    few = found.pairs < FEWEST_IMAGES * len(found.validation)
    shown = "" if against.validation is None else f" ({_difference(against.validation, found.metric, few)})"
    if few:
        sentences = [f"So few pairs cannot tell it from {unlike}, which is simpler{shown}."]
    elif against.validation is not None and against.validation.interval()[0] > 0.0:
        sentences = [f"On validation {unlike}, which is simpler, scores lower{shown}."]
    elif found.simplest is not None:
        sentences = [f"Validation cannot tell it from {unlike}, which is simpler{shown}."]
    elif clear:
        sentences = [f"Validation tells it from every simpler network, the nearest being {unlike}{shown}."]
    else:
        sentences = [
            "Every simpler network is more than one standard error behind it on validation, which is a hint "
            f"and no proof; the nearest is {unlike}{shown}."
        ]
    if not found.tests:
        sentences.append("No benchmark is left that guided nothing, so that nothing here is a test.")
    elif against.tests is None:
        sentences.append(
            f"On what guided nothing ({', '.join(found.tests)}) one of the two has no score everywhere, so "
            "that nothing there compares them."
        )
    else:
        word = (
            "better than" if against.confirmed else "worse than" if against.refuted else "not told apart from"
        )
        sentences.append(
            f"On what guided nothing ({', '.join(found.tests)}) it is {word} {unlike}: "
            f"{_on_the_tests(found, unlike)}."
        )
    return sentences


def _on_tests(found: Verdict, unlike: str | None, rival: str | None) -> list[str]:
    """A simpler network that does better on the tests than what validation prefers, by a hair or by luck."""
    if rival is None or rival == unlike or found.support is Support.OVERRULED:
        return []
    return [
        f"There {rival}, which is simpler too, scores lower, though the tests do not tell the two apart: "
        f"{_on_the_tests(found, rival)}."
    ]


def _on_the_tests(found: Verdict, other: str) -> str:
    """The difference there, and why nothing is told apart where the interval alone would say so."""
    against = found.against(other)
    assert against.tests is not None
    sentence = _difference(against.tests, found.metric, math.isnan(against.p))
    if against.confirmed or against.refuted or math.isnan(against.p):
        return sentence
    why = allowance(against.tests.interval(), found.family)
    return f"{sentence}, {why}" if why else sentence


def _difference(estimate: PairedEstimate, metric: str, few: bool = False) -> str:
    """The difference with its interval; without it where there are too ``few`` pairs to judge by."""
    unit = points(Metric.parse(metric).unit)
    if few or math.isinf(estimate.error):
        return f"{estimate.value:+.2f} {unit}, no interval from so few pairs"
    low, high = estimate.interval()
    return f"{estimate.value:+.2f} {unit}, {100 * LEVEL:.0f} % interval {low:+.2f} to {high:+.2f}"
