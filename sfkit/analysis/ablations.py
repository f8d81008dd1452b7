"""Ablations (StereoFactory, section V-F): one thing of an experiment is changed, everything else stays.

Each function returns a table: a row a variant, a column a benchmark in the metric the experiment shows it
by, and the mean over the benchmarks that guided no search of that row, where these have one unit. What the
store holds already, from whichever experiment, is not computed again.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import pandas as pd

from sfkit.analysis.experiment import Answer, Experiment, overlap
from sfkit.analysis.headed import UNSEEN, with_means
from sfkit.analysis.measured import measure_with
from sfkit.analysis.paired import Difference, corrected, paired_difference
from sfkit.analysis.selection import SelectionStatistics, selection_statistics
from sfkit.datasets.benchmark import Benchmark
from sfkit.datasets.metric import Metric
from sfkit.errors import InputError
from sfkit.evaluation.separation import marked, pairs_in_common
from sfkit.merging.recipe import Recipe
from sfkit.search.constraints import transfer

MEAN = UNSEEN
"""The column that averages over the benchmarks which guided no search."""


def fitness_metrics(
    experiment: Experiment, metrics: Sequence[str] = ("bad-1.0", "bad-3.0", "epe"), *, routing: bool = True
) -> pd.DataFrame:
    """Does the answer depend on the metric that guides the search? (Table "Fitness-metric ablation".)

    Args:
        experiment: pool, validation benchmark and budgets.
        metrics: what the validation benchmark is scored by in turn; where it has no ground truth, those of
            them that need none.
        routing: with Stage 2; the subset alone without.

    Returns:
        Columns: the subset, the benchmarks, their mean, that of the unseen ones, and how much of the first
        row's subset is in each (Jaccard, 0 to 1).
    """
    answers = {
        metric.name: experiment.answer(experiment.scorer(metric=metric.name), routing=routing)
        for metric in experiment.validation.measurable(metrics)
    }
    return _table(experiment, answers).rename_axis("fitness metric")


def validation_sets(
    experiment: Experiment, benchmarks: Sequence[Benchmark] = (), *, routing: bool = True
) -> pd.DataFrame:
    """Does the answer depend on the benchmark that guides the search? (Table "Validation-set robustness".)

    Args:
        experiment: pool and budgets; its validation benchmark is the first row.
        benchmarks: what guides the search in the other rows; the reported ones unless given, each cut to as
            many pairs as the validation benchmark has.
        routing: with Stage 2; the subset alone without.

    Returns:
        As :func:`fitness_metrics`; a row's own mean leaves out what guided it.

    Raises:
        InputError: two guides of one name.
    """
    few = len(experiment.validation)
    # As many pairs as the validation benchmark has: a larger guide would win by its size.
    others = benchmarks or [b.first(few) for b in experiment.reported]
    guides = (experiment.validation, *others)
    names = [guide.name for guide in guides]
    if len(set(names)) < len(names):
        raise InputError(f"validation sets: found {names}, expected a name for each")
    found = {guide.name: (guide, guide.metric) for guide in guides}
    return _guided(experiment, found, routing=routing).rename_axis("guided by")


def fitness_criteria(
    experiment: Experiment, criteria: Sequence[tuple[Benchmark, str]] = (), *, routing: bool = True
) -> pd.DataFrame:
    """Does the answer depend on what the search minimises? Benchmark and metric change together.

    (Table "Fitness-metric ablation", whose rows are Middlebury bad-2.0 and ETH3D bad-1.0.)

    Args:
        experiment: pool and budgets.
        criteria: what guides each row and by which metric; the validation benchmark and the reported ones,
            cut to as many pairs, each by its own metric, unless given.
        routing: with Stage 2; the subset alone without.

    Returns:
        As :func:`fitness_metrics`, a row ``BENCHMARK METRIC``; its own mean leaves out what guided it.

    Raises:
        InputError: one criterion twice.
    """
    rows = _criteria(experiment, criteria)
    return _guided(experiment, rows, routing=routing).rename_axis("fitness")


def selection_across(
    experiment: Experiment, criteria: Sequence[tuple[Benchmark, str]] = (), *, routing: bool = True
) -> SelectionStatistics:
    """What searches choose under different guides (figure "Selection statistics"); arguments as above.

    Searches that :func:`fitness_criteria` or :func:`validation_sets` ran on the same store cost nothing.
    """
    guides = _criteria(experiment, criteria)
    recipes = {
        row: experiment.answer(experiment.scorer(guide, metric), routing=routing).recipe
        for row, (guide, metric) in guides.items()
    }
    return selection_statistics(recipes, experiment.pool.names, groups=dict.fromkeys(recipes, "all guides"))


def _criteria(
    experiment: Experiment, criteria: Sequence[tuple[Benchmark, str]]
) -> dict[str, tuple[Benchmark, str]]:
    few = len(experiment.validation)
    cut = [b.first(few) for b in experiment.reported]
    usual = [(one, one.metric) for one in (experiment.validation, *cut)]
    chosen = [(one, Metric.parse(metric).name) for one, metric in criteria or usual]
    # Equal criteria fall on one key, which the count below shows.
    rows = {f"{one.name} {metric}": (one, metric) for one, metric in chosen}
    if len(rows) < len(chosen):
        raise InputError(f"fitness criteria: found {[*rows]} more than once, expected each once")
    return rows


def _guided(
    experiment: Experiment, guides: Mapping[str, tuple[Benchmark, str]], *, routing: bool
) -> pd.DataFrame:
    """One search a row, each guided by a benchmark and a metric of its own."""
    answers = {
        row: experiment.answer(experiment.scorer(guide, metric), routing=routing)
        for row, (guide, metric) in guides.items()
    }
    # Overlaps in all rows are with this subset.
    first = next(iter(answers.values())).subset
    rows = [
        _table(experiment, {row: answer}, guide=guides[row][0], first=first)
        for row, answer in answers.items()
    ]
    return pd.concat(rows)


def stage_variants(
    experiment: Experiment,
    variants: Mapping[str, Mapping[str, Any] | None] | None = None,
    *,
    seeds: Sequence[int] = (0,),
) -> pd.DataFrame:
    """What does each part of the method add? Stage 1 alone, both stages, and Stage 2 with parts left out.

    (Table "Two-stage pipeline"; scales on and off.)

    Args:
        experiment: pool, benchmarks and budgets; its own seed is not used.
        variants: row name -> settings of Stage 2, None for Stage 1 alone; by default Stage 1, Stage 1+2,
            without scales, and with weights of each block's own.
        seeds: of both stages; every variant of one seed starts from the same subset.

    Returns:
        A row a (variant, seed): the validation score, the benchmarks, their mean.
    """
    chosen = STAGES if variants is None else variants
    frames = []
    for seed in seeds:
        seeded = experiment.changed(seed=seed)
        # Once a seed: variants differ in Stage 2 alone.
        first = seeded.answer(routing=False)
        recipes: dict[str, Recipe] = {}
        for name, settings in chosen.items():
            recipes[name] = (
                first.recipe if settings is None else seeded.stage2(first.subset, **settings).run().recipe
            )
        frame = scored(seeded, recipes).rename_axis("variant").reset_index()
        frame.insert(1, "seed", seed)
        frame.insert(2, "subset", ", ".join(first.subset))
        frames.append(frame)
    return pd.concat(frames, ignore_index=True).set_index(["variant", "seed"])


STAGES: dict[str, dict[str, Any] | None] = {
    "Stage 1": None,
    "Stage 1+2": {},
    "without scales": {"scaled": False},
    "weights by block": {"tied": False},
}
"""The variants of :func:`stage_variants`: settings that differ from those of Stage 2's defaults."""


