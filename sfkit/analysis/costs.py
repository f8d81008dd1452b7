"""What a search cost: evaluations and seconds, stage by stage."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import pandas as pd

from sfkit.errors import InputError
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
    """

    stage: str
    computed: int
    cached: int
    repeated: int
    failed: int
    seconds: float
    seconds_saved: float

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
            computed=counts.distinct - counts.cached,
            cached=counts.cached,
            repeated=counts.repeated,
            failed=counts.failed,
            seconds=counts.seconds,
            seconds_saved=counts.seconds_saved,
        )
        for name, counts in stages.items()
    )


def cost_table(costs: Sequence[StageCost]) -> pd.DataFrame:
    """A row a stage and their total: candidates, evaluations by origin, seconds."""
    total = StageCost(
        stage="total",
        computed=sum(cost.computed for cost in costs),
        cached=sum(cost.cached for cost in costs),
        repeated=sum(cost.repeated for cost in costs),
        failed=sum(cost.failed for cost in costs),
        seconds=math.fsum(cost.seconds for cost in costs),
        seconds_saved=math.fsum(cost.seconds_saved for cost in costs),
    )
    rows = [
        {
            "stage": cost.stage,
            "candidates": cost.candidates,
            "computed": cost.computed,
            "from the store": cost.cached,
            "repeated": cost.repeated,
            "failed": cost.failed,
            "seconds spent": cost.seconds,
            "seconds saved": cost.seconds_saved,
        }
        for cost in (*costs, total)
    ]
    return pd.DataFrame(rows).set_index("stage")
