"""Stage 2 in numbers: scores, routing weights, module scales and the search distribution by evaluation."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from sfkit.analysis.drawn_points import LIMIT, drawn_points
from sfkit.errors import InputError
from sfkit.search.bayesian_routing import BayesianRoutingSearch
from sfkit.search.journal import JournalledSearch, journalled_score
from sfkit.search.routing import RoutingSearch

Floats = NDArray[np.float64]
Whole = NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class RoutingTrace:
    """What the figures of Stage 2 draw; n evaluations, B blocks, E sources, D dimensions.

    Attributes:
        sources: the E names.
        blocks: the B names, in the partition's order.
        gamma: lowest and highest module scale the search allows.
        metric: of the scores, such as ``bad-1.0``; None where it is not known.
        generation: (n,) the iteration that made each evaluation; 0 is x = 0 and the start.
        score: (n,) the validation metric; ``inf`` where the candidate failed.
        penalised: (n,) what the best is chosen by: score plus penalties, or the held-out score plus
            penalties; ``inf`` where it failed, and for the folds' candidates once their average is scored.
        weights: (n, B, E) routing weights, rows on the simplex.
        scales: (n, B) module scales.
        sigma: (n,) step size of the distribution each was drawn from; by a model, the trust region's radius.
        axes: (n, D) standard deviations along its principal axes, ascending.
        by_model: whether a model proposed the candidates, and not CMA-ES.
    """

    sources: tuple[str, ...]
    blocks: tuple[str, ...]
    gamma: tuple[float, float]
    metric: str | None
    generation: Whole
    score: Floats
    penalised: Floats
    weights: Floats
    scales: Floats
    sigma: Floats
    axes: Floats
    by_model: bool = False

    def __len__(self) -> int:
        return len(self.score)

    @property
    def tied(self) -> bool:
        """True where in every recipe all blocks share one row of weights."""
        return bool((self.weights == self.weights[:, :1]).all())

    @cached_property
    def incumbent(self) -> Whole:
        """(n,) number of the best evaluation up to each one, ties to the earlier; -1 where all failed."""
        best, held = math.inf, -1
        numbers = np.empty(len(self), dtype=np.int64)
        for number, value in enumerate(self.penalised):
            if value < best:
                best, held = float(value), number
            numbers[number] = held
        return numbers

    @property
    def best(self) -> int:
        """Number of the best evaluation; -1 where all failed."""
        return int(self.incumbent[-1])

    def drawn(self, limit: int = LIMIT) -> Whole:
        """Numbers of at most ``limit`` evaluations to draw: new incumbents and an even choice."""
        # -1 before the first: the first finite score is a new best, too.
        changes = np.flatnonzero(np.diff(self.incumbent, prepend=-1))
        return drawn_points(len(self), changes.tolist(), limit)

    def iterations(self, limit: int = LIMIT) -> Whole:
        """Numbers of the first evaluations of fewer than ``limit`` generations, and of the very last one."""
        # -1 before the first: generation 0 begins at evaluation 0.
        first = np.flatnonzero(np.diff(self.generation, prepend=-1))
        return np.union1d(first[drawn_points(len(first), limit=limit - 1)], [len(self) - 1])


def routing_trace(search: RoutingSearch, *, metric: str | None = None) -> RoutingTrace:
    """The record of a running or finished Stage 2 search.

    Args:
        search: has finished at least x = 0.
        metric: what the scores are, for labels.

    Raises:
        InputError: nothing is finished yet.
    """
    candidates = search.state.candidates
    if not candidates:
        raise InputError("routing search: found no evaluation yet, expected at least one: call step() first")
    return RoutingTrace(
        sources=search.sources,
        blocks=search.blocks,
        gamma=search.settings.gamma,
        metric=metric,
        generation=np.array([c.generation for c in candidates], dtype=np.int64),
        score=np.array([c.score for c in candidates]),
        penalised=_chosen_by([(c.criterion, c.fold, c.origin) for c in candidates]),
        weights=np.array([c.recipe.weights for c in candidates]),
        scales=np.array([c.recipe.scales for c in candidates]),
        sigma=np.array([c.sigma for c in candidates]),
        axes=np.array([c.axes for c in candidates]),
        by_model=isinstance(search, BayesianRoutingSearch),
    )


def watched_routing(records: Iterable[Mapping[str, Any]], *, metric: str | None = None) -> RoutingTrace:
    """The record of a Stage 2 search that runs elsewhere, from its journal.

    Args:
        records: what :func:`~sfkit.search.journal.read_journal` returned.
        metric: what the scores are, for labels.

    Raises:
        InputError: the journal holds no generation of Stage 2.
    """
    found = JournalledSearch.begun(records, RoutingSearch.kind)
    entries, gamma = found.candidates, found.settings["gamma"]
    # Journals from before there was a hold-out choose by the penalised score.
    by = "criterion" if "criterion" in entries[0] else "penalised"
    return RoutingTrace(
        sources=found.sources,
        blocks=found.blocks,
        gamma=(float(gamma[0]), float(gamma[1])),
        metric=metric,
        generation=np.array([entry["generation"] for entry in entries], dtype=np.int64),
        score=np.array([journalled_score(entry) for entry in entries], dtype=np.float64),
        penalised=_chosen_by([(journalled_score(e, by), e.get("fold"), e["origin"]) for e in entries]),
        weights=np.array([entry["weights"] for entry in entries], dtype=np.float64),
        scales=np.array([entry["scales"] for entry in entries], dtype=np.float64),
        sigma=np.array([entry["sigma"] for entry in entries], dtype=np.float64),
        axes=np.array(found.axes, dtype=np.float64),
        by_model=found.by_model,
    )


def _chosen_by(candidates: Sequence[tuple[float, int | None, str]]) -> Floats:
    """Criteria by (criterion, fold, origin); an average leaves only those of all validation pairs."""
    averaged = any(origin == "average" for _, _, origin in candidates)
    out = [math.inf if averaged and fold is not None else value for value, fold, _ in candidates]
    return np.array(out, dtype=np.float64)