def subset_transfer(first: Experiment, second: Experiment) -> pd.DataFrame:
    """Does a subset found on one pool serve another of the same source names? (Table "Reusable-subset".)

    On each pool, Stage 2 mixes once the subset its own Stage 1 found and once the other pool's.

    Args:
        first: one pool, with its benchmarks and budgets.
        second: the other, whose sources have the same names.

    Returns:
        A row a (pool, subset): the sources, their overlap with the pool's own subset, the benchmarks, their
        mean, how many evaluations the row needed on its pool, from the store or not, and how the reused
        subset differs from the pool's own search on the mean, in words with a 95 % interval over images;
        both rows' words are corrected together.

    Raises:
        InputError: a source of one subset is missing in the other pool, or both pools have one name.
    """
    if first.pool.name == second.pool.name:
        raise InputError(
            f"subset transfer: found two pools called {first.pool.name!r}, expected a name for each"
        )
    # Each pool's own search once; both directions take from it.
    own = {experiment: experiment.answer() for experiment in (first, second)}
    frames, found = [], []
    for here, other in ((first, second), (second, first)):
        reused = here.answer(subset=transfer(own[other].subset, here.pool.names))
        answers = {"own search": own[here], f"found on {other.pool.name}": reused}
        frame = _table(here, answers).rename_axis("subset from").reset_index()
        frame.insert(0, "pool", here.pool.name)
        frame["evaluations"] = [sum(c.distinct for c in one.counts.values()) for one in answers.values()]
        found.append(_against_own(here, {name: a.recipe for name, a in answers.items()}))
        frames.append(frame)
    told = iter(corrected([one for one in found if one is not None]))
    for frame, one in zip(frames, found, strict=True):
        frame["reused"] = ["", "no benchmark is unseen" if one is None else str(next(told))]
    return pd.concat(frames, ignore_index=True).set_index(["pool", "subset from"])


