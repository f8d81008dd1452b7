"""``sfkit search``: which sources to merge, and how."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sfkit.cli.foreseen import roster_of
from sfkit.cli.methods import stages
from sfkit.cli.options import (
    DtypeOption,
    ForceOption,
    JsonOption,
    PoolArgument,
    StoreOption,
    SubsetFromOption,
    SubsetOption,
    emit,
    pool_of,
    recipe_of,
    say,
    source_names,
)
from sfkit.cli.outputs import Places
from sfkit.cli.panels import (
    BenchmarkOptions,
    ComputeOptions,
    ConstraintOptions,
    GuidanceOptions,
    Model1Options,
    Model2Options,
    Stage1Options,
    Stage2Options,
)
from sfkit.cli.validation import described, guide_of, guides_of, scoring, tests_of, trust_entry, trust_lines
from sfkit.cli.watching import Watch
from sfkit.errors import InputError
from sfkit.search import Constraints, RoutingSettings
from sfkit.search.checks import METHODS, RESAMPLES, check_parts, check_resamples
from sfkit.search.run_folder import LOCK, OUTPUTS, SEARCH, STORE, refuse_unclaimed, run_folder

if TYPE_CHECKING:
    from sfkit.datasets.metric import Metric
    from sfkit.evaluation.estimating import Estimate
    from sfkit.merging import Pool, Recipe
    from sfkit.merging.roster import Roster
    from sfkit.search.pipeline import SearchResult
    from sfkit.search.plan import SearchPlan


LONG = 10.0  # minutes; shorter searches start without a question


def search(
    pool: PoolArgument,
    data: BenchmarkOptions,
    guidance: GuidanceOptions,
    stage1: Stage1Options,
    stage2: Stage2Options,
    model1: Model1Options,
    model2: Model2Options,
    constraints: ConstraintOptions,
    compute: ComputeOptions,
    out: Annotated[Path, typer.Option("--out", "-o", help="The folder to write to.")] = Path("runs/search"),
    method: Annotated[
        str,
        typer.Option(help="paper: genetic algorithm, then CMA-ES; bayesian: a model of the score proposes."),
    ] = "paper",
    subset: SubsetOption = None,
    subset_from: SubsetFromOption = None,
    start: Annotated[
        Path | None, typer.Option(help="Stage 2: a recipe to start from as well; needs --subset.")
    ] = None,
    resamples: Annotated[
        int | None,
        typer.Option(
            help="Average what wins so many resamples of the validation pairs; 0 takes the best. Where not "
            "named: 0 by the paper's method, 200 by bayesian where both stages run and it can be."
        ),
    ] = None,
    blocks: Annotated[
        str | None,
        typer.Option(help="Blocks made from the network: modules, disagreement, or modules:6 for six."),
    ] = None,
    test: Annotated[
        list[str] | None,
        typer.Option("--test", help="Test on NAME,root=FOLDER,..., which guides nothing; may be repeated."),
    ] = None,
    dtype: DtypeOption = None,
    store: StoreOption = None,
    yes: Annotated[bool, typer.Option("--yes", "-y", help="Start long searches without a question.")] = False,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Search Stage 1 (which sources) and Stage 2 (how), write the merged network, and say what to deploy.

    Interrupted, it goes on where it was when it is started again with the same folder.

    \b
    Examples:
      sfkit search pool.toml -b eth3d -r ~/ETH3D -o runs/garage
      sfkit search pool.toml -b eth3d -r ~/ETH3D --method bayesian --batch 4
      sfkit search pool.toml -b pairs -r ~/pairs --subset a,b --evaluations 200
      sfkit search pool.toml -b eth3d -r ~/ETH3D --also kitti2012,root=~/KITTI --combine worst --holdout 0.5
      sfkit search pool.toml -b eth3d -r ~/ETH3D --test kitti2012,root=~/KITTI
      sfkit search pool.toml -b pairs -r ~/pairs --resamples 200
    """
    first, second = stages(
        method,
        {**stage1, **model1},
        {**stage2, **model2},
        subset=(subset or subset_from) is not None,
        start=start is not None,
    )
    kept_in = store or out / STORE
    places = Places(start=start, subset_from=subset_from, csv=data.csv)
    places.folder("--out", out, (*OUTPUTS, SEARCH, LOCK))
    places.store(kept_in)
    if not force:
        refuse_unclaimed(out)
    chosen, begin = _subset(subset, subset_from), recipe_of(start) if start is not None else None
    check_resamples(resamples or 0, second)
    check_parts(chosen, second, begin)
    _ensure_names(roster_of(pool, blocks, dtype), chosen, second, constraints, begin)
    guides, combine = guides_of(data, guidance, test), guidance.combine
    tests = tests_of(test, guides)
    from sfkit.analysis.overfit import holdout_check
    from sfkit.analysis.search_verdict import missing
    from sfkit.analysis.trust import trust_of
    from sfkit.checkpoints.targets import ensure_room
    from sfkit.cli.judging import Judge
    from sfkit.evaluation.combining import LABEL, CombinedScorer
    from sfkit.evaluation.evaluator import Evaluator
    from sfkit.search.pipeline import cost, search_pool, summary
    from sfkit.search.plan import SearchPlan

    plan = SearchPlan(
        subset=chosen,
        stage1=first,
        stage2=second,
        constraints=constraints,
        start=begin,
        resamples=resamples or 0,
    )
    opened = pool_of(pool, blocks, dtype)
    plan.check(opened)
    ensure_room(out / "merged.safetensors", opened.base.path.stat().st_size)
    guide = guide_of(opened, guides, combine, compute)
    plan.check_scorer(guide)
    if resamples is None and method != METHODS[0]:
        plan = plan.averaging(opened, guide)
    judges = [Evaluator(opened, one, compute=compute) for one in tests]
    with (
        run_folder(out, plan.identity(opened, guide), force=force) as folder,
        scoring(opened, guide, kept_in) as (evaluators, scorer),
    ):
        # In the store that the search has just opened.
        judges = [one.with_store(evaluators[0].store) for one in judges]
        for one in judges:
            say(f"test: {one.benchmark.name} ({one.benchmark.coverage}), {one.metric}, which guides nothing")
        doubt = few_pairs(sum(len(guide) for guide in guides), plan.stage2)
        if doubt and not plan.resamples:
            say(doubt)
        if plan.resamples and resamples is None:
            say(
                f"returns: the average of what wins {plan.resamples} resamples of the pairs; --resamples 0: "
                "the best on them"
            )
        price = cost(opened, evaluators, plan)
        say(f"cost: {price}")
        # What each stage found is scored on the tests.
        brings = 1 + (plan.stage2 is not None) + (plan.resamples > 0)
        say(f"verdict: {missing(opened, evaluators, judges, stages=brings)}")
        if other := _other_cost(plan, price, opened):
            say(other)
        # A script has nobody to answer.
        long = price.minutes > LONG and sys.stdin.isatty() and not yes
        if long and not typer.confirm("Start?", default=True, err=True):
            raise typer.Abort
        judge = Judge(opened, evaluators, judges)
        with Watch(plan.candidates(opened), evaluators) as watch:
            found = search_pool(opened, scorer, plan, folder, progress=watch.generation, judge=judge)
        trusted = trust_of(opened, evaluators, found.recipe, judges)
    changes = scorer.changes if isinstance(scorer, CombinedScorer) else None
    metric_name = str(evaluators[0].metric) if changes is None else LABEL
    check = None if found.routing is None else holdout_check(found.routing, metric=evaluators[0].metric.name)
    document = {**judge.document, **summary(opened, found), "folder": out, "metric": metric_name}
    document |= {"evaluations": judge.before, "verdict_evaluations": judge.own}
    document |= described(guides, combine)
    document |= {"holdout": None if check is None else {**vars(check), "overfit": check.overfit}}
    text = _text(found, evaluators[0].metric if changes is None else None, judge.before)
    if trusted is not None:
        document |= trust_entry(trusted)
        text = "\n".join([text, *trust_lines(trusted)])
    text = text if check is None else f"{text}\n{check.sentence}"
    emit(document, "\n".join([*judge.lines(found), text]), as_json=json)


