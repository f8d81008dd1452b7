"""The verdict at the end of ``sfkit search``, and what it took beside the search."""

from __future__ import annotations

import shlex
from collections.abc import Mapping, Sequence
from typing import Any

from sfkit.analysis.search_verdict import SearchVerdict, search_verdict
from sfkit.cli.terminal import Bars, say
from sfkit.evaluation.evaluator import Evaluator
from sfkit.merging import Pool, Recipe
from sfkit.search.averaging import AVERAGED
from sfkit.search.pipeline import SearchResult
from sfkit.search.run_folder import BEST


class Judge:
    """Says the verdict on what was found, and counts what that took apart from the search."""

    def __init__(self, pool: Pool, guides: Sequence[Evaluator], tests: Sequence[Evaluator]) -> None:
        self._pool, self._guides, self._tests = pool, guides, tests
        self.before: dict[str, float | None] = {}
        self.document: dict[str, Any] = {}
        self._verdict: SearchVerdict | None = None

    def __call__(self, found: SearchResult) -> Mapping[str, Any]:
        self.before = _counts(self._guides)
        say(f"verdict: beside base, {len(self._pool.names)} sources and uniform")
        with Bars(keep=False) as bars:
            self._verdict = search_verdict(
                self._pool,
                found.stages,
                self._guides,
                self._tests,
                evaluations=found.evaluations,
                progress=lambda benchmark, done, total: bars(f"verdict on {benchmark}", done, total),
            )
        self.document = {"verdict": self._verdict.as_dict()}
        return self.document

    @property
    def own(self) -> dict[str, float | None]:
        """What was counted since the search ended: for the verdict, and for how far to trust its guide."""
        both = _counts([*self._guides, *self._tests])
        return {name: _less(value, self.before[name]) for name, value in both.items()}

    def lines(self, found: SearchResult) -> list[str]:
        """The verdict; and how to get its network where the search wrote another."""
        assert self._verdict is not None
        recipe, name = self._verdict.recipe, self._verdict.verdict.recommended
        return [
            *self._verdict.lines,
            *([] if recipe == found.recipe else [other_network(found, recipe, name)]),
        ]


def other_network(found: SearchResult, recipe: Recipe, name: str) -> str:
    """What the written file is, and the command that writes the recommended network; for a POSIX shell."""
    how, what = f"--subset {shlex.quote(','.join(recipe.sources))}", "what the search found"
    if found.recipe != found.best:
        what = f"the {AVERAGED}"
        if recipe == found.best:
            how = f"--recipe {shlex.quote(str(found.folder / BEST))}"
    return f"{found.merged} is {what}; for {name}: sfkit merge POOL {how} --out FILE"


def _counts(evaluators: Sequence[Evaluator]) -> dict[str, float | None]:
    """What these evaluators did, together; None where that is not known of one of them."""
    every = [vars(one.counts) for one in evaluators]
    return {
        name: None if any(counts[name] is None for counts in every) else sum(counts[name] for counts in every)
        for name in every[0]
    }


def _less(value: float | None, before: float | None) -> float | None:
    return None if value is None or before is None else value - before
