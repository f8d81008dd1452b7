"""mergekit at our tasks: the same sums over the same tensors. ``make bench`` installs it."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import torch
from mergekit.merge_methods.api import merge_state_dicts

if TYPE_CHECKING:
    from memory import RandomPool

METHODS = ("linear", "task_arithmetic")


def mergekit_work(world: RandomPool, method: str) -> Callable[[], dict[str, torch.Tensor]]:
    """An equal-weight merge of all sources by mergekit, checked once and ready to be timed.

    ``linear`` adds the base and the weighted task vectors, which is our sum. ``task_arithmetic`` takes the
    difference from the base itself: what it is given as models are the same buffers, so that no more has to
    lie in memory; with weights that sum to one the base cancels.

    Raises:
        SystemExit: mergekit's result is not that sum.
    """
    weight = 1 / len(world.vectors)
    base = world.layout.views(world.base)
    models: dict[str, Any] = {
        name: world.layout.views(vector) for name, vector in zip(world.names, world.vectors, strict=True)
    }
    weights: dict[str, float] = dict.fromkeys(models, weight)
    if method == "linear":
        weights["base"] = 1.0
    options: dict[str, Any] = {"weight": weights, "normalize": False}

    def work() -> dict[str, torch.Tensor]:
        with torch.inference_mode():
            return merge_state_dicts(
                {"base": base, **models},
                method,
                parameters=options,
                base=None if method == "linear" else "base",
            )

    found = work()
    for key in list(base)[::37]:
        expected = sum(weight * model[key].double() for model in models.values())
        if method == "linear":
            expected = expected + base[key].double()
        if not torch.allclose(found[key].double(), expected, atol=1e-5):
            raise SystemExit(f"mergekit {method}: {key} is not the sum it was asked for")
    return work
