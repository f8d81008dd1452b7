"""The verdict: which network to deploy, which simpler one validation cannot tell from it, and how sure.

The rule, one for every result of sfkit:

1. Recommended is the network that scores lowest on validation.
2. Beside it stands the *simplest* network within one standard error of it there (the one-standard-error
   rule of Breiman et al., 1984): a source alone is simpler than equal weights, equal weights of fewer
   sources are simpler than of more, and both are simpler than a routing.
3. Where benchmarks that guided nothing show that a simpler network is better (its interval, corrected for
   how many were compared, leaves 0 out), they overrule validation, and the verdict begins with that.

``docs/validation.md`` has the evidence for taking the best and naming the simplest, rather than taking it.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from sfkit.analysis.intervals import FEWEST_IMAGES, LEVEL, PairedEstimate, holm, paired_estimate
from sfkit.analysis.labels import points, score_text
from sfkit.analysis.measured import Measured
from sfkit.analysis.paired import runs_on_images
from sfkit.datasets.metric import Metric
from sfkit.errors import InputError, unknown_name
from sfkit.merging.recipe import Recipe


class Support(enum.Enum):
    """How the evidence stands to the recommended network."""

    SHOWN = "shown"
    """Benchmarks that guided nothing show it better than the simpler network."""
    UNDECIDED = "undecided"
    """They cannot tell the two apart, or there are none."""
    OVERRULED = "overruled"
    """Validation preferred another, and they show that one worse."""


@dataclass(frozen=True)
class Against:
    """The network validation prefers beside a simpler one.

    Attributes:
        simpler: the simpler network's name.
        validation: score minus the simpler one's on validation; None where it has no score.
        tests: the same on the mean of what guided nothing; None where there is none.
        p: of ``tests``, corrected for all networks that were compared (Holm); NaN where it has no interval.
    """

    simpler: str
    validation: PairedEstimate | None
    tests: PairedEstimate | None
    p: float

    @property
    def told_apart(self) -> bool:
        """Whether validation prefers the other by more than one standard error."""
        return self.validation is not None and -self.validation.value > self.validation.error

    @property
    def refuted(self) -> bool:
        """Whether the tests show the simpler network better."""
        return self.tests is not None and self.tests.value > 0.0 and self.p < 1.0 - LEVEL

    @property
    def confirmed(self) -> bool:
        """Whether the tests show the simpler network worse."""
        return self.tests is not None and self.tests.value < 0.0 and self.p < 1.0 - LEVEL


@dataclass(frozen=True)
class Verdict:
    """What to deploy.

    Attributes:
        recommended: the network's name.
        preferred: the one validation prefers; another where the tests overrule it.
        simplest: the simplest network that validation cannot tell from ``preferred``; None where it tells
            ``preferred`` from every simpler one.
        support: what the tests say.
        compared: ``preferred`` beside every simpler network.
        candidates: among how many networks validation chose.
        validation: its benchmarks' names.
        pairs: how many pairs these have.
        tests: names of the benchmarks that guided nothing.
        metric: what the scores are.
        score: of ``recommended`` on validation, the mean over its benchmarks.
        reason: why, in plain sentences, the most important first.
    """

    recommended: str
    preferred: str
    simplest: str | None
    support: Support
    compared: tuple[Against, ...]
    candidates: int
    validation: tuple[str, ...]
    pairs: int
    tests: tuple[str, ...]
    metric: str
    score: float
    reason: tuple[str, ...]

    @property
    def sentence(self) -> str:
        """The verdict in one paragraph."""
        return " ".join(self.reason)

    def __str__(self) -> str:
        return self.sentence

    def against(self, simpler: str) -> Against:
        """``preferred`` beside one simpler network.

        Raises:
            InputError: it was not compared with it.
        """
        for one in self.compared:
            if one.simpler == simpler:
                return one
        raise unknown_name("simpler network", simpler, [one.simpler for one in self.compared])

    def as_dict(self) -> dict[str, object]:
        """Plain values, for ``result.json``."""
        return {
            "recommended": self.recommended,
            "preferred_by_validation": self.preferred,
            "simplest_not_told_apart": self.simplest,
            "support": self.support.value,
            "sentence": self.sentence,
        }


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
    equal = plain and max(weights) - min(weights) < 1e-12 and math.isclose(max(weights) * len(used), 1.0)
    return (1 if equal and len(used) == 1 else 2 if equal else 3), len(used)


def verdict(
    recipes: Mapping[str, Recipe],
    validation: Sequence[Measured],
    tests: Sequence[Measured] = (),
    *,
    evaluations: Mapping[str, int] | None = None,
) -> Verdict:
    """Apply the rule to measured networks.

    Args:
        recipes: network name -> recipe, of every network that may be deployed; what saw the tests is none.
        validation: the benchmarks that guided, with all these networks; each under its own metric.
        tests: benchmarks that guided nothing.
        evaluations: network name -> what finding it took, where that is to be said.

    Raises:
        InputError: no network with a score, no validation benchmark, or a network one of them lacks.
    """
    if not validation:
        raise InputError("verdict: found no validation benchmark, expected at least one")
    scores = {name: _mean([one.score(name) for one in validation]) for name in recipes}
    able = {name: score for name, score in scores.items() if math.isfinite(score)}
    if not able:
        raise InputError("verdict: found no network with a finite validation score, expected at least one")
    rungs = {name: simplicity(recipes[name]) for name in able}
    preferred = min(able, key=lambda name: (able[name], rungs[name]))
    compared = _compare(preferred, rungs, validation, tests)
    close = [one.simpler for one in compared if not one.told_apart]
    simplest = min(close, key=lambda name: (rungs[name], able[name])) if close else None
    better = [one.simpler for one in compared if one.refuted]
    recommended = min(better, key=lambda name: able[name]) if better else preferred
    unlike = simplest if simplest is not None else _next(rungs, able, preferred)
    shown = unlike is not None and any(one.simpler == unlike and one.confirmed for one in compared)
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
    )
    return _with_reason(found, unlike, rungs, evaluations or {})


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
        return PairedEstimate(value, math.inf, 1.0)
    return paired_estimate(
        [(runs_on_images(one, [network]), runs_on_images(one, [reference])) for one in measured]
    )


def _compare(
    preferred: str,
    rungs: Mapping[str, tuple[int, int]],
    validation: Sequence[Measured],
    tests: Sequence[Measured],
) -> tuple[Against, ...]:
    simpler = [name for name, rung in rungs.items() if rung < rungs[preferred]]
    seen = [estimate_between(tests, preferred, name) for name in simpler]
    enough = bool(tests) and min(len(one.ids) for one in tests) >= FEWEST_IMAGES
    p_values = holm([one.p if one is not None and enough else math.nan for one in seen])
    return tuple(
        Against(name, estimate_between(validation, preferred, name), test, p)
        for name, test, p in zip(simpler, seen, p_values, strict=True)
    )


def _next(rungs: Mapping[str, tuple[int, int]], scores: Mapping[str, float], preferred: str) -> str | None:
    """The simpler network that validation likes second; None where there is no simpler one."""
    simpler = [name for name, rung in rungs.items() if rung < rungs[preferred]]
    return min(simpler, key=lambda name: (scores[name], rungs[name])) if simpler else None


def _with_reason(
    found: Verdict,
    unlike: str | None,
    rungs: Mapping[str, tuple[int, int]],
    evaluations: Mapping[str, int],
) -> Verdict:
    said = [*_first(found, rungs), *_second(found, unlike)]
    if unlike is not None and {unlike, found.preferred} <= evaluations.keys():
        more = evaluations[found.preferred] - evaluations[unlike]
        if more > 0:
            said.append(f"Finding {found.preferred} took {more:,} evaluations more than {unlike}.")
    return replace(found, reason=tuple(said))


def _first(found: Verdict, rungs: Mapping[str, tuple[int, int]]) -> list[str]:
    """What to deploy; where the tests contradict validation, that comes first."""
    guide = f"{' and '.join(found.validation)} ({found.pairs} pair{'s' * (found.pairs != 1)})"
    if found.support is Support.OVERRULED:
        what = "Stage 2" if rungs[found.preferred][0] == 3 else found.preferred
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


def _mean(values: Sequence[float]) -> float:
    return math.fsum(values) / len(values) if all(map(math.isfinite, values)) else math.nan
