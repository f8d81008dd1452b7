"""Both stages in one call: which sources to merge, then how; everything on disk as it comes."""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from sfkit.errors import InputError, SfkitWarning
from sfkit.evaluation.estimating import Estimate, estimate
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.known import Known
from sfkit.evaluation.outcome import Scorer
from sfkit.evaluation.written import ensure_as_scored
from sfkit.files import write_text
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe
from sfkit.merging.saving import origin_metadata, save_merged
from sfkit.search.averaging import AVERAGED, Averaged, averaged_winner
from sfkit.search.base import Search
from sfkit.search.journal import Journal
from sfkit.search.plan import SearchPlan
from sfkit.search.records import Generation, SubsetCandidate
from sfkit.search.routing import RoutingSearch
from sfkit.search.routing_records import RoutingCandidate
from sfkit.search.run_folder import BEST, WINNERS, RunFolder, run_folder
from sfkit.search.subset import SubsetSearch

StageCallback = Callable[[str, Generation[Any]], None]
JudgeCallback = Callable[["SearchResult"], Mapping[str, Any]]


def _with_own(known: Sequence[Known], stage1: SubsetSearch) -> tuple[Known, ...]:
    """What was known before, and what Stage 1 measured, each recipe once."""
    # A repeated one is the same network again, and a failed one has no score to learn from.
    own = [Known(c.recipe, c.score) for c in stage1.candidates if not (c.repeated or c.failed)]
    return tuple({entry.recipe: entry for entry in (*known, *own)}.values())


