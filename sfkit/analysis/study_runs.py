"""Methods that draw: how often each is run in a comparison, and what all runs took together."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from sfkit.analysis.costs import MethodCost
from sfkit.baselines import BaselineResult

AVERAGE = "averaged"
"""The method whose network the verdict prefers, where it was run."""
AGAIN = ("random_subsets", "stage1", "stage1_2", AVERAGE)
"""Methods that are run once a seed."""
DRAWING = ("dare", "dare_ties")
"""Methods that draw several networks in one run."""


def with_draws(settings: Mapping[str, Mapping[str, Any]], seeds: int) -> dict[str, Mapping[str, Any]]:
    """Settings by method: ``DRAWING`` draw as often as the stages have seeds, unless they say otherwise."""
    drawing = {name: {"draws": seeds, **settings.get(name, {})} for name in DRAWING}
    return {**settings, **drawing}


def costs_of(runs: Mapping[str, BaselineResult]) -> tuple[MethodCost, ...]:
    """What each method took: its runs from several seeds summed, the draws of one run counted once.

    Args:
        runs: network name -> result; draws of one run share its history.
    """
    methods: dict[str, dict[int, BaselineResult]] = {}
    for result in runs.values():
        methods.setdefault(result.label, {})[id(result.history)] = result
    return tuple(
        MethodCost(
            label,
            sum(one.evaluations for one in found.values()),
            sum(one.image_passes for one in found.values()),
            math.fsum(one.seconds for one in found.values()),
            len(found),
        )
        for label, found in methods.items()
    )
