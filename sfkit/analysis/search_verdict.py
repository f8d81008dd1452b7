"""What a finished search is worth: its networks beside those that need no search, and a verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from sfkit.analysis.comparisons import NetworkComparison, compare_networks
from sfkit.analysis.measured import Measured, measure_with
from sfkit.analysis.verdict import Verdict, verdict
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.table import ProgressCallback
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe

BASE, UNIFORM = "base", "uniform"


@dataclass(frozen=True, eq=False)
class SearchVerdict:
    """A search's networks measured, and what to deploy.

    Attributes:
        measured: the validation benchmarks, then the tests, with base, every source, uniform and the stages.
        single: the source that is best on validation.
        comparison: base, that source, uniform and the stages, each against that source.
        verdict: among all but the base and the other sources.
    """

    measured: tuple[Measured, ...]
    single: str
    comparison: NetworkComparison
    verdict: Verdict

    @property
    def lines(self) -> tuple[str, ...]:
        """The verdict, then a line a network: on validation, on unseen, and against the single source."""
        rows = [("network", "validation", "unseen", f"against {self.comparison.reference}")]
        for row in self.comparison.rows:
            against = "" if row.difference is None else str(row.difference)
            rows.append((row.network, _shown(row.guided), _shown(row.unseen), against))
        wide = [max(len(row[column]) for row in rows) for column in range(3)]
        table = [
            f"  {name:<{wide[0]}}  {guided:>{wide[1]}}  {unseen:>{wide[2]}}  {against}".rstrip()
            for name, guided, unseen, against in rows
        ]
        return (self.verdict.sentence, *table)


def search_verdict(
    pool: Pool,
    stages: Mapping[str, Recipe],
    guides: Sequence[Evaluator],
    tests: Sequence[Evaluator] = (),
    *,
    evaluations: Mapping[str, int] | None = None,
    progress: ProgressCallback | None = None,
) -> SearchVerdict:
    """Measure what a search found beside what needs no search, and say what to deploy.

    Base, single sources and uniform are scored where the store does not have them: N + 2 recipes a benchmark.

    Args:
        pool: whose sources were searched.
        stages: ``Stage 1`` and ``Stage 1+2``, or one of them: what the search found.
        guides: evaluators of the benchmarks that guided it.
        tests: evaluators of benchmarks that guided nothing.
        evaluations: name of a stage -> what finding it took.
        progress: told of each evaluation when it is done.
    """
    singles = {name: pool.equal(name) for name in pool.names}
    recipes = {BASE: pool.base_recipe(), **singles, UNIFORM: pool.uniform(), **stages}
    names = [guide.benchmark.name for guide in guides]
    measured = measure_with([*guides, *tests], recipes, validation=names, progress=progress)
    guided = measured[: len(guides)]
    scores = {name: math.fsum(one.score(name) for one in guided) for name in singles}
    able = {name: score for name, score in scores.items() if math.isfinite(score)} or scores
    single = min(able, key=lambda name: able[name])
    labels = {
        BASE: BASE,
        single: f"best single ({single})",
        UNIFORM: UNIFORM,
        **{name: name for name in stages},
    }
    shown = tuple(
        replace(one, images={label: one.images[name] for name, label in labels.items()}) for one in measured
    )
    rivals = {label: recipes[name] for name, label in labels.items() if name != BASE}
    found = verdict(rivals, shown[: len(guides)], shown[len(guides) :], evaluations=evaluations)
    return SearchVerdict(measured, single, compare_networks(shown, labels[single]), found)


def _shown(score: float) -> str:
    return "" if math.isnan(score) else f"{score:.2f}"
