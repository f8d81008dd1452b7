"""The verdict: which network to deploy, which simpler one validation cannot tell from it, and how sure.

The rule, one for every result of sfkit:

1. Recommended is the average of what wins resamples of the validation pairs, where the search made it
   (``resamples``, :mod:`sfkit.search.averaging`) and validation does not show it worse than the network that
   scores lowest there (its interval leaves 0 out); else the latter.
2. Beside it stands the *simplest* network within one standard error of it there (the one-standard-error
   rule of Breiman et al., 1984): a source alone is simpler than equal weights, equal weights of fewer
   sources are simpler than of more, and both are simpler than a routing.
3. Where benchmarks that guided nothing show that a network of another kind, or a simpler one, is better
   (its p-value is under 0.05, corrected for all comparisons that are made on these benchmarks), they
   overrule validation, and the verdict begins with that.

Evidence, as change on unseen images against rule 1 without an average, over ten runs each on the first bank,
on a real pool and on the sharp bank (docs/results.md, "Which rule should a verdict follow?"): the
simplest network within one standard error loses 0.25 and 0.34 points on the first two and gains 0.14 on the
third, within two it loses 0.59 and 0.44 and gains 0.35: over all 30 runs both lose. The most frequent
winner of bootstrap samples of the pairs is the best itself in all of them. So the best is taken, and the
simplest within one standard error named beside it. No rule is free: with three real pairs the best beats
Stage 1 elsewhere in five runs of ten. The average of the bootstrap's winners gains 0.53 and 0.46 points
over it and loses 0.28 on the sharp bank, where half the time the best is a source alone, which no search
proposes: it is better in 18 of 30 runs, by 0.24 points at the mean. That is too little to make it the
default, and it goes first only where a search was asked for it.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping, Sequence

from sfkit.analysis.intervals import FEWEST_IMAGES, PairedEstimate, holm, paired_estimate
from sfkit.analysis.measured import Measured
from sfkit.analysis.paired import runs_on_images
from sfkit.analysis.verdict_records import Against, Support, Verdict
from sfkit.analysis.verdict_words import with_reason
from sfkit.errors import InputError
from sfkit.merging.recipe import Recipe


def simplicity(recipe: Recipe) -> tuple[int, int]:
    """How simple a network is, the simplest first: the base, a source, equal weights of few, a routing.

    Args:
        recipe: whose sources that weigh nothing anywhere do not count.

    Returns:
        The rung (0 to 3) and how many sources take part.
    """
    used = [e for e in range(len(recipe.sources)) if any(row[e] for row in recipe.weights)]
    if not used:
        return 0, 0
    plain = recipe.tied and all(scale == 1.0 for scale in recipe.scales) and not recipe.preparation
    weights = {recipe.weights[0][e] for e in used}
    # With tolerance: equal weights that went through a sum or a file differ in their last digit.
    equal = plain and max(weights) - min(weights) < 1e-12 and math.isclose(max(weights) * len(used), 1.0)
    return (1 if equal and len(used) == 1 else 2 if equal else 3), len(used)


def verdict(
    recipes: Mapping[str, Recipe],
    validation: Sequence[Measured],
    tests: Sequence[Measured] = (),
    *,
    evaluations: Mapping[str, int] | None = None,
    averaged: str | None = None,
    beside: Sequence[float] = (),
) -> Verdict:
    """Apply the rule to measured networks.

    Args:
        recipes: network name -> recipe, of every network that may be deployed; what saw the tests is none.
        validation: the benchmarks that guided, with all these networks; each under its own metric.
        tests: benchmarks that guided nothing.
        evaluations: network name -> what finding it took, where that is to be said.
        averaged: the name of the averaged winner, where there is one.
        beside: uncorrected p-values of what else is compared on the tests, such as
            :attr:`NetworkComparison.p_values`; all are corrected together.

    Raises:
        InputError: no network with a score, no validation benchmark, or a network one of them lacks.
    """
    able, rungs = _able(recipes, validation)
    lowest, average, preferred = _choice(able, rungs, validation, averaged)
    worse = average is not None and preferred != average
    compared, family = _compare(preferred, {lowest, average}, rungs, validation, tests, beside)
    close = [one.simpler for one in compared if not one.told_apart and rungs[one.simpler] < rungs[preferred]]
    simplest = min(close, key=lambda name: (rungs[name], able[name])) if close else None
    better = [one.simpler for one in compared if one.refuted]
    # Of several that tests show better validation chooses: tests judge, and guide nothing.
    recommended = min(better, key=lambda name: able[name]) if better else preferred
    unlike = simplest if simplest is not None else _next(rungs, able, preferred)
    rival = _rival(compared, rungs, preferred)
    shown = unlike is not None and any(one.simpler == unlike and one.confirmed for one in compared)
    # A simpler network ahead on the tests leaves nothing shown.
    shown = shown and rival is None
    support = Support.OVERRULED if better else Support.SHOWN if shown else Support.UNDECIDED
    found = Verdict(
        recommended,
        preferred,
        simplest,
        support,
        compared,
        len(able),
        tuple(one.benchmark for one in validation),
        sum(len(one.ids) for one in validation),
        tuple(one.benchmark for one in tests),
        validation[0].metric,
        able[recommended],
        (),
        lowest,
        able[lowest],
        averaged=preferred == average,
        passed_over=average if worse else None,
        family=family,
    )
    clear = all(one.clear for one in compared if rungs[one.simpler] < rungs[preferred])
    return with_reason(found, unlike, evaluations or {}, clear, rival)


def prefer(recipes: Mapping[str, Recipe], validation: Sequence[Measured], averaged: str | None = None) -> str:
    """The network that validation alone prefers: the rule before any test is looked at.

    Args and errors as :func:`verdict`.
    """
    return _choice(*_able(recipes, validation), validation, averaged)[2]


def _able(
    recipes: Mapping[str, Recipe], validation: Sequence[Measured]
) -> tuple[dict[str, float], dict[str, tuple[int, int]]]:
    """Scores on validation and rungs of all that have a score."""
    if not validation:
        raise InputError("verdict: found no validation benchmark, expected at least one")
    scores = {name: _mean([one.score(name) for one in validation]) for name in recipes}
    able = {name: score for name, score in scores.items() if math.isfinite(score)}
    if not able:
        raise InputError("verdict: found no network with a finite validation score, expected at least one")
    return able, {name: simplicity(recipes[name]) for name in able}


def _choice(
    able: Mapping[str, float],
    rungs: Mapping[str, tuple[int, int]],
    validation: Sequence[Measured],
    averaged: str | None,
) -> tuple[str, str | None, str]:
    """What scores lowest, the averaged winner if there is one, and which of the two validation prefers."""
    # Of equal scores the simpler network.
    lowest = min(able, key=lambda name: (able[name], rungs[name]))
    average = averaged if averaged in able else None
    if average is None or shown_worse(validation, average, lowest):
        return lowest, average, lowest
    return lowest, average, average


def estimate_between(measured: Sequence[Measured], network: str, reference: str) -> PairedEstimate | None:
    """A network's mean score over benchmarks minus a reference's; None without a score on both sides.

    Under two images on a benchmark the error is infinite: such a difference tells nothing apart.
    """
    if not measured:
        return None
    value = _mean([one.score(network) - one.score(reference) for one in measured])
    if not math.isfinite(value):
        return None
    if min(len(one.ids) for one in measured) < 2:
        # One image has no spread: an interval without end claims nothing.
        return PairedEstimate(value, math.inf, 1.0)
    return paired_estimate(
        [(runs_on_images(one, [network]), runs_on_images(one, [reference])) for one in measured]
    )


def shown_worse(measured: Sequence[Measured], network: str, reference: str) -> bool:
    """Whether the 95 % interval of a network's difference to a reference lies above 0.

    Under five images on a benchmark there is none, and nothing is shown.
    """
    found = estimate_between(measured, network, reference)
    few = min(len(one.ids) for one in measured) < FEWEST_IMAGES
    return found is not None and not few and found.interval()[0] > 0.0


def _compare(
    preferred: str,
    always: Container[str | None],
    rungs: Mapping[str, tuple[int, int]],
    validation: Sequence[Measured],
    tests: Sequence[Measured],
    beside: Sequence[float],
) -> tuple[tuple[Against, ...], int]:
    """``preferred`` beside the others, and among how many comparisons that is corrected."""
    own = rungs[preferred]
    others = [name for name in rungs if name != preferred]
    simpler = [n for n in others if rungs[n] < own or rungs[n][0] > own[0] or n in always]
    seen = [estimate_between(tests, preferred, name) for name in simpler]
    # Too few images give no interval, and so no p-value to correct.
    enough = bool(tests) and min(len(one.ids) for one in tests) >= FEWEST_IMAGES
    alone = [*(one.p if one is not None and enough else math.nan for one in seen), *beside]
    # What is claimed beside the verdict on the same tests belongs to its family.
    p_values = holm(alone)[: len(seen)]
    compared = tuple(
        Against(name, estimate_between(validation, preferred, name), test, p)
        for name, test, p in zip(simpler, seen, p_values, strict=True)
    )
    return compared, sum(not math.isnan(p) for p in alone)


def _next(rungs: Mapping[str, tuple[int, int]], scores: Mapping[str, float], preferred: str) -> str | None:
    """The simpler network that validation likes second; None where there is no simpler one."""
    simpler = [name for name, rung in rungs.items() if rung < rungs[preferred]]
    return min(simpler, key=lambda name: (scores[name], rungs[name])) if simpler else None


def _rival(compared: Sequence[Against], rungs: Mapping[str, tuple[int, int]], preferred: str) -> str | None:
    """The simpler network that does best on the tests, where it does better there than the preferred one."""
    ahead = {
        one.simpler: one.tests.value
        for one in compared
        if one.tests is not None and one.tests.value > 0.0 and rungs[one.simpler] < rungs[preferred]
    }
    return max(ahead, key=lambda name: ahead[name]) if ahead else None


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values) if all(map(math.isfinite, values)) else math.nan