@dataclass(frozen=True)
class SearchResult:
    """What a search found, and where it lies.

    Attributes:
        recipe: the best recipe; with ``resamples`` the averaged winner.
        score: its score on the validation benchmark, in the metric's unit.
        stage1: Stage 1's best; None where it was left out.
        stage2: Stage 2's best; None where it was left out.
        merged: the merged network's file.
        folder: where journal, tables and recipe lie.
        routing: the finished search of Stage 2; None where it was left out.
        stages: ``Stage 1``, ``Stage 1+2``, as far as they were run -> recipe; equal weights of the subset
            and ``Stage 2`` where the subset was given; ``averaged winner`` where resamples were asked for.
        averaged: the winners of these and their average; None where none were asked for.
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
    averaged: Averaged | None = None

    @property
    def best(self) -> Recipe:
        """What scores best on validation, which :attr:`recipe` is not where winners were averaged."""
        found = self.stage2 or self.stage1
        return self.recipe if found is None else found.recipe


def search_pool(
    pool: Pool,
    scorer: Scorer,
    plan: SearchPlan,
    folder: Path | RunFolder,
    *,
    progress: StageCallback | None = None,
    force: bool = False,
    judge: JudgeCallback | None = None,
) -> SearchResult:
    """Run the plan and write what it finds.

    Writes into ``folder``: ``journal.jsonl`` (for viewers), ``stage1.csv`` and ``stage2.csv`` (every
    candidate), ``recipe.json``, ``merged.safetensors`` and ``result.json``. With ``resamples`` these three
    are of the averaged winner, ``winners.csv`` tells what was averaged, and ``best.json`` is the recipe that
    scores best on validation. Run again with the same store, a finished search is read back and an
    interrupted one goes on where it was; ``result.json`` names no place and no time, so that it is the same
    to the last byte. It is written last: ``judge`` is given what was found before, and what it says stands in
    there too.

    Args:
        pool: whose sources are chosen and mixed.
        scorer: what guides.
        plan: what to search.
        folder: where to write, or a folder that the caller holds already.
        progress: called for every generation.
        force: whether what another search left in the folder may be replaced.
        judge: says on what was found what ``result.json`` holds besides.

    Raises:
        InputError: constraints or settings do not suit the pool or the scorer, or the folder is another
            search's (:func:`~sfkit.search.run_folder.run_folder`).
        SfkitError: no candidate could be scored, or the written file is not what was scored
            (:func:`~sfkit.evaluation.written.ensure_as_scored`).
    """
    plan.check(pool)
    plan.check_scorer(scorer)
    if isinstance(folder, RunFolder):
        return _search(pool, scorer, plan, folder.path, progress, judge)
    with run_folder(folder, plan.identity(pool, scorer), force=force) as run:
        return _search(pool, scorer, plan, run.path, progress, judge)


def _search(
    pool: Pool,
    scorer: Scorer,
    plan: SearchPlan,
    folder: Path,
    progress: StageCallback | None,
    judge: JudgeCallback | None,
) -> SearchResult:
    journal = Journal(folder / "journal.jsonl")
    subset, first, second, known = plan.subset, None, None, plan.known(pool, scorer)
    stage2: RoutingSearch | None = None
    searches: list[Search[Any]] = []
    stages: dict[str, Recipe] = {}
    spent: dict[str, int] = {}
    if subset is None:
        stage1 = plan.subset_search(pool.names, pool.blocks, scorer, journal, known)
        first = stage1.run(None if progress is None else lambda g: progress("Stage 1", g))
        # At once: Stage 2 may take hours, and may be killed.
        write_text(folder / "stage1.csv", stage1.history.to_csv(index=False))
        subset = first.subset
        searches.append(stage1)
        stages["Stage 1"], spent["Stage 1"] = first.recipe, stage1.counts.distinct
        known = _with_own(known, stage1)
    else:
        stages["equal weights"], spent["equal weights"] = pool.equal(*subset), 1
    best: SubsetCandidate | RoutingCandidate | None = first
    if plan.stage2 is not None:
        stage2 = plan.routing_search(pool, subset, scorer, journal, known)
        second = stage2.run(None if progress is None else lambda g: progress("Stage 2", g))
        write_text(folder / "stage2.csv", stage2.history.to_csv(index=False))
        searches.append(stage2)
        best, name = second, "Stage 2" if first is None else "Stage 1+2"
        stages[name], spent[name] = second.recipe, stage2.counts.distinct + spent.get("Stage 1", 0)
    if best is None:
        raise InputError("the plan has neither stage, expected something to search")
    recipe, score, averaged = best.recipe, best.score, None
    if plan.resamples:
        averaged = averaged_winner(searches, scorer, plan.resamples, seed=plan.seed, journal=journal)
        write_text(folder / WINNERS, averaged.table.to_csv(index=False))
        # Beside the average, which is taken in its place.
        write_text(folder / BEST, pool.bound(best.recipe).to_json())
        if not averaged.finite:
            why = averaged.outcome.error or f"found {averaged.score}"
            warnings.warn(
                f"averaged winner: has no finite score ({why}), the best on validation is taken",
                SfkitWarning,
                stacklevel=3,
            )
        else:
            recipe, score = averaged.recipe, averaged.score
            stages[AVERAGED] = recipe
            spent[AVERAGED] = max(spent.values()) + (len(averaged.wins) > 1)  # one alone was scored before
    write_text(folder / "recipe.json", pool.bound(recipe).to_json())
    merged = save_merged(pool, recipe, folder / "merged.safetensors", overwrite=True)
    # Before result.json: where that lies, the network beside it gives the score it names.
    ensure_as_scored(pool, recipe, scorer, merged)
    found = SearchResult(recipe, score, first, second, merged, folder, stage2, stages, spent, averaged)
    write_result(pool, found, {} if judge is None else judge(found))
    return found


def write_result(pool: Pool, found: SearchResult, judged: Mapping[str, Any]) -> Path:
    """Write ``result.json``: the summary, and what was judged of it."""
    return write_text(found.folder / "result.json", json.dumps({**judged, **summary(pool, found)}, indent=2))


def summary(pool: Pool, found: SearchResult) -> dict[str, Any]:
    """Plain values: scores, subset, recipe, where its parts come from, and the merged file's name."""
    origin = {
        key.removeprefix("sfkit."): json.loads(v) for key, v in origin_metadata(pool, found.recipe).items()
    }
    averaged = {}
    if found.averaged:  # JSON has neither NaN nor infinity
        averaged = {"averaged": found.averaged.score if found.averaged.finite else None}
    return {
        "pool": pool.name,
        "score": found.score,
        "stage1": found.stage1.score if found.stage1 else None,
        "stage2": found.stage2.score if found.stage2 else None,
        **averaged,
        "subset": list(found.recipe.sources),
        "recipe": pool.signed(found.recipe).as_dict(),
        "origin": {key: origin[key] for key in ("architecture", "base", "sources")},
        "merged": found.merged.name,
    }


def cost(
    pool: Pool, evaluators: Sequence[Evaluator], plan: SearchPlan, subset: Iterable[str] = ()
) -> Estimate:
    """What the plan will cost at most: one timed evaluation on each validation benchmark."""
    # All sources where Stage 1 has yet to choose: no merge of fewer takes longer.
    recipe = pool.equal(*(plan.subset or tuple(subset) or pool.names))
    most = plan.evaluations(pool.names, pool.blocks)
    parts = [estimate(evaluator, recipe, most) for evaluator in evaluators]
    return Estimate(
        most,
        # A candidate is scored on each benchmark in turn.
        sum(part.seconds_each for part in parts),
        max(part.memory_bytes for part in parts),
        sum(part.images for part in parts),
        min(part.workers for part in parts),
    )
