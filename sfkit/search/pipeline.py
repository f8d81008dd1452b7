"""Both stages in one call: which sources to merge, then how; everything on disk as it comes."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from sfkit.errors import InputError, SfkitError, unknown_name
from sfkit.evaluation.combining import CombinedScorer
from sfkit.evaluation.estimating import Estimate, estimate
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.known import Known, known_evaluations
from sfkit.evaluation.outcome import Outcome, Scorer
from sfkit.evaluation.written import ensure_as_scored
from sfkit.files import write_text
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe
from sfkit.merging.saving import origin_metadata, save_merged
from sfkit.search.bayesian_routing import BayesianRoutingSearch, BayesianRoutingSettings
from sfkit.search.bayesian_subset import BayesianSubsetSearch, BayesianSubsetSettings
from sfkit.search.breeding import SubsetSettings
from sfkit.search.constraints import Constraints
from sfkit.search.journal import Journal
from sfkit.search.records import Generation, SubsetCandidate
from sfkit.search.routing import RoutingSearch
from sfkit.search.routing_records import RoutingCandidate, RoutingSettings
from sfkit.search.run_folder import RunFolder, run_folder
from sfkit.search.subset import SubsetSearch

METHODS = ("paper", "bayesian")
"""Ways to search: StereoFactory's two algorithms, or a model of the score in both stages."""
_PROPOSED = BayesianSubsetSettings().generations
_SHARED = ("seed", "gamma", "tied", "scaled", "rank", "entropy", "shrinkage", "floor")

StageCallback = Callable[[str, Generation[Any]], None]
JudgeCallback = Callable[["Found"], Mapping[str, Any]]


