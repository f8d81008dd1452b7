"""What a search cost: evaluations and seconds, stage by stage."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import pandas as pd

from sfkit.errors import InputError
from sfkit.evaluation.outcome import total_known
from sfkit.search.records import Counts


@dataclass(frozen=True)
class StageCost:
    """Evaluations of one stage; every proposed candidate is in exactly one of the first three.

    Attributes:
        stage: its name.
        computed: evaluations that ran now, failed ones included.
        cached: evaluations that came from the store.
        repeated: candidates the search had already asked for, which cost nothing.
        failed: of the computed and cached ones, those without a finite score.
        seconds: evaluation time spent now.
        seconds_saved: what the cached ones took when they were computed.
        cpu_seconds: what the computed ones took of processors; None where nobody measured that.
        cpu_seconds_saved: the same of the cached ones.
    """

    stage: str
    computed: int
    cached: int
    repeated: int
    failed: int
    seconds: float
    seconds_saved: float
    cpu_seconds: float | None = None
    cpu_seconds_saved: float | None = None

    @property
    def candidates(self) -> int:
        """All the stage proposed."""
        return self.computed + self.cached + self.repeated


def stage_costs(stages: Mapping[str, Counts]) -> tuple[StageCost, ...]:
    """The cost of each stage, from the counts of its search, in the order given.

    Raises:
        InputError: no stage.
    """
    if not stages:
        raise InputError("cost: found no stage, expected name -> counts of at least one search")
    return tuple(
        StageCost(
            stage=name,
            # What was neither asked for before nor in the store ran now.
            computed=counts.distinct - counts.cached,
            cached=counts.cached,
            repeated=counts.repeated,
            failed=counts.failed,
            seconds=counts.seconds,
            seconds_saved=counts.seconds_saved,
            cpu_seconds=counts.cpu_seconds,
            cpu_seconds_saved=counts.cpu_seconds_saved,
        )
        for name, counts in stages.items()
    )


def total_cost(costs: Sequence[StageCost]) -> StageCost:
    """What stages took together; CPU seconds are None as soon as those of one are."""
    numbers = ("computed", "cached", "repeated", "failed")
    return StageCost(
        "total",
        **{name: sum(getattr(cost, name) for cost in costs) for name in numbers},
        seconds=math.fsum(cost.seconds for cost in costs),
        seconds_saved=math.fsum(cost.seconds_saved for cost in costs),
        cpu_seconds=total_known(cost.cpu_seconds for cost in costs),
        cpu_seconds_saved=total_known(cost.cpu_seconds_saved for cost in costs),
    )


def cost_table(costs: Sequence[StageCost]) -> pd.DataFrame:
    """A row a stage and their total: candidates, evaluations by origin, seconds (NaN: unknown)."""
    total = total_cost(costs)
    rows = [
        {
            "stage": cost.stage,
            "candidates": cost.candidates,
            "computed": cost.computed,
            "from the store": cost.cached,
            "repeated": cost.repeated,
            "failed": cost.failed,
            "wall seconds spent": cost.seconds,
            "CPU seconds spent": or_unknown(cost.cpu_seconds),
            "wall seconds saved": cost.seconds_saved,
            "CPU seconds saved": or_unknown(cost.cpu_seconds_saved),
        }
        for cost in (*costs, total)
    ]
    return pd.DataFrame(rows).set_index("stage")


@dataclass(frozen=True)
class MethodCost:
    """What a whole method costs from nothing, whatever a store held.

    Attributes:
        method: its name.
        evaluations: distinct recipes it had scored.
        image_passes: forward passes over one pair each.
        seconds: their wall time, that of evaluations from the store as it was when they were computed.
        runs: how many runs, such as from several seeds, these are the sums of.
        cpu_seconds: what all that took of processors; None where nobody measured one of its evaluations.
    """

    method: str
    evaluations: int
    image_passes: int
    seconds: float
    runs: int = 1
    cpu_seconds: float | None = None


def check_seconds(training: Mapping[str, float], joint: float | None) -> None:
    """Refuse times that no training took, before anything is measured beside them.

    Args:
        training: source -> wall seconds its fine-tuning took; nothing where that is not known.
        joint: wall seconds of one training on all sources' data, where that was done.

    Raises:
        InputError: one that is not positive, or the joint training's alone.
    """
    # Not "<= 0", which NaN would pass.
    if joint is not None and not joint > 0.0:
        raise InputError(f"cost: found {joint} seconds of joint retraining, expected a positive number")
    if any(not seconds > 0.0 for seconds in training.values()):
        raise InputError(
            f"cost: found the trainings {dict(training)}, expected positive seconds for each source"
        )
    if joint is not None and not training:
        raise InputError(
            f"cost: found {joint} seconds of joint retraining, none of any fine-tuning, expected both"
        )


TUNING, JOINT = "fine-tuning the sources", "joint retraining"
"""The trainings that methods are set beside."""
_SHARES = {TUNING: "overhead [%]", JOINT: "of joint retraining [%]"}


@dataclass(frozen=True)
class Overhead:
    """What methods take beside trainings.

    Attributes:
        costs: of the methods.
        trainings: ``TUNING``, after ``JOINT`` where that was done -> wall seconds.
        worked: the same in CPU seconds, of those where that is known.
    """

    costs: tuple[MethodCost, ...]
    trainings: Mapping[str, float]
    worked: Mapping[str, float] = field(default_factory=dict)

    def share(self, cost: MethodCost, training: str) -> float:
        """A method's wall time in percent of a training's."""
        return 100.0 * cost.seconds / self.trainings[training]

    def table(self) -> pd.DataFrame:
        """A row a training, then a row a method: evaluations, image passes, seconds, percent of each.

        Percentages are of wall seconds; CPU seconds stand beside them and are divided by nothing.
        """
        shares = {label: name for name, label in _SHARES.items() if name in self.trainings}
        rows = [
            {"method": name, "wall seconds": seconds, "CPU seconds": self.worked.get(name, math.nan)}
            for name, seconds in self.trainings.items()
        ] + [
            {
                "method": cost.method,
                "evaluations": cost.evaluations,
                "image passes": cost.image_passes,
                "wall seconds": cost.seconds,
                "CPU seconds": or_unknown(cost.cpu_seconds),
                **{label: self.share(cost, name) for label, name in shares.items()},
            }
            for cost in self.costs
        ]
        columns = ["method", "evaluations", "image passes", "wall seconds", "CPU seconds", *shares]
        table = pd.DataFrame(rows, columns=columns).set_index("method")
        # A training's row has no evaluations, which would turn the others into fractions.
        return table.astype({"evaluations": "Int64", "image passes": "Int64"})


def overhead(
    costs: Sequence[MethodCost],
    training: Mapping[str, float],
    joint: float | None = None,
    *,
    training_cpu: Mapping[str, float] | None = None,
    joint_cpu: float | None = None,
) -> Overhead:
    """What methods cost beside the fine-tuning of their sources, as in the paper's table of costs.

    The paper divides by the time of joint retraining. Where that is known its share stands beside; the
    overhead to the trainings the pool is made of is always there, and says so.

    Args:
        costs: from :func:`~sfkit.analysis.worth.method_costs`.
        training: source -> wall seconds its fine-tuning took, such as ``sfkit.bank.training_seconds()``; on
            the same kind of machine as the methods' wall seconds, or the overhead means nothing.
        joint: wall seconds of one training on all sources' data, where that was done.
        training_cpu: source -> CPU seconds of its fine-tuning, where that is known of all.
        joint_cpu: CPU seconds of that joint training, where they are known.

    Raises:
        InputError: no training, or one without a positive time.
    """
    if not training:
        raise InputError("cost: found no training, expected positive seconds for each source")
    check_seconds(training, joint)
    trainings = {} if joint is None else {JOINT: joint}
    tuned = total_known((training_cpu or {}).get(source) for source in training)
    worked = {name: value for name, value in ((JOINT, joint_cpu), (TUNING, tuned)) if value is not None}
    return Overhead(tuple(costs), {**trainings, TUNING: math.fsum(training.values())}, worked)


def overhead_table(
    costs: Sequence[MethodCost],
    training: Mapping[str, float],
    joint: float | None = None,
    **cpu: Any,
) -> pd.DataFrame:
    """The table of :func:`overhead`, with its arguments and errors."""
    return overhead(costs, training, joint, **cpu).table()


def or_unknown(value: float | None) -> float:
    """A number for a table; NaN, which tables show as a dash, where it is not known."""
    return math.nan if value is None else value
