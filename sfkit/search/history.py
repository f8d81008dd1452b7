"""Histories as tables: one row a candidate, in the order of creation."""

from __future__ import annotations

from collections.abc import Sequence

import pandas as pd

from sfkit.search.records import SubsetCandidate
from sfkit.search.routing_records import RoutingCandidate

COMMON = ("candidate", "generation", "subset", "size", "score", "failed", "error")
"""Columns every history starts with."""

ORIGIN = ("cached", "repeated", "seconds", "key")
"""Columns that tell where a score came from."""


def subset_history(
    candidates: Sequence[SubsetCandidate], populations: Sequence[Sequence[int]]
) -> pd.DataFrame:
    """Table of a Stage 1 search.

    Columns: ``candidate`` (number, from 0), ``generation`` (from 0), ``subset`` (tuple of names in the
    pool's order), ``size``, ``score`` (the benchmark's unit; inf where it failed), ``failed``, ``error``
    (None where it did not fail), ``cached`` (from the evaluation store), ``repeated`` (asked for before
    by this search), ``seconds`` (what the evaluation took when it was computed), ``key`` (in the store),
    ``chromosome`` (tuple of names in the order of the genes), ``parents`` (tuple of numbers),
    ``operators`` (tuple, in order), ``survived`` (True where the candidate is in the population of its
    own generation).
    """
    survived = [set(population) for population in populations]
    rows = [
        {**candidate.as_record(), "survived": candidate.number in survived[candidate.generation]}
        for candidate in candidates
    ]
    columns = [*COMMON, *ORIGIN, "chromosome", "parents", "operators", "survived"]
    return pd.DataFrame(rows, columns=columns)


def routing_history(
    candidates: Sequence[RoutingCandidate], sources: Sequence[str], blocks: Sequence[str], dimension: int
) -> pd.DataFrame:
    """Table of a Stage 2 search.

    Columns: ``candidate`` (number of the evaluation, from 0: x = 0), ``generation`` (the iteration of
    CMA-ES; 0 is x = 0 and the start), ``subset``, ``size``, ``score`` (the benchmark's unit; inf where it
    failed), ``failed``, ``error``, ``cached``, ``repeated``, ``seconds``, ``key`` as in Stage 1;
    ``origin`` ("equal", "start", "sample" or "average"), ``penalty`` (lambda times the mean entropy, eq. 13,
    and the shrinkage), ``fold`` (which split it belongs to; None without a hold-out), ``guiding`` and
    ``held`` (score on the pairs that guide the search and on those held out; None without), ``penalised``
    (guiding + penalty, what the search minimises), ``sigma`` (step size that it was sampled with),
    ``axis:<i>`` (standard deviations along the principal axes of that distribution, ascending),
    ``weight:<block>:<source>`` (routing weights) and ``scale:<block>`` (module scales).
    """
    rows = [_routing_row(candidate) for candidate in candidates]
    axes = [f"axis:{i}" for i in range(dimension)]
    weights = [f"weight:{block}:{source}" for block in blocks for source in sources]
    scales = [f"scale:{block}" for block in blocks]
    own = ["origin", "penalty", "fold", "guiding", "held", "penalised", "sigma"]
    return pd.DataFrame(rows, columns=[*COMMON, *ORIGIN, *own, *axes, *weights, *scales])


def _routing_row(candidate: RoutingCandidate) -> dict[str, object]:
    recipe = candidate.recipe
    row: dict[str, object] = candidate.as_record()
    row |= {f"axis:{i}": length for i, length in enumerate(candidate.axes)}
    for block in recipe.blocks:
        weights, scale = recipe.of(block)
        row |= {f"weight:{block}:{source}": weight for source, weight in weights.items()}
        row[f"scale:{block}"] = scale
    return row
