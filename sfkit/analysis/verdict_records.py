"""A verdict as a record: what is recommended, what it was compared with, what the tests say."""

from __future__ import annotations

import enum
import math
from dataclasses import dataclass

from sfkit.analysis.intervals import LEVEL, PairedEstimate
from sfkit.errors import unknown_name


class Support(enum.Enum):
    """How the evidence stands to the recommended network."""

    SHOWN = "shown"
    """Benchmarks that guided nothing show it better than the simpler network, and no simpler one ahead."""
    UNDECIDED = "undecided"
    """They cannot tell the two apart, put another simpler network ahead, or there are none."""
    OVERRULED = "overruled"
    """Validation preferred another, and they show that one worse."""


@dataclass(frozen=True)
class Against:
    """The network validation prefers beside a simpler one, or one of a less simple kind.

    Attributes:
        simpler: the other network's name.
        validation: score minus the simpler one's on validation; None where it has no score.
        tests: the same on the mean of what guided nothing; None where there is none.
        p: of ``tests``, corrected (Holm) for all comparisons on the tests; NaN where it has no interval.
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
    def clear(self) -> bool:
        """Whether the interval of the difference on validation leaves 0 out, in favour of the other."""
        return self.validation is not None and self.validation.interval()[1] < 0.0

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
        preferred: the one validation prefers, which is the averaged winner where there is one; another than
            ``recommended`` where the tests overrule it.
        simplest: the simplest network that validation cannot tell from ``preferred``; None where it tells
            ``preferred`` from every simpler one.
        support: what the tests say.
        compared: ``preferred`` beside every simpler network, those of a less simple kind, what scores lowest
            and the averaged winner.
        candidates: among how many networks validation chose.
        validation: its benchmarks' names.
        pairs: how many pairs these have.
        tests: names of the benchmarks that guided nothing.
        metric: what the scores are.
        score: of ``recommended`` on validation, the mean over its benchmarks.
        reason: why, in plain sentences, the most important first.
        lowest: the network that scores lowest on validation.
        lowest_score: its score there.
        averaged: whether ``preferred`` is the averaged winner.
        passed_over: the averaged winner, where validation shows it worse than ``lowest``; else None.
        family: among how many comparisons on the tests each ``p`` is corrected.
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
    lowest: str
    lowest_score: float
    averaged: bool = False
    passed_over: str | None = None
    family: int = 0

    @property
    def p_values(self) -> tuple[float, ...]:
        """Of all compared on the tests, each alone; those without an interval are left out."""
        known = (one.tests for one in self.compared if not math.isnan(one.p))
        return tuple(tests.p for tests in known if tests is not None)

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
