"""Hand edits: who looks at scores while editing is a search, too, and its benchmark is no test any more."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from sfkit.datasets.benchmark import Benchmark
from sfkit.evaluation.separation import identities
from sfkit.evaluation.store import EvaluationStore

HAND_EDIT = "hand edit"


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


def pairs_in_common(benchmark: Benchmark, reported: Sequence[Benchmark]) -> dict[str, tuple[str, ...]]:
    """Reported benchmark -> ids of its pairs that ``benchmark`` holds as well, where there are any."""
    seen = {identity for pair in benchmark.pairs for identity in identities(pair)}
    shared = {other.name: tuple(p.id for p in other.pairs if seen & identities(p)) for other in reported}
    return {name: ids for name, ids in shared.items() if ids}


def mark_hand_edit(store: EvaluationStore, key: str, benchmark: Benchmark) -> None:
    """Remember in the store that the evaluation ``key`` on a benchmark is of a recipe edited by hand."""
    seen = sorted(identity for pair in benchmark.pairs for identity in identities(pair))
    store.mark(key, HAND_EDIT, "\n".join(seen))


def seen_by_hand(store: EvaluationStore, reported: Sequence[Benchmark]) -> tuple[SeenByHand, ...]:
    """The reported benchmarks whose pairs hand edits of this store were scored on; empty where none was."""
    marks = [frozenset(detail.splitlines()) for _, detail in store.marks(HAND_EDIT)]
    found = []
    for benchmark in reported:
        own = {pair.id: identities(pair) for pair in benchmark.pairs}
        edits = sum(any(seen & those for those in own.values()) for seen in marks)
        pairs = tuple(name for name, those in own.items() if any(seen & those for seen in marks))
        if edits:
            found.append(SeenByHand(benchmark.name, edits, pairs))
    return tuple(found)
