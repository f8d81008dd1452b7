"""What a finished search is worth: its networks beside those that need no search, and a verdict."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from sfkit.analysis.comparisons import NetworkComparison, compare_networks
from sfkit.analysis.measured import Measured, measure_with
from sfkit.analysis.verdict import Verdict, verdict
from sfkit.datasets.benchmark_record import Benchmark
from sfkit.evaluation.combining import CombinedScorer, evaluators_of
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.separation import under_one_unit
from sfkit.evaluation.table import ProgressCallback
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe
from sfkit.search.averaging import AVERAGED

BASE, UNIFORM = "base", "uniform"
WIDTH, MIN_WIDTH = 80, 26
"""Characters of a line, and at least of a column of names, where lines are made to be read in a terminal."""


@dataclass(frozen=True)
class Missing:
    """What a verdict costs at most.

    Attributes:
        evaluations: recipes that are yet to be scored, summed over benchmarks.
        passes: image pairs through a network for that.
    """

    evaluations: int
    passes: int

    def __str__(self) -> str:
        return f"at most {self.evaluations:,} evaluations more, {self.passes:,} image pairs through a network"


@dataclass(frozen=True, eq=False)
class SearchVerdict:
    """A search's networks measured, and what to deploy.

    Attributes:
        measured: the validation benchmarks, then the tests, with base, every source, uniform and the stages.
        single: the source that is best on validation.
        comparison: base, that source, uniform and the stages, each against that source.
        verdict: among all but the base and the other sources.
        recipes: network name -> recipe, of all that the verdict chose among.
    """

    measured: tuple[Measured, ...]
    single: str
    comparison: NetworkComparison
    verdict: Verdict
    recipes: Mapping[str, Recipe]

    @property
    def recipe(self) -> Recipe:
        """Of the network the verdict recommends."""
        return self.recipes[self.verdict.recommended]

    def as_dict(self) -> dict[str, object]:
        """Plain values, for ``result.json``: the verdict, and every network's scores and difference."""
        networks = {
            row.network: {
                # JSON has no NaN.
                "validation": _finite(row.guided),
                "unseen": _finite(row.unseen),
                "difference": None if row.difference is None else _finite(row.difference.value),
                "interval": None if row.difference is None else row.difference.interval,
            }
            for row in self.comparison.rows
        }
        return {
            **self.verdict.as_dict(),
            "sources": list(self.recipe.sources),
            "tests": list(self.verdict.tests),
            "reference": self.comparison.reference,
            "networks": networks,
        }

    @property
    def lines(self) -> tuple[str, ...]:
        """The verdict, then a line a network: on validation, on unseen, and against the single source."""
        rows = [("network", "validation", "unseen", f"against {self.comparison.reference}")]
        for row in self.comparison.rows:
            against = "" if row.difference is None else row.difference.short
            rows.append((row.network, _shown(row.guided), _shown(row.unseen), against))
        first, guided, unseen = (max(len(row[column]) for row in rows) for column in range(3))
        last = max(MIN_WIDTH, *(len(row[3]) for row in rows[1:]))
        # The names give way: numbers that are cut would be wrong numbers.
        first = min(first, max(MIN_WIDTH, WIDTH - guided - unseen - last - 8))
        table = [
            f"  {_cut(one, first):<{first}}  {two:>{guided}}  {three:>{unseen}}  {_cut(four, last)}".rstrip()
            for one, two, three, four in rows
        ]
        found = [row.difference for row in self.comparison.rows if row.difference is not None]
        notes = [f"  no interval: {one.reason}" for one in found if one.reason]
        notes += [
            f"  within noise though its interval leaves 0 out: {one.allowance}"
            for one in found
            if one.allowance
        ]
        # Each note once, of however many networks it is told.
        return (self.verdict.sentence, *table, *dict.fromkeys(notes))


def _cut(text: str, width: int) -> str:
    return text if len(text) <= width else f"{text[: width - 1]}…"


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

    Base, single sources and uniform are scored where the store does not have them; see :func:`missing`.
    Where benchmarks with ground truth and without guide together, those with it judge: scores of unlike
    metrics have no mean.

    Args:
        pool: whose sources were searched.
        stages: ``Stage 1``, ``Stage 1+2``, ``averaged winner``, or some of them: what the search found.
        guides: evaluators of the benchmarks that guided it.
        tests: evaluators of benchmarks that guided nothing, each of another name.
        evaluations: name of a stage -> what finding it took.
        progress: told of each evaluation when it is done.
    """
    recipes = {**pool.alone(), UNIFORM: pool.uniform(), **stages}
    able = _judging(guides)
    names = [guide.benchmark.name for guide in able]
    measured = measure_with([*able, *tests], recipes, validation=names, progress=progress)
    guided = measured[: len(able)]
    scores = {name: math.fsum(one.score(name) for one in guided) for name in pool.names}
    # Where every source failed one of them is shown nevertheless.
    finite = {name: score for name, score in scores.items() if math.isfinite(score)} or scores
    single = min(finite, key=lambda name: finite[name])
    labels = {
        BASE: BASE,
        single: f"best single ({single})",
        UNIFORM: UNIFORM,
        **{name: name for name in stages},
    }
    shown = [
        replace(one, images={label: one.images[name] for name, label in labels.items()}) for one in measured
    ]
    # The base is there to be compared with; deployed it is no result of a merge.
    rivals = {label: recipes[name] for name, label in labels.items() if name != BASE}
    comparison = compare_networks(shown, labels[single])
    found = verdict(
        rivals,
        shown[: len(guided)],
        shown[len(guided) :],
        evaluations=evaluations,
        averaged=AVERAGED,
        beside=comparison.p_values if tests else (),
    )
    return SearchVerdict(measured, single, comparison.among(found.p_values), found, rivals)


def missing(pool: Pool, guides: Sequence[Evaluator], tests: Sequence[Evaluator], stages: int = 2) -> Missing:
    """What :func:`search_verdict` will evaluate at most: what no store holds yet, and the stages on tests.

    Args:
        pool: whose sources are searched.
        guides: evaluators of the benchmarks that guide.
        tests: evaluators of those that do not.
        stages: how many recipes the search will bring.
    """
    known = [*pool.alone().values(), pool.uniform()]
    counts = [(one, one.missing(known)) for one in _judging(guides)]
    counts += [(one, one.missing(known) + stages) for one in tests]
    return Missing(
        sum(count for _, count in counts), sum(count * len(one.benchmark) for one, count in counts)
    )


def judges(
    scorer: Evaluator | CombinedScorer, benchmarks: Sequence[Benchmark]
) -> tuple[list[Evaluator], list[Evaluator]]:
    """Evaluators for :func:`search_verdict`: of what guides, and of tests with the same store and compute.

    Args:
        scorer: what guides a search.
        benchmarks: the tests; see :func:`under_one_unit` for the metrics.
    """
    known = list(evaluators_of(scorer))
    metrics = [str(guide.metric) for guide in known]
    pool, store, compute = known[0].pool, known[0].store, known[0].compute
    tests = under_one_unit(metrics, benchmarks)
    return known, [Evaluator(pool, test, store=store, compute=compute) for test in tests]


def _judging(guides: Sequence[Evaluator]) -> list[Evaluator]:
    """The guides with ground truth; all where there is none."""
    return [guide for guide in guides if guide.metric.needs_truth] or list(guides)


def _shown(score: float) -> str:
    return "" if math.isnan(score) else f"{score:.2f}"


def _finite(value: float) -> float | None:
    return value if math.isfinite(value) else None
