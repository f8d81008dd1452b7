"""Hand edits: who looks at scores while editing is a search, too, and its benchmark is no test any more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sfkit.datasets.benchmark import Benchmark
from sfkit.evaluation.separation import all_identities, identities, seen_in
from sfkit.evaluation.store import HAND_EDIT, EvaluationStore


@dataclass(frozen=True)
class SeenByHand:
    """Hand edits that were scored on pairs a benchmark holds.

    Attributes:
        benchmark: name of the reported benchmark.
        edits: how many edited recipes were scored.
        pairs: ids of its pairs that they were scored on.
    """

    benchmark: str
    edits: int
    pairs: tuple[str, ...]

    def __str__(self) -> str:
        recipes, were = ("1 recipe", "was") if self.edits == 1 else (f"{self.edits} recipes", "were")
        return (
            f"{self.benchmark}: {recipes} edited by hand {were} scored on {len(self.pairs)} of its pairs; "
            "a person chose by them, so they are no test."
        )


def mark_hand_edit(store: EvaluationStore, key: str, benchmark: Benchmark) -> None:
    """Remember in the store that the evaluation ``key`` on a benchmark is of a recipe edited by hand."""
    # Pair by pair: a report may test on a part of them, or on them under another name.
    seen = [identity for pair in benchmark.pairs for identity in identities(pair)]
    store.mark(key, HAND_EDIT, "\n".join(sorted(seen)))


def seen_by_hand(store: EvaluationStore, reported: Sequence[Benchmark]) -> tuple[SeenByHand, ...]:
    """The reported benchmarks whose pairs hand edits of this store were scored on; empty where none was."""
    marks = [frozenset(detail.splitlines()) for _, detail in store.marks(HAND_EDIT)]
    shared = seen_in(frozenset().union(*marks), reported)
    edits = {
        b.name: sum(bool(seen & all_identities(b)) for seen in marks) for b in reported if b.name in shared
    }
    return tuple(SeenByHand(name, edits[name], ids) for name, ids in shared.items())
