"""Is the search worth it? Every method of a run against one of them, on benchmarks that guided none."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from sfkit.analysis.comparisons import NetworkComparison, compare_networks
from sfkit.analysis.costs import MethodCost
from sfkit.analysis.labels import Judgement
from sfkit.analysis.measured import Measured, measure_with
from sfkit.baselines import BaselineRun, Network
from sfkit.errors import InputError
from sfkit.evaluation.evaluator import Evaluator


def compare_methods(
    run: BaselineRun,
    evaluators: Sequence[Evaluator],
    *,
    validation: Sequence[str],
    reference: str = "Stage 1+2",
) -> NetworkComparison:
    """The networks of a run on benchmarks, each under its evaluator's metric, against one of them.

    A method that drew several networks is one row, and their spread belongs to its intervals.

    Args:
        run: what :func:`~sfkit.baselines.run_baselines` found.
        evaluators: of the benchmarks, on the pool the methods were run on.
        validation: names of the benchmarks that guided.
        reference: a method's label.

    Raises:
        InputError: no such method was run, no benchmark, or metrics of different units.
    """
    labels = [result.label for result in run.results.values()]
    if reference not in labels or not evaluators:
        raise InputError(
            f"methods: found {len(evaluators)} benchmarks and {', '.join(labels)}, "
            f"expected a benchmark and {reference!r} among the methods"
        )
    drawn = {
        r.label: [f"{r.label}, draw {number}" for number in range(len(r.draws))]
        for r in run.results.values()
        if len(r.draws) > 1
    }
    networks = {
        name: network
        for r in run.results.values()
        for name, network in zip(
            drawn.get(r.label, [r.label]), r.draws or (Network(r.pool, r.recipe),), strict=True
        )
    }
    found: list[Measured] = []
    for evaluator in evaluators:
        parts = [
            # One by one: prepared task vectors have a pool of their own.
            measure_with([evaluator.with_pool(one.pool)], {name: one.recipe}, validation=validation)[0]
            for name, one in networks.items()
        ]
        images = {name: one.of(name) for one in parts for name in one.networks}
        # All parts are of one benchmark, and differ in their networks alone.
        found.append(replace(parts[0], images=images))
    return compare_networks(found, reference, seeds=drawn)


def method_costs(run: BaselineRun) -> tuple[MethodCost, ...]:
    """What each method of a run took, each for itself."""
    return tuple(
        MethodCost(
            result.label,
            result.evaluations,
            result.image_passes,
            result.seconds,
            cpu_seconds=result.cpu_seconds,
        )
        for result in run.results.values()
    )


def worth(run: BaselineRun, comparison: NetworkComparison) -> tuple[str, ...]:
    """Sentences that say whether the reference was worth its price, the answer first."""
    reference = comparison.reference
    # An oracle saw the tests, and is nothing to deploy.
    deployable = {result.label: result for result in run.results.values() if not result.oracle}
    rows = [row for row in comparison.rows if row.network != reference and row.network in deployable]
    groups: dict[Judgement, list[str]] = {word: [] for word in Judgement}
    for row in rows:
        groups[Judgement.UNKNOWN if row.difference is None else row.difference.word].append(row.network)
    worse, better = groups[Judgement.WORSE], groups[Judgement.BETTER]  # they, than the reference
    alike, unknown = groups[Judgement.WITHIN_NOISE], groups[Judgement.UNKNOWN]
    own = comparison.row(reference)
    judged = math.isfinite(own.unseen)
    place = 1 + sum(
        (row.unseen if judged else row.guided) < (own.unseen if judged else own.guided) for row in rows
    )
    where = (
        "on what none of them was tuned on" if judged else "on the pairs it was tuned on, which is no test"
    )
    rank = f"{reference} comes {_ordinal(place)} of {len(rows) + 1} {where}"
    if len(unknown) == len(rows):
        title = f"{rank}; with so few images no difference can be told from chance."
    else:
        title = (
            f"{rank}: better than {len(worse)} methods, worse than {len(better)}, "
            f"not told apart from {len(alike) + len(unknown)}."
        )
    sentences = [title]
    for names, word in (
        (worse, "is better than"),
        (better, "is worse than"),
        (alike, "is not told apart from"),
    ):
        if names:
            sentences.append(f"{reference} {word} {', '.join(names)}.")
    cheap = [row for row in rows if row.network in (*alike, *better, *unknown)]
    if cheap:
        least = min(cheap, key=lambda row: deployable[row.network].evaluations)
        cost, price = deployable[reference].evaluations, deployable[least.network].evaluations
        sentences.append(
            f"It took {cost:,} evaluations; {least.network}, which nothing here shows to be worse, "
            f"took {price:,}."
        )
    return tuple(sentences)


def _ordinal(number: int) -> str:
    # 11th, 12th and 13th are the exceptions.
    ending = {1: "st", 2: "nd", 3: "rd"}.get(number % 10 if number % 100 not in (11, 12, 13) else 0, "th")
    return f"{number}{ending}"
