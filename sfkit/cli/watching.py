"""How far a search is, as bars or lines: by evaluations within a generation, by generations on the whole."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

from sfkit.cli.terminal import Bars

if TYPE_CHECKING:
    from sfkit.evaluation import Evaluator
    from sfkit.search.records import Generation


class Watch(Bars):
    """Shows every generation of both stages.

    Args:
        most: stage -> the most candidates it proposes.
        evaluators: of the validation benchmarks, which tell of each network while this is open.
    """

    def __init__(self, most: Mapping[str, int], evaluators: Sequence[Evaluator]) -> None:
        super().__init__()
        self._most, self._evaluators = most, evaluators

    def __enter__(self) -> Watch:
        if self._drawn:
            listen(self, self._evaluators)
            # A bar from the start: the first generation may take minutes.
            first = next(iter(self._most))
            super().__call__(first, 0, self._most[first])
        return self

    def __exit__(self, *error: object) -> None:
        # They outlive these bars, which must not be moved any more.
        for evaluator in self._evaluators:
            evaluator.listen = None
        super().__exit__(*error)

    def generation(self, stage: str, generation: Generation[Any]) -> None:
        """So much is done."""
        from sfkit.search.progress import generation_note

        counts, note = generation.counts, generation_note(generation)
        line = f"{stage}, generation {generation.number}: {note}; {counts.distinct} scored, "
        line += f"{counts.cached} of them cached"
        # A model that knew many before counts them too: the bar is full then, and not fuller.
        most = max(self._most[stage], counts.candidates)
        self(stage, counts.candidates, most, note, line=line)


def listen(bars: Bars, evaluators: Sequence[Evaluator]) -> None:
    """Let bars move with every network that is scored: on several benchmarks, one after the other."""

    def advance(number: int, done: int, total: int) -> None:
        bars.within((number * total + done) / len(evaluators), total)

    for number, evaluator in enumerate(evaluators):
        evaluator.listen = partial(advance, number)
