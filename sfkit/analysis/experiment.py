"""One experiment: a pool, what guides the search, what tests its result, and the budgets.

An ablation changes one of these and leaves the others as they are.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import pandas as pd

from sfkit.analysis.comparisons import ComparedColumn
from sfkit.analysis.measured import Measured, measure_with
from sfkit.datasets.benchmark import Benchmark
from sfkit.datasets.metric import Metric
from sfkit.editing import SeenByHand, seen_by_hand
from sfkit.errors import InputError
from sfkit.evaluation.compute import FIELDS, HERE, Compute
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.metrics import Quantities
from sfkit.evaluation.separation import check_separation
from sfkit.evaluation.store import EvaluationStore
from sfkit.evaluation.table import score_table
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe
from sfkit.search.breeding import SubsetSettings
from sfkit.search.constraints import Constraints
from sfkit.search.records import Counts, SubsetCandidate
from sfkit.search.routing import RoutingCandidate, RoutingSearch
from sfkit.search.routing_records import RoutingSettings
from sfkit.search.subset import SubsetSearch


@dataclass(frozen=True)
class Answer:
    """What a search found.

    Attributes:
        stage1: the best subset, equally weighted.
        stage2: its best mixture; None where Stage 2 was left out.
        counts: evaluations of both stages, by name of the stage.
    """

    stage1: SubsetCandidate
    stage2: RoutingCandidate | None
    counts: Mapping[str, Counts]

    @property
    def subset(self) -> tuple[str, ...]:
        """The chosen sources, in the pool's order."""
        return self.stage1.subset

    @property
    def best(self) -> SubsetCandidate | RoutingCandidate:
        """The last stage's candidate."""
        return self.stage2 or self.stage1

    @property
    def recipe(self) -> Recipe:
        """What to deploy."""
        return self.best.recipe


