"""What to search: method, sizes and limits of both stages."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import partial
from typing import Any

from sfkit.errors import InputError, ensure_known
from sfkit.evaluation.combining import CombinedScorer, evaluators_of
from sfkit.evaluation.known import Known, known_evaluations
from sfkit.evaluation.outcome import Scorer
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe
from sfkit.search.averaging import check_averaging
from sfkit.search.bayesian_routing import PROPOSALS, BayesianRoutingSearch
from sfkit.search.bayesian_settings import BayesianRoutingSettings, BayesianSubsetSettings, rounds
from sfkit.search.bayesian_subset import BayesianSubsetSearch
from sfkit.search.breeding import SubsetSettings
from sfkit.search.checks import METHODS, RESAMPLES, check_parts, check_resamples
from sfkit.search.constraints import Constraints
from sfkit.search.encoding import encoding_of
from sfkit.search.journal import Journal
from sfkit.search.routing import RoutingSearch
from sfkit.search.routing_records import RoutingSettings
from sfkit.search.run_folder import NAMES
from sfkit.search.subset import SubsetSearch
from sfkit.settings import require_whole

_SHARED = ("seed", "sigma", "gamma", "tied", "scaled", "rank", "entropy", "shrinkage", "floor")


@dataclass(frozen=True)
class SearchPlan:
    """What to search.

    Attributes:
        subset: sources to route among, which leaves Stage 1 out; None to search for them.
        stage1: settings of the subset search.
        stage2: settings of the routing search; None leaves Stage 2 out.
        constraints: limits for both.
        start: a recipe Stage 2 starts from beside the equal weights.
        resamples: of the validation pairs, whose winners are averaged into the recipe that the search
            returns (:mod:`sfkit.search.averaging`); 0, the paper's form, returns the best on validation.
    """

    subset: tuple[str, ...] | None = None
    stage1: SubsetSettings = field(default_factory=SubsetSettings)
    stage2: RoutingSettings | None = field(default_factory=RoutingSettings)
    constraints: Constraints = field(default_factory=Constraints)
    start: Recipe | None = None
    resamples: int = 0

    def __post_init__(self) -> None:
        # What the check made of it, set around the frozen record.
        object.__setattr__(self, "resamples", check_resamples(self.resamples, self.stage2))
        check_parts(self.subset, self.stage2, self.start)

    @property
    def seed(self) -> int:
        """Of the draws that belong to no stage."""
        return self.stage2.seed if self.subset is not None and self.stage2 is not None else self.stage1.seed

    @property
    def method(self) -> str:
        """Which of ``METHODS`` this is."""
        models = (BayesianSubsetSettings, BayesianRoutingSettings)
        return "bayesian" if isinstance(self.stage1, models) or isinstance(self.stage2, models) else "paper"

    def evaluations(self, names: Sequence[str], blocks: Sequence[str]) -> int:
        """The most evaluations both stages can ask for over these sources; no subset is scored twice.

        The average of resampled winners is one more.

        Of fewer than two sources there is nothing to choose, and Stage 2 alone is counted.

        Raises:
            InputError: constraints that do not suit the sources.
        """
        first = 0
        if self.subset is None and len(names) > 1:
            space = self.constraints.space(tuple(names), tuple(blocks))
            # A subset met again is not scored again: a small space bounds the count.
            first = min(self.stage1.proposals(space), space.subsets + self.stage1.alone(space))
        second = self.stage2.evaluations if self.stage2 is not None else 0
        return first + second + bool(self.resamples)

    def candidates(self, pool: Pool) -> dict[str, int]:
        """``Stage 1``, ``Stage 2`` -> the most candidates it proposes, those met again included."""
        most = {}
        if self.subset is None:
            most["Stage 1"] = self.stage1.proposals(self.constraints.space(pool.names, pool.blocks))
        if self.stage2 is not None:
            most["Stage 2"] = self.stage2.evaluations
        return most

    def by(self, method: str, batch: int = 1) -> SearchPlan:
        """The same search by one of ``METHODS``, in that method's own sizes.

        Args:
            method: ``"paper"`` or ``"bayesian"``.
            batch: candidates the latter proposes at a time. Stage 1 has three rounds of them at least; Stage
                2 keeps its number of evaluations.

        Raises:
            InputError: another word than these, a hold-out for the latter, or a batch for the former.
        """
        ensure_known("method", method, METHODS)
        require_whole("batch", batch, 1)
        if method == "paper" and batch != 1:
            raise InputError(
                f"batch: found {batch} with method paper, whose generations have the population's size; "
                "leave it out or take method bayesian"
            )
        seed, second = self.stage1.seed, self.stage2
        stage1: SubsetSettings = SubsetSettings(seed=seed)
        stage2: RoutingSettings | None = None
        if method == "bayesian":
            stage1 = BayesianSubsetSettings(seed=seed, generations=rounds(batch), batch=batch)
        if second is not None:
            # What is searched stays as it was asked for; sizes are the other method's own.
            kept = {name: getattr(second, name) for name in _SHARED}
            stage2 = RoutingSettings(**kept, holdout=second.holdout)
            if method == "bayesian":
                stage2 = BayesianRoutingSettings(**kept, holdout=second.holdout, batch=batch)
        return replace(self, stage1=stage1, stage2=stage2)

    def averaging(self, pool: Pool, scorer: Scorer) -> SearchPlan:
        """The same search of both stages, but that it returns the average of what wins resamples.

        What a search by a model does where nothing else is asked of it: of its recorded runs that average
        was mostly better on unseen pairs (docs/results.md, "What to return").

        Returns:
            Itself where one stage is left out, or where winners cannot be averaged: Stage 2 chooses by more
            than the score, limits forbid it, or there is one validation pair.

        Raises:
            InputError: as :meth:`check`.
        """
        self.check(pool)
        if self.subset is not None or self.stage2 is None:
            return self
        try:
            found = replace(self, resamples=RESAMPLES)
            found.check(pool)
            found.check_scorer(scorer)
        except InputError:
            # The plan itself passed: whatever is refused here is refused of the average alone.
            return self
        return found

    def known(self, pool: Pool, scorer: Scorer) -> tuple[Known, ...]:
        """What a model may learn from before it proposes anything; nothing for the paper's searches."""
        if self.method == "paper":
            return ()
        return known_evaluations(pool, scorer, self.describe())

    def describe(self) -> dict[str, Any]:
        """What decides what it finds, as plain values."""
        return {
            "stage1": asdict(self.stage1),
            "stage2": self.stage2 and asdict(self.stage2),
            "subset": self.subset,
            "constraints": asdict(self.constraints),
            "start": self.start and self.start.as_dict(),
            # A folder whose answer an earlier rule found keeps it: the same settings propose otherwise now.
            **({"proposals": PROPOSALS} if isinstance(self.stage2, BayesianRoutingSettings) else {}),
            # Left out at 0: searches from before there was this setting keep their identity.
            **({"resamples": self.resamples} if self.resamples else {}),
        }

    def identity(self, pool: Pool, scorer: Scorer) -> dict[str, Any]:
        """What tells this search from others, as JSON values: pool, benchmarks and plan, no place, no time.

        A scorer of another kind than sfkit's own says nothing of itself.
        """
        evaluators = evaluators_of(scorer)
        told = {
            "pool": {"base": pool.base.fingerprint, "sources": pool.identity}
            | ({} if pool.dtype is None else {"dtype": pool.dtype}),
            "partition": pool.partition.fingerprint(),
            "benchmarks": [one.frame for one in evaluators],
            "metrics": [str(one.metric) for one in evaluators],
            NAMES: [one.benchmark.name for one in evaluators],
            "combine": scorer.how if isinstance(scorer, CombinedScorer) else None,
            "method": self.method,
            **self.describe(),
        }
        # Through JSON, as the folder's file gives it back: a tuple and a list would differ.
        known: dict[str, Any] = json.loads(json.dumps(told, sort_keys=True))
        return known

    def subset_search(
        self,
        names: Sequence[str],
        blocks: Sequence[str],
        scorer: Scorer,
        journal: Journal | None = None,
        known: Sequence[Known] = (),
    ) -> SubsetSearch:
        """Stage 1 of this plan over these sources, ready for its first step."""
        make: Callable[..., SubsetSearch] = SubsetSearch
        if isinstance(self.stage1, BayesianSubsetSettings):
            make = partial(BayesianSubsetSearch, known=known)
        return make(names, blocks, scorer, self.stage1, constraints=self.constraints, journal=journal)

    def routing_search(
        self,
        pool: Pool,
        subset: Sequence[str],
        scorer: Scorer,
        journal: Journal | None = None,
        known: Sequence[Known] = (),
    ) -> RoutingSearch:
        """Stage 2 of this plan over a subset, ready for its first step."""
        make: Callable[..., RoutingSearch] = RoutingSearch
        if isinstance(self.stage2, BayesianRoutingSettings):
            make = partial(BayesianRoutingSearch, known=known)
        limits, sources = self.constraints, pool.subset(subset)
        return make(
            sources, pool.blocks, scorer, self.stage2, constraints=limits, start=self.start, journal=journal
        )

    def check(self, pool: Pool) -> None:
        """Refuse before any evaluation what the searches would refuse later.

        Raises:
            InputError: a name the pool does not have, constraints that leave nothing to choose, a subset
                of one source, a start that Stage 2 cannot express or that was made with other networks, or
                limits that an average of winners may not meet.
        """
        if self.start is not None:
            pool.check_networks(self.start)
        subset = self.subset
        if subset is None:
            space = self.constraints.space(pool.names, pool.blocks)
            # Which subset is asked matters nothing here; a smallest one is always at hand.
            first = [*space.required, *space.optional][: space.smallest]
            subset = tuple(pool.names[gene] for gene in sorted(first))
        if self.stage2 is not None:
            encoding = encoding_of(pool.subset(subset), pool.blocks, self.stage2, self.constraints)
            if self.start is not None:
                encoding.admit(self.start)
        if self.resamples and self.subset is None:
            self._check_average(pool)

    def check_scorer(self, scorer: Scorer) -> None:
        """Refuse what guides where winners are averaged and it has no pairs to draw resamples of.

        Raises:
            InputError: as :func:`~sfkit.search.averaging.check_averaging`.
        """
        if self.resamples:
            check_averaging(scorer)

    def _check_average(self, pool: Pool) -> None:
        """Winners of several subsets meet the limits one by one; refuse those that their average may not."""
        limits, second = self.constraints, self.stage2
        able = len(pool.names) - len(limits.exclude)
        if limits.largest is not None and limits.largest < able:
            raise InputError(
                f"largest: found {limits.largest} and resamples {self.resamples}, whose winners together may "
                f"have up to {able} sources; name the subset (--subset), or leave one of the two out"
            )
        if limits.frozen_blocks and second is not None and not second.tied:
            raise InputError(
                f"frozen_blocks: found {', '.join(limits.frozen_blocks)} with block-specific routing and "
                f"resamples {self.resamples}, the average of whose winners has no equal weights there; name "
                "the subset (--subset), or leave one of the two out"
            )