@dataclass(frozen=True)
class Plan:
    """What to search.

    Attributes:
        subset: sources to route among, which leaves Stage 1 out; None to search for them.
        stage1: settings of the subset search.
        stage2: settings of the routing search; None leaves Stage 2 out.
        constraints: limits for both.
        start: a recipe Stage 2 starts from beside the equal weights.
    """

    subset: tuple[str, ...] | None = None
    stage1: SubsetSettings = field(default_factory=SubsetSettings)
    stage2: RoutingSettings | None = field(default_factory=RoutingSettings)
    constraints: Constraints = field(default_factory=Constraints)
    start: Recipe | None = None

    def __post_init__(self) -> None:
        if self.subset is not None and self.stage2 is None:
            raise InputError("found a subset and no Stage 2, expected something to search")
        if self.subset is None and self.start is not None:
            raise InputError(
                "found a recipe to start Stage 2 from and no subset, expected both: Stage 1 may find another "
                "subset than the recipe's"
            )

    @property
    def method(self) -> str:
        """Which of ``METHODS`` this is."""
        models = (BayesianSubsetSettings, BayesianRoutingSettings)
        return "bayesian" if isinstance(self.stage1, models) or isinstance(self.stage2, models) else "paper"

    def evaluations(self, pool: Pool) -> int:
        """The most evaluations both stages can ask for; no subset is scored twice."""
        first = 0
        if self.subset is None:
            search = self.subset_search(pool, _nobody)
            first = min(search.most, search.space.subsets)
        return first + (self.stage2.evaluations if self.stage2 is not None else 0)

    def by(self, method: str, batch: int = 1) -> Plan:
        """The same search by one of ``METHODS``, in that method's own sizes.

        Args:
            method: ``"paper"`` or ``"bayesian"``.
            batch: candidates the latter proposes at a time.

        Raises:
            InputError: another word than these, or a hold-out for the latter.
        """
        if method not in METHODS:
            raise unknown_name("method", method, METHODS)
        seed, second = self.stage1.seed, self.stage2
        stage1: SubsetSettings = SubsetSettings(seed=seed)
        stage2: RoutingSettings | None = None
        if method == "bayesian":
            stage1 = BayesianSubsetSettings(seed=seed, generations=-(-_PROPOSED // batch), batch=batch)
        if second is not None:
            kept = {name: getattr(second, name) for name in _SHARED}
            stage2 = RoutingSettings(**kept, holdout=second.holdout)
            if method == "bayesian":
                stage2 = BayesianRoutingSettings(**kept, holdout=second.holdout, batch=batch)
        return replace(self, stage1=stage1, stage2=stage2)

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
        }

    def identity(self, pool: Pool, scorer: Scorer) -> dict[str, Any]:
        """What tells this search from others, as JSON values: pool, benchmarks and plan, no place, no time.

        A scorer of another kind than sfkit's own says nothing of itself.
        """
        parts = scorer.evaluators if isinstance(scorer, CombinedScorer) else (scorer,)
        told = {
            "pool": {"base": pool.base.fingerprint, "sources": pool.identity},
            "partition": pool.partition.fingerprint(),
            "benchmarks": [part.frame for part in parts if isinstance(part, Evaluator)],
            "metrics": [str(part.metric) for part in parts if isinstance(part, Evaluator)],
            "combine": scorer.how if isinstance(scorer, CombinedScorer) else None,
            "method": self.method,
            **self.describe(),
        }
        known: dict[str, Any] = json.loads(json.dumps(told, sort_keys=True))
        return known

    def subset_search(
        self, pool: Pool, scorer: Scorer, journal: Journal | None = None, known: Sequence[Known] = ()
    ) -> SubsetSearch:
        """Stage 1 of this plan, ready for its first step."""
        names, limits = pool.names, self.constraints
        if isinstance(self.stage1, BayesianSubsetSettings):
            return BayesianSubsetSearch(
                names, pool.blocks, scorer, self.stage1, constraints=limits, known=known, journal=journal
            )
        return SubsetSearch(names, pool.blocks, scorer, self.stage1, constraints=limits, journal=journal)

    def routing_search(
        self,
        pool: Pool,
        subset: Sequence[str],
        scorer: Scorer,
        journal: Journal | None = None,
        known: Sequence[Known] = (),
    ) -> RoutingSearch:
        """Stage 2 of this plan over a subset, ready for its first step."""
        if isinstance(self.stage2, BayesianRoutingSettings):
            return BayesianRoutingSearch(
                pool.subset(subset),
                pool.blocks,
                scorer,
                self.stage2,
                constraints=self.constraints,
                start=self.start,
                known=known,
                journal=journal,
            )
        return RoutingSearch(
            pool.subset(subset),
            pool.blocks,
            scorer,
            self.stage2,
            constraints=self.constraints,
            start=self.start,
            journal=journal,
        )

    def check(self, pool: Pool) -> None:
        """Refuse before any evaluation what the searches would refuse later.

        Raises:
            InputError: a name the pool does not have, constraints that leave nothing to choose, a subset
                of one source, or a start that Stage 2 cannot express.
        """
        subset = self.subset
        if subset is None:
            space = self.subset_search(pool, _nobody).space
            first = [*space.required, *space.optional][: space.smallest]
            subset = tuple(pool.names[gene] for gene in sorted(first))
        if self.stage2 is not None:
            # Nobody knows images, and needs to hold none out to be asked for names and numbers.
            whole = replace(self, stage2=replace(self.stage2, holdout=0))
            whole.routing_search(pool, subset, _nobody)


def _with_own(known: Sequence[Known], stage1: SubsetSearch) -> tuple[Known, ...]:
    """What was known before, and what Stage 1 measured, each recipe once."""
    own = [Known(c.recipe, c.score) for c in stage1.candidates if not (c.repeated or c.failed)]
    return tuple({entry.recipe: entry for entry in (*known, *own)}.values())


def _nobody(recipes: Sequence[Recipe]) -> Sequence[Outcome]:
    """A scorer for searches that are made to be checked, and never take a step."""
    raise SfkitError(f"a plan that is being checked scores nothing, found {len(recipes)} recipes")


@dataclass(frozen=True)
class Found:
    """What a search found, and where it lies.

    Attributes:
        recipe: the best recipe.
        score: its score on the validation benchmark, in the metric's unit.
        stage1: Stage 1's best; None where it was left out.
        stage2: Stage 2's best; None where it was left out.
        merged: the merged network's file.
        folder: where journal, tables and recipe lie.
        routing: the finished search of Stage 2; None where it was left out.
        stages: ``Stage 1``, ``Stage 1+2``, as far as they were run -> recipe; equal weights of the subset
            and ``Stage 2`` where the subset was given.
        evaluations: the same names -> recipes that finding each took, in the store before or not.
    """

    recipe: Recipe
    score: float
    stage1: SubsetCandidate | None
    stage2: RoutingCandidate | None
    merged: Path
    folder: Path
    routing: RoutingSearch | None = None
    stages: Mapping[str, Recipe] = field(default_factory=dict)
    evaluations: Mapping[str, int] = field(default_factory=dict)


def search_pool(
    pool: Pool,
    scorer: Scorer,
    plan: Plan,
    folder: Path | RunFolder,
    *,
    progress: StageCallback | None = None,
    force: bool = False,
    judge: JudgeCallback | None = None,
) -> Found:
    """Run the plan and write what it finds.

    Writes into ``folder``: ``journal.jsonl`` (for viewers), ``stage1.csv`` and ``stage2.csv`` (every
    candidate), ``recipe.json``, ``merged.safetensors`` and ``result.json``. Run again with the same
    store, a finished search is read back and an interrupted one goes on where it was; ``result.json`` names
    no place and no time, so that it is the same to the last byte. It is written last: ``judge`` hears what
    was found before, and what it says stands in there too.

    Args:
        pool: whose sources are chosen and mixed.
        scorer: what guides.
        plan: what to search.
        folder: where to write, or a folder that the caller holds already.
        progress: hears of every generation.
        force: whether what another search left in the folder may be replaced.
        judge: says on what was found what ``result.json`` holds besides.

    Raises:
        InputError: constraints or settings do not suit the pool, or the folder is another search's
            (:func:`~sfkit.search.run_folder.run_folder`).
        SfkitError: no candidate could be scored, or the written file is not what was scored
            (:func:`~sfkit.evaluation.written.ensure_as_scored`).
    """
    plan.check(pool)
    if isinstance(folder, RunFolder):
        return _search(pool, scorer, plan, folder.path, progress, judge)
    with run_folder(folder, plan.identity(pool, scorer), force=force) as run:
        return _search(pool, scorer, plan, run.path, progress, judge)


def _search(
    pool: Pool,
    scorer: Scorer,
    plan: Plan,
    folder: Path,
    progress: StageCallback | None,
    judge: JudgeCallback | None,
) -> Found:
    journal = Journal(folder / "journal.jsonl")
    subset, first, second, known = plan.subset, None, None, plan.known(pool, scorer)
    stage2: RoutingSearch | None = None
    stages: dict[str, Recipe] = {}
    spent: dict[str, int] = {}
    if subset is None:
        stage1 = plan.subset_search(pool, scorer, journal, known)
        first = stage1.run(None if progress is None else lambda g: progress("Stage 1", g))
        write_text(folder / "stage1.csv", stage1.history.to_csv(index=False))
        subset = first.subset
        stages["Stage 1"], spent["Stage 1"] = first.recipe, stage1.counts.distinct
        known = _with_own(known, stage1)
    else:
        stages["equal weights"], spent["equal weights"] = pool.equal(*subset), 1
    best: SubsetCandidate | RoutingCandidate | None = first
    if plan.stage2 is not None:
        stage2 = plan.routing_search(pool, subset, scorer, journal, known)
        second = stage2.run(None if progress is None else lambda g: progress("Stage 2", g))
        write_text(folder / "stage2.csv", stage2.history.to_csv(index=False))
        best, name = second, "Stage 2" if first is None else "Stage 1+2"
        stages[name], spent[name] = second.recipe, stage2.counts.distinct + spent.get("Stage 1", 0)
    if best is None:
        raise InputError("the plan has neither stage, expected something to search")
    write_text(folder / "recipe.json", pool.signed(best.recipe).to_json())
    merged = save_merged(pool, best.recipe, folder / "merged.safetensors", overwrite=True)
    ensure_as_scored(pool, best.recipe, scorer, merged)
    found = Found(best.recipe, best.score, first, second, merged, folder, stage2, stages, spent)
    write_result(pool, found, {} if judge is None else judge(found))
    return found


def write_result(pool: Pool, found: Found, judged: Mapping[str, Any]) -> Path:
    """Write ``result.json``: the summary, and what was judged of it."""
    return write_text(found.folder / "result.json", json.dumps({**summary(pool, found), **judged}, indent=2))


def summary(pool: Pool, found: Found) -> dict[str, Any]:
    """Plain values: scores, subset, recipe, where its parts come from, and the merged file's name."""
    origin = {
        key.removeprefix("sfkit."): json.loads(v) for key, v in origin_metadata(pool, found.recipe).items()
    }
    return {
        "pool": pool.name,
        "score": found.score,
        "stage1": found.stage1.score if found.stage1 else None,
        "stage2": found.stage2.score if found.stage2 else None,
        "subset": list(found.recipe.sources),
        "recipe": pool.signed(found.recipe).as_dict(),
        "origin": {key: origin[key] for key in ("architecture", "base", "sources")},
        "merged": found.merged.name,
    }


def cost(pool: Pool, evaluators: Sequence[Evaluator], plan: Plan, subset: Iterable[str] = ()) -> Estimate:
    """What the plan will cost at most: one timed evaluation on each validation benchmark."""
    recipe = pool.equal(*(plan.subset or tuple(subset) or pool.names))
    most = plan.evaluations(pool)
    parts = [estimate(evaluator, recipe, most) for evaluator in evaluators]
    return Estimate(
        most,
        sum(part.seconds_each for part in parts),
        max(part.memory_bytes for part in parts),
        sum(part.images for part in parts),
        min(part.workers for part in parts),
    )
