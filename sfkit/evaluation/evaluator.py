"""The evaluator: finds recipes in the store, has missing ones computed, writes before it tells."""

from __future__ import annotations

import copy
import math
import warnings
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import Any

from sfkit.datasets.benchmark import Benchmark
from sfkit.datasets.metric import Metric
from sfkit.errors import InputError, SfkitWarning
from sfkit.evaluation.compute import HERE, Compute
from sfkit.evaluation.engines import Engine, Result, Runner, check_pool
from sfkit.evaluation.metrics import ImageErrors, Quantities
from sfkit.evaluation.outcome import Outcome, Part, total_known
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.evaluation.separation import trained_on
from sfkit.evaluation.store import Evaluation, EvaluationStore, evaluation_key
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe


@dataclass
class EvaluatorCounts:
    """What an evaluator has done so far; CPU seconds are its workers' too, None once one's are not known."""

    computed: int = 0
    cached: int = 0
    failed: int = 0
    image_passes: int = 0
    seconds: float = 0.0
    cpu_seconds: float | None = 0.0


class Evaluator:
    """Scores a pool's recipes on one benchmark; a :class:`~sfkit.evaluation.outcome.Scorer`.

    Args:
        pool: whose networks are merged.
        benchmark: pairs, protocol and default metric.
        store: where evaluations are kept; a store that keeps nothing without one.
        metric: ``"bad-1.0"``, ``"d1"``, ``"epe"``, ...; the benchmark's own by default.
        also: further metrics that will be asked of the same evaluations, for what must be counted; on pairs
            without ground truth those that need none.
        retry_failed: whether candidates recorded as failed are tried again.
        compute: where and how networks run.
        shorthand: fields of :class:`~sfkit.evaluation.compute.Compute` that replace those of ``compute``:
            ``device="cuda:0"``, ``engine="processes", workers=4``, ``precision="bfloat16"``.

    Attributes:
        listen: when a search asks, told the numbers of recipes that are done and that were asked for.

    Warns (:class:`~sfkit.errors.SfkitWarning`) where pairs look wrong, such as left and right exchanged, and
    where a member of the pool was trained on them, as its file tells.

    Raises:
        InputError: the benchmark cannot be evaluated as it is (missing files, no valid pixel, a mask the
            protocol needs), before any network runs; or a device or engine that cannot be had.
    """

    def __init__(
        self,
        pool: Pool,
        benchmark: Benchmark,
        *,
        store: EvaluationStore | None = None,
        metric: str | None = None,
        also: Sequence[str] = (),
        retry_failed: bool = False,
        compute: Compute = HERE,
        **shorthand: Any,
    ) -> None:
        self.compute = replace(compute, **shorthand)
        check_pool(self.compute.engine, pool)
        self.pool = pool
        self.benchmark = benchmark
        self.metric = Metric.parse(metric or benchmark.metric)
        if not isinstance(store, EvaluationStore | None):
            raise InputError(f"store: found {store!r}, expected an EvaluationStore: EvaluationStore(path)")
        self.store = EvaluationStore(":memory:") if store is None else store
        self.retry_failed = retry_failed
        self.splits: tuple[frozenset[int], ...] = ()
        self.counts = EvaluatorCounts()
        self.listen: Callable[[int, int], None] | None = None
        self.quantities = Quantities.of(self.metric, *benchmark.measurable(also))
        inputs = pool.architecture.inputs(pool.options)
        self.prepared = PreparedBenchmark(benchmark, inputs, self.quantities)
        self._runner = Runner(pool, self.prepared, self.compute)
        for doubt in (self.prepared.doubt(), trained_on(pool, benchmark)):
            if doubt:
                warnings.warn(doubt, SfkitWarning, stacklevel=2)
        # All that decides a score but the recipe, in content: no name, no place, no number of workers.
        self.frame: dict[str, Any] = {
            "base": pool.base.fingerprint,
            "architecture": pool.describe(),
            "benchmark": self.prepared.fingerprint,
            "protocol": benchmark.protocol,
            "family": benchmark.family,
            "resolution": benchmark.resolution,
            **self.compute.mode.describe(),
            "device": self.compute.kind,
            **self.quantities.describe(),
        }

    @property
    def engine(self) -> Engine:
        """Runs what the store does not have; its workers start with the first recipe."""
        return self._runner.engine

    @property
    def device(self) -> str:
        """Where networks run."""
        return self.compute.device

    def with_store(self, store: EvaluationStore) -> Evaluator:
        """The same evaluator on another store, its counts at 0, with an engine of its own; images are shared.

        A store's file comes into being when it is opened, so that a caller who wants none to be left by a
        refused benchmark makes the evaluator first and opens the store then.
        """
        return self._elsewhere(self.pool, store)

    def with_pool(self, pool: Pool) -> Evaluator:
        """The same evaluator on another pool of the same base and architecture, such as a prepared one.

        Images and store are shared, its counts are at 0 and it has an engine of its own.

        Raises:
            InputError: another base or architecture, or a pool that the engine's workers could not open.
        """
        if pool is self.pool:
            return self
        if pool.base.fingerprint != self.frame["base"] or pool.describe() != self.frame["architecture"]:
            raise InputError(
                f"pool {pool.name!r}: has another base or architecture than pool {self.pool.name!r}, "
                "expected the same: make a new Evaluator for it"
            )
        check_pool(self.compute.engine, pool)
        return self._elsewhere(pool, self.store)

    def with_splits(self, splits: Sequence[Iterable[int]]) -> Evaluator:
        """The same evaluator, whose outcomes also tell scores on images held out from a search.

        Evaluations are of all images as before, under the same keys; engine, store and counts are shared.

        Args:
            splits: of each split, the numbers of the images held out, from 0 in the benchmark's order.
        """
        other = copy.copy(self)
        # The copy is shallow on purpose: engine, store and counts stay one.
        other.splits = tuple(frozenset(split) for split in splits)
        return other

    def release(self) -> None:
        """Let go of networks and workers; they are made again when the next recipe has to be computed."""
        self._runner.release()

    def __enter__(self) -> Evaluator:
        return self

    def __exit__(self, *_: object) -> None:
        self.release()

    def describe(self, recipe: Recipe) -> dict[str, Any]:
        """Everything that decides a recipe's scores, in content; its digest is the evaluation's key."""
        return {**self.frame, "recipe": self.pool.canonical(recipe)}

    def __call__(self, recipes: Sequence[Recipe]) -> list[Outcome]:
        """One outcome a recipe, in order.

        Raises:
            InputError: more is better by the metric, which a search would minimise.
        """
        if not self.metric.lower_is_better:
            raise InputError(
                f"metric {self.metric}: more of it is better, and what guides a search is minimised, "
                "expected a metric of which less is better"
            )
        return [self.outcome(evaluation) for evaluation in self.evaluate(recipes, progress=self.listen)]

    def evaluate(
        self, recipes: Sequence[Recipe], *, progress: Callable[[int, int], None] | None = None
    ) -> list[Evaluation]:
        """The evaluations of recipes, from the store or computed and stored; equal recipes run once.

        Args:
            recipes: what to evaluate.
            progress: called with the numbers of distinct recipes that are done and that there are, first
                for those in the store, then after each that was computed.

        Raises:
            InputError: a recipe does not suit the pool, or the network's code or a file of the pool has
                changed since this was made.
        """
        self._ensure_same_code()
        self.pool.ensure_unchanged()
        if isinstance(recipes, Recipe):
            raise InputError("evaluate: found one recipe, expected a list of them: evaluate([recipe])")
        descriptions = [self.describe(recipe) for recipe in recipes]
        keys = [evaluation_key(description) for description in descriptions]
        known: dict[str, Evaluation] = {}
        missing: dict[str, int] = {}
        for number, key in enumerate(keys):
            # A recipe that was asked for twice is looked up once.
            held = self.store.get(key) if key not in known and key not in missing else None
            if held is not None and not (held.failure and self.retry_failed):
                known[key] = held
                self.counts.cached += 1
            elif key not in known:
                missing.setdefault(key, number)
        numbers, total = list(missing.values()), len(known) + len(missing)
        if progress is not None:
            progress(len(known), total)
        # Taken after the store was asked: what it has is told while another thread computes.
        with self._runner.busy:
            for position, result in self.engine.run([recipes[n] for n in numbers]) if numbers else ():
                key = keys[numbers[position]]
                # Stored before anybody is told: a search that is killed now finds it again.
                known[key] = self._record(key, descriptions[numbers[position]], result)
                if progress is not None:
                    progress(len(known), total)
        return [known[key] for key in keys]

    def missing(self, recipes: Sequence[Recipe]) -> int:
        """How many of these recipes the store does not hold, equal ones once."""
        keys = {evaluation_key(self.describe(recipe)) for recipe in recipes}
        return sum(self.store.get(key) is None for key in keys)

    def score(self, images: Sequence[ImageErrors], metric: str | Metric | None = None) -> float:
        """A benchmark score from per-image errors under the benchmark's protocol, in the metric's unit."""
        return self.benchmark.rule.aggregate(images, metric or self.metric)

    def outcome(self, evaluation: Evaluation) -> Outcome:
        """What a search is told of an evaluation."""
        score = math.inf if evaluation.failure else self.score(evaluation.images)
        splits = () if evaluation.failure else self.splits
        parts = tuple(self._part(evaluation.images, held) for held in splits)
        return Outcome(
            score,
            evaluation.seconds,
            evaluation.cached,
            evaluation.failure,
            evaluation.key,
            parts,
            evaluation.cpu_seconds,
        )

    def _ensure_same_code(self) -> None:
        if self.pool.describe() != self.frame["architecture"]:
            raise InputError(
                f"architecture {self.pool.architecture.name!r}: its code has changed since this evaluator "
                "was made, whose network is that of before: open the pool and make the evaluator again (or "
                "pass version= to register_architecture where the change does not matter)"
            )

    def _elsewhere(self, pool: Pool, store: EvaluationStore) -> Evaluator:
        other = copy.copy(self)
        other.pool, other.store, other.counts = pool, store, EvaluatorCounts()
        # An engine's workers hold the networks of one pool.
        other._runner = Runner(pool, self.prepared, self.compute)
        return other

    def _part(self, images: Sequence[ImageErrors], held: frozenset[int]) -> Part:
        groups = [[image for n, image in enumerate(images) if (n in held) is out] for out in (False, True)]
        guiding, rest = (self.score(group) if group else math.nan for group in groups)
        return Part(guiding, rest)

    def _record(self, key: str, description: dict[str, Any], result: Result) -> Evaluation:
        self.pool.ensure_unchanged()  # what was computed meanwhile belongs to nobody knows which file
        worked = result.cpu_seconds
        fresh = Evaluation(
            key, description, result.images, result.failure, result.seconds, cpu_seconds=worked
        )
        held = self.store.put(fresh)
        self.counts.computed += 1
        self.counts.failed += result.failure is not None
        self.counts.image_passes += len(result.images)
        self.counts.seconds += result.seconds
        self.counts.cpu_seconds = total_known([self.counts.cpu_seconds, worked])
        return replace(held, cached=False)