@dataclass(frozen=True, eq=False)
class Experiment:
    """A pool, its benchmarks, the store and the budgets; the defaults are the paper's.

    Attributes:
        pool: whose sources are merged.
        validation: what guides the searches, with its metric.
        reported: what tests their results; none of its pairs may be among the validation's.
        store: where every evaluation is kept, so that experiments that share a recipe share its score.
        metric: what the tables show of every benchmark that has it; unless given, each benchmark is shown
            under its own.
        population: M of Stage 1.
        generations: T_1 of Stage 1.
        evaluations: N_eval of Stage 2.
        seed: of both stages.
        resamples: of the validation pairs, whose winners a study averages
            (:mod:`sfkit.search.averaging`); 0 leaves that out.
        compute: where and how networks run.
    """

    pool: Pool
    validation: Benchmark
    reported: tuple[Benchmark, ...]
    store: EvaluationStore
    metric: str | None = None
    population: int = 50
    generations: int = 15
    evaluations: int = 300
    seed: int = 0
    compute: Compute = HERE
    resamples: int = 0
    _evaluators: dict[tuple[Any, ...], Evaluator] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        # A tuple of its own: what a caller does to his list must not change a frozen record.
        object.__setattr__(self, "reported", tuple(self.reported))
        if not self.reported:
            raise InputError(
                "experiment: found no reported benchmark, expected at least one that guides no search: name "
                "some in report_on, further pairs of your own too, with ground truth or unlabelled"
            )

    @property
    def common(self) -> str:
        """What every benchmark is counted by beside its own metric: the tables', or the guide's if it can."""
        # The guide's where that needs labels, else the first test's that does.
        told = (one.metric for one in (self.validation, *self.reported))
        by_truth = (metric for metric in told if Metric.parse(metric).needs_truth)
        return self.metric or next(by_truth, self.validation.metric)

    def metric_of(self, benchmark: Benchmark) -> str:
        """What tables show a benchmark by."""
        known = self.metric is not None and benchmark.measurable([self.metric])
        return self.metric if self.metric is not None and known else benchmark.metric

    @property
    def columns(self) -> tuple[Benchmark, ...]:
        """What tables show: what guides, then the reported benchmarks, each set of pairs once."""
        return check_separation(self.validation, self.reported, allow=True).columns

    def scorers(self, also: Sequence[str] = ()) -> tuple[Evaluator, ...]:
        """One evaluator for each of :attr:`columns`, with the metric that tables show it by."""
        return tuple(self.scorer(one, self.metric_of(one), also) for one in self.columns)

    def measured(self, networks: Mapping[str, tuple[Pool, Recipe]]) -> tuple[Measured, ...]:
        """Networks, each of its own pool, on all of :attr:`columns`: the records that tables are made of.

        Raises:
            InputError: a pool of another base or architecture, or a recipe that does not suit its pool.
        """
        scorers, guided = self.scorers(), self.guided
        found: dict[str, tuple[Measured, ...]] = {}
        # Prepared task vectors make a pool of their own, whose recipes are scored together.
        for owner in dict.fromkeys(own for own, _ in networks.values()):
            # By identity, as above: pools do not compare by content.
            recipes = {name: recipe for name, (own, recipe) in networks.items() if own is owner}
            made = measure_with([one.with_pool(owner) for one in scorers], recipes, validation=guided)
            found |= dict.fromkeys(recipes, made)
        first = next(iter(found.values()))
        return tuple(
            replace(one, images={name: found[name][place].of(name) for name in networks})
            for place, one in enumerate(first)
        )

    @property
    def by_hand(self) -> tuple[SeenByHand, ...]:
        """Reported benchmarks whose scores a person saw while editing a recipe, as the store remembers."""
        return seen_by_hand(self.store, self.reported)

    @property
    def guided(self) -> tuple[str, ...]:
        """Benchmarks that are no test: what guides, what shares a pair with it, and :attr:`by_hand`."""
        apart = check_separation(self.validation, self.reported, allow=True)
        return tuple(dict.fromkeys((*apart.guided, *(seen.benchmark for seen in self.by_hand))))

    @property
    def compared(self) -> tuple[ComparedColumn, ...]:
        """:attr:`columns` as heads of tables: name, protocol, metric, unit, whether it guided."""
        metrics = [Metric.parse(self.metric_of(one)) for one in self.columns]
        return tuple(
            ComparedColumn(one.name, one.protocol, metric.name, metric.unit, one.name in self.guided)
            for one, metric in zip(self.columns, metrics, strict=True)
        )

    def changed(self, **fields: Any) -> Experiment:
        """The same experiment with some fields replaced; those of ``compute`` by name: ``device="cuda"``."""
        computing = {name: fields.pop(name) for name in FIELDS if name in fields}
        if computing:
            fields["compute"] = replace(fields.get("compute", self.compute), **computing)
        bound = {"pool", "store"} & fields.keys()  # what every evaluator holds, and no key below names
        return replace(self, _evaluators={} if bound else self._evaluators, **fields)

    def scorer(
        self, benchmark: Benchmark | None = None, metric: str | None = None, also: Sequence[str] = ()
    ) -> Evaluator:
        """An evaluator on this store, made once for its arguments; on validation unless given."""
        chosen = self.validation if benchmark is None else benchmark
        wanted = metric or chosen.metric
        # Whatever tables will ask of the same passes is counted in them.
        asked = (chosen.metric, self.common, *also)
        counted = Quantities.of(wanted, *chosen.measurable(asked))
        # The device is part of ``compute``: on another one it is another evaluator.
        key = (chosen.fingerprint(), chosen.protocol, wanted, counted, self.compute)
        if key not in self._evaluators:
            kept: dict[str, Any] = {"store": self.store, "compute": self.compute}
            self._evaluators[key] = Evaluator(self.pool, chosen, metric=wanted, also=asked, **kept)
        return self._evaluators[key]

    def stage1(
        self,
        scorer: Evaluator | None = None,
        *,
        constraints: Constraints | None = None,
        start: Sequence[Sequence[str]] = (),
    ) -> SubsetSearch:
        """Stage 1, run to its end."""
        settings = SubsetSettings(population=self.population, generations=self.generations, seed=self.seed)
        over = (self.pool.names, self.pool.blocks, scorer or self.scorer(), settings)
        search = SubsetSearch(*over, constraints=constraints, start=start)
        search.run()
        return search

    def stage2(
        self, subset: Sequence[str], scorer: Evaluator | None = None, **settings: Any
    ) -> RoutingSearch:
        """Stage 2 over a subset, run to its end; ``settings`` as :class:`RoutingSettings` takes them."""
        chosen = RoutingSettings(**{"evaluations": self.evaluations, "seed": self.seed, **settings})
        search = RoutingSearch(subset, self.pool.blocks, scorer or self.scorer(), chosen)
        search.run()
        return search

    def answer(
        self, scorer: Evaluator | None = None, *, subset: Sequence[str] | None = None, routing: bool = True
    ) -> Answer:
        """Both stages, or Stage 2 alone where a ``subset`` is given; Stage 1 alone without ``routing``."""
        chosen = scorer or self.scorer()
        counts: dict[str, Counts] = {}
        if subset is None:
            search = self.stage1(chosen)
            # It is done by now: this names its best.
            first, counts["Stage 1"] = search.run(), search.counts
        else:
            first = self._given(subset, chosen)
        if not routing:
            return Answer(first, None, counts)
        second = self.stage2(first.subset, chosen)
        counts["Stage 2"] = second.counts
        return Answer(first, second.run(), counts)

    def scores(self, recipes: Mapping[str, Recipe], metrics: Sequence[str] = ()) -> pd.DataFrame:
        """One row a (network, benchmark, metric), validation first, as ``score_recipes`` gives them.

        ``metrics`` are those of :meth:`metric_of` unless given. All of :attr:`guided` have the role
        ``validation``.
        """
        return score_table(self.scorers(metrics), recipes, metrics=metrics, validation=self.guided)

    def _given(self, subset: Sequence[str], scorer: Evaluator) -> SubsetCandidate:
        recipe = self.pool.equal(*subset)
        # As any candidate is scored, so that the store may know it.
        (outcome,) = scorer([recipe])
        return SubsetCandidate(
            number=0,
            generation=0,
            recipe=recipe,
            outcome=outcome,
            repeated=False,
            chromosome=recipe.sources,
            parents=(),
            operators=("start",),
        )


def overlap(one: Sequence[str], other: Sequence[str]) -> float:
    """Share of sources two subsets have in common, of all that are in either (Jaccard), in [0, 1]."""
    union = set(one) | set(other)
    return len(set(one) & set(other)) / len(union) if union else math.nan
