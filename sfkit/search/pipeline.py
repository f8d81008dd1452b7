"""Both stages in one call: which sources to merge, then how; everything on disk as it comes."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from sfkit.errors import InputError, SfkitError
from sfkit.evaluation.estimate import Estimate, estimate
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.outcome import Outcome, Scorer
from sfkit.files import write_text
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe
from sfkit.merging.saving import origin_metadata, save_merged
from sfkit.search.breeding import SubsetSettings
from sfkit.search.constraints import Constraints
from sfkit.search.journal import Journal
from sfkit.search.records import Generation, SubsetCandidate
from sfkit.search.routing import RoutingSearch
from sfkit.search.routing_records import RoutingCandidate, RoutingSettings
from sfkit.search.subset import SubsetSearch

Progress = Callable[[str, Generation[Any]], None]


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
    def evaluations(self) -> int:
        """The most evaluations both stages can ask for."""
        first = 0 if self.subset is not None else self.stage1.population * (self.stage1.generations + 1)
        return first + (self.stage2.evaluations if self.stage2 is not None else 0)

    def subset_search(self, pool: Pool, scorer: Scorer, journal: Journal | None = None) -> SubsetSearch:
        """Stage 1 of this plan, ready for its first step."""
        return SubsetSearch(
            pool.names, pool.blocks, scorer, self.stage1, constraints=self.constraints, journal=journal
        )

    def routing_search(
        self, pool: Pool, subset: Sequence[str], scorer: Scorer, journal: Journal | None = None
    ) -> RoutingSearch:
        """Stage 2 of this plan over a subset, ready for its first step."""
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
    """

    recipe: Recipe
    score: float
    stage1: SubsetCandidate | None
    stage2: RoutingCandidate | None
    merged: Path
    folder: Path
    routing: RoutingSearch | None = None


def search_pool(
    pool: Pool,
    scorer: Scorer,
    plan: Plan,
    folder: Path,
    *,
    progress: Progress | None = None,
) -> Found:
    """Run the plan and write what it finds.

    Writes into ``folder``: ``journal.jsonl`` (for viewers), ``stage1.csv`` and ``stage2.csv`` (every
    candidate), ``recipe.json``, ``merged.safetensors`` and ``result.json``. Run again with the same
    store, a finished search is read back and an interrupted one goes on where it was; ``result.json`` names
    no place and no time, so that it is the same to the last byte.

    Raises:
        InputError: constraints or settings do not suit the pool.
        SfkitError: no candidate could be scored.
    """
    plan.check(pool)
    folder.mkdir(parents=True, exist_ok=True)
    journal = Journal(folder / "journal.jsonl")
    subset, first, second = plan.subset, None, None
    stage2: RoutingSearch | None = None
    if subset is None:
        stage1 = plan.subset_search(pool, scorer, journal)
        first = stage1.run(None if progress is None else lambda g: progress("Stage 1", g))
        write_text(folder / "stage1.csv", stage1.history.to_csv(index=False))
        subset = first.subset
    best: SubsetCandidate | RoutingCandidate | None = first
    if plan.stage2 is not None:
        stage2 = plan.routing_search(pool, subset, scorer, journal)
        second = stage2.run(None if progress is None else lambda g: progress("Stage 2", g))
        write_text(folder / "stage2.csv", stage2.history.to_csv(index=False))
        best = second
    if best is None:
        raise InputError("the plan has neither stage, expected something to search")
    write_text(folder / "recipe.json", pool.signed(best.recipe).to_json())
    merged = save_merged(pool, best.recipe, folder / "merged.safetensors", overwrite=True)
    found = Found(best.recipe, best.score, first, second, merged, folder, stage2)
    write_text(folder / "result.json", json.dumps(summary(pool, found), indent=2))
    return found


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
    parts = [estimate(evaluator, recipe, plan.evaluations) for evaluator in evaluators]
    return Estimate(
        plan.evaluations,
        sum(part.seconds_each for part in parts),
        max(part.memory_bytes for part in parts),
        sum(part.images for part in parts),
        min(part.workers for part in parts),
    )
