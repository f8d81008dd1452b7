"""Model-based Stage 1 on the table of all subsets of the bank."""

from __future__ import annotations

from collections.abc import Sequence
from importlib import import_module
from typing import Any

from processes import shown

DOCUMENT = "benchmarks/README.md"
FEWER = 40
"""Seeds of batches of several, whose searches are longer."""


def section() -> str:
    """Both landscapes."""
    bayesian = import_module("bayesian")
    landscapes = [
        [
            *bayesian.compare(bayesian.SEEDS, (1,), quick=quick),
            *bayesian.compare(FEWER, bayesian.BATCHES[1:], quick=quick),
        ]
        for quick in (False, True)
    ]
    return text(*landscapes)


def text(whole: Sequence[Any], quick: Sequence[Any]) -> str:
    """The section from its rows."""
    table = import_module("bayesian").table
    return f"""## Model-based search against the true optimum

`{shown("bayesian.py")}`: `BayesianSubsetSearch` on the scores of all subsets of the bank's 11 sources, all of
which it scores alone first, at a cost. Evaluations until the best subset was found; rounds count how often
workers wait for one another, as many as a batch has. On the first 20 validation pairs:

{table(whole)}

On the first 8 pairs, which are noisier:

{table(quick)}"""