def _ensure_names(
    pool: Roster | None,
    subset: tuple[str, ...] | None,
    second: RoutingSettings | None,
    constraints: Constraints,
    start: Recipe | None,
) -> None:
    """Refuse names that the pool has not, before it is opened: of blocks where they are known by then."""
    if pool is None:
        return
    # A block without a name stands for those that are not known yet.
    blocks = pool.blocks or (*constraints.frozen_blocks, "\0")
    if subset is None:
        constraints.space(pool.names, blocks)
    elif second is not None:
        from sfkit.search.encoding import encoding_of

        encoding = encoding_of(pool.subset(subset), blocks, second, constraints)
        if start is not None and pool.blocks is not None:
            encoding.admit(start)


def _other_cost(plan: SearchPlan, price: Estimate, pool: Pool) -> str | None:
    """What the method that was not chosen would cost with its own sizes; None where it cannot do the same."""
    if plan.stage2 is not None and plan.stage2.holdout:
        return None
    other = next(method for method in METHODS if method != plan.method)
    less = replace(price, evaluations=plan.by(other).evaluations(pool.names, pool.blocks))
    return f"by --method {other}: at most {less.evaluations} evaluations, {less.minutes:.1f} minutes"


def few_pairs(pairs: int, stage2: RoutingSettings | None) -> str | None:
    """What to know of a plain Stage 2 guided by fewer pairs than can be split; None where all is well."""
    from sfkit.evaluation.holdout import LEAST

    if stage2 is None or pairs >= LEAST or stage2.shrinkage > 0 or stage2.entropy > 0:
        return None
    average = f"--resamples {RESAMPLES}, " if pairs > 1 else ""
    return (
        f"few pairs: what Stage 2 gains on {pairs} need not show elsewhere (docs/validation.md); {average}"
        "--shrinkage 0.05 or more benchmarks (--also) may help"
    )