def _against_own(here: Experiment, recipes: Mapping[str, Recipe]) -> Difference | None:
    """The second recipe against the first on the unseen benchmarks' mean; None without any."""
    own, reused = recipes
    evaluators = [here.scorer(b, here.metric_of(b)) for b in here.reported if b.name not in here.guided]
    if not evaluators:
        return None
    return paired_difference(measure_with(evaluators, recipes), reused, own)


def _table(
    experiment: Experiment,
    answers: Mapping[str, Answer],
    *,
    guide: Benchmark | None = None,
    first: Sequence[str] = (),
) -> pd.DataFrame:
    scores = scored(experiment, {name: answer.recipe for name, answer in answers.items()}, guide=guide)
    subsets = [answer.subset for answer in answers.values()]
    # Overlaps are with the first row's subset.
    compared = first or subsets[0]
    scores.insert(0, "subset", [", ".join(subset) for subset in subsets])
    return scores.assign(overlap=[overlap(compared, subset) for subset in subsets])


def scored(
    experiment: Experiment, recipes: Mapping[str, Recipe], *, guide: Benchmark | None = None
) -> pd.DataFrame:
    """A row a recipe, a column a benchmark; the mean leaves out what guided the search, or a person by hand.

    Where another benchmark than the experiment's was the ``guide``, columns bear no ``*``: it differs by row.
    """
    scores = experiment.scores(recipes)
    columns = list(dict.fromkeys(scores["benchmark"]))
    # pivot sorts; rows and columns stand as they were asked for.
    table = scores.pivot(index="network", columns="benchmark", values="score").loc[list(recipes), columns]
    table.columns.name = None
    shown = (experiment.validation, *experiment.reported)
    seen = {*pairs_in_common([guide or experiment.validation], shown)}
    seen |= {edited.benchmark for edited in experiment.by_hand}
    unseen = [name for name in columns if name not in seen]
    marks = {} if guide is not None else {name: marked(name, guided=True) for name in columns if name in seen}
    return with_means(table, experiment.compared, unseen).rename(columns=marks)