def _subset(text: str | None, file: Path | None) -> tuple[str, ...] | None:
    from sfkit.merging.origin import read_recipe
    from sfkit.search import subset_of

    if text is not None and file is not None:
        raise InputError("found --subset and --subset-from, expected one of the two")
    if file is not None:
        return subset_of(read_recipe(file))
    return None if text is None else source_names("--subset", text)


def _text(found: SearchResult, metric: Metric | None, counts: Mapping[str, Any]) -> str:
    from sfkit.cli.inspection import recipe_lines
    from sfkit.evaluation.combining import LABEL

    unit = "" if metric is None else metric.unit
    lines = [f"best {metric or LABEL}: {found.score:.2f} {unit}"]
    if found.averaged is not None and found.recipe == found.averaged.recipe:
        wins, draws = found.averaged.wins, found.averaged.resamples
        lines = [
            f"averaged winner, {metric or LABEL}: {found.averaged.score:.2f} {unit}  "
            f"({len(wins)} candidates win {draws} resamples)"
        ]
    for stage, best in (("Stage 1", found.stage1), ("Stage 2", found.stage2)):
        if best is not None:
            lines.append(f"  {stage}: {best.score:.2f} {unit}  {', '.join(best.subset)}")
    return "\n".join([*lines, *recipe_lines(found.recipe), _saved(counts), f"wrote {found.merged}"])


def _saved(counts: Mapping[str, Any]) -> str:
    """What evaluations took now, and how many cost nothing, as those of a pool that gained a source since."""
    computed, cached = counts["computed"], counts["cached"]
    share = 100.0 * cached / max(computed + cached, 1)
    worked = "" if counts["cpu_seconds"] is None else f" ({counts['cpu_seconds']:.1f} s of CPU)"
    took = f" in {counts['seconds']:.1f} s{worked}" if computed else ""
    return f"evaluations: {computed} computed{took}, {cached} ({share:.0f} %) were in the store"
