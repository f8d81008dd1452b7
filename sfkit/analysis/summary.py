"""The executive summary of a study: what to deploy, how sure, at what cost, in plain sentences."""

from __future__ import annotations

import math
from collections.abc import Iterator

from sfkit.analysis.labels import Judgement, points, score_text
from sfkit.analysis.paired import Difference
from sfkit.analysis.study import BASE, Study
from sfkit.baselines import BaselineResult


def summary(study: Study) -> tuple[str, ...]:
    """Sentences computed from a study's numbers, the most important first."""
    return (
        *_deploy(study),
        *_how_sure(study),
        *_warnings(study),
        *_sources(study),
        *_cost(study),
    )


def _deploy(study: Study) -> Iterator[str]:
    first, *rest = study.verdict.reason
    yield f"**{first}**"
    # A verdict that overrules validation says why in its second sentence, before what the network is.
    if study.chosen != study.verdict.preferred or not first.startswith("Deploy"):
        yield " ".join(rest[:1])
        rest = rest[1:]
    yield f"It is {_content(study.result)}."
    if rest:
        yield " ".join(rest)


def _content(result: BaselineResult) -> str:
    recipe = result.recipe
    if not recipe.sources:
        return "the base as it is"
    shares = [sum(row[e] for row in recipe.weights) / len(recipe.weights) for e in range(len(recipe.sources))]
    ranked = sorted(zip(recipe.sources, shares, strict=True), key=lambda pair: -pair[1])
    # Less than half a percent would read as 0 %.
    parts = ", ".join(f"{name} {100 * share:.0f} %" for name, share in ranked if share >= 0.005)
    return f"one network of the base's size and speed, mixed from {parts}"


def _how_sure(study: Study) -> Iterator[str]:
    for seen in study.by_hand:
        yield f"Warning: {seen}"
    if not study.unseen:
        yield "No benchmark is left that guided nothing, so that nothing here is a test."
        return
    images = sum(len(one.ids) for one in study.unseen)
    names = ", ".join(one.benchmark for one in study.unseen)
    yield (
        f"On what no method saw ({names}; {images} images) its mean is "
        f"{score_text(study.metric, study.mean(study.chosen))}."
    )
    yield from _beside(study)
    row = study.comparison.row(study.result.label)
    if row.spread is not None:
        yield f"With other seeds that mean is another: {row.spread}."
    gap, before = study.comparison.row(study.reference).gap, study.comparison.row(BASE).gap
    if math.isfinite(gap) and math.isfinite(before):
        unit = points(study.comparison.unit)
        yield (
            f"From validation to the unseen benchmarks the mean changes by {gap:+.1f} {unit} for "
            f"{study.reference} and by {before:+.1f} {unit} for the base."
        )


LANDMARKS = (BASE, "uniform", "single best (validation)")
"""What everybody wants to know the difference to in figures."""


def _beside(study: Study) -> Iterator[str]:
    """The reference against every other method, in one sentence: one family of comparisons."""
    oracles = {result.label for result in study.runs.values() if result.oracle}
    groups: dict[Judgement, list[str]] = {word: [] for word in Judgement}
    for row in study.comparison.rows:
        if row.difference is None:
            continue
        # The table has each method beside the reference, the sentence the reference beside each.
        found = row.difference.turned
        what = f"{row.network} (which saw the test)" if row.network in oracles else row.network
        if row.network in LANDMARKS:
            what = f"{row.network} ({_figures(found)})"
        groups[found.word].append(what)
    unknown = groups.pop(Judgement.UNKNOWN)
    parts = [f"{word.against} {', '.join(names)}" for word, names in groups.items() if names]
    if unknown:
        parts.append(f"with no interval to judge by beside {', '.join(unknown)}")
    if not parts:
        return
    seeds = study.comparison.row(study.reference).spread
    over = f" (over {len(seeds.values)} seeds)" if seeds is not None else ""
    sentence = f"There {study.reference}{over} is {'; '.join(parts)}."
    if study.comparison.family:
        sentence += (
            f" All {study.comparison.family} comparisons made there are corrected together (Holm); an "
            "interval is that of one alone (95 %, over images and, where a method draws, over its seeds)."
        )
    yield sentence


def _figures(difference: Difference) -> str:
    value = f"{difference.value:+.2f} {difference.points}"
    if difference.interval is None:
        return f"{value}, no interval: {difference.reason}"
    low, high = difference.interval
    return f"{value}, {low:+.2f} to {high:+.2f}"


def _plainly(difference: Difference) -> str:
    unit = difference.points
    if difference.interval is None:
        word = "worse" if difference.value > 0 else "better"
        why = f"no interval: {difference.reason}"
        return f"{abs(difference.value):.2f} {unit} {word} than {difference.reference} ({why})"
    low, high = difference.interval
    word = difference.word.against
    many = f", {difference.allowance}" if difference.allowance else ""
    return f"{word} {difference.reference} ({difference.value:+.2f} {unit}, {low:+.2f} to {high:+.2f}{many})"


def _warnings(study: Study) -> Iterator[str]:
    """Who fits the validation images, the reference or a method beside it."""
    for row in study.comparison.rows:
        guided, unseen = row.guided_difference, row.unseen_difference
        if guided is None or unseen is None or not (row.overfit or row.outdoes_on_unseen):
            continue
        # Then it is the reference that fits them, and the difference is told from its side.
        if row.outdoes_on_unseen:
            guided, unseen = guided.turned, unseen.turned
        yield (
            f"Warning: {guided.network} is {_plainly(guided)} on what guided it and {_plainly(unseen)} on "
            "the unseen: it fits the validation images."
        )


def _sources(study: Study) -> Iterator[str]:
    names = study.experiment.pool.names
    means = {name: study.mean(name) for name in names}
    base = study.mean(BASE)
    helping = sum(mean < base for mean in means.values())
    best = min(means, key=lambda name: means[name])
    yield (
        f"Alone, {helping} of the {len(names)} sources are better than the base "
        f"({score_text(study.metric, base)}) on the unseen benchmarks; the best of them there is {best} "
        f"({score_text(study.metric, means[best])}), which only the test itself could tell."
    )


def _cost(study: Study) -> Iterator[str]:
    costs = study.costs()
    own = next(cost for cost in costs if cost.method == study.result.label)
    runs = f" in {own.runs} runs" if own.runs > 1 else ""
    worked = "" if own.cpu_seconds is None else f" ({_time(own.cpu_seconds)} of CPU time)"
    yield (
        f"Finding it took {own.evaluations:,} evaluations, {own.image_passes:,} image pairs through "
        f"the network and {_time(own.seconds)} of wall time{worked}{runs}, and all it was chosen among "
        f"{sum(cost.evaluations for cost in costs):,} at most; the merged network costs what the base costs."
    )


def _time(seconds: float) -> str:
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} minutes" if seconds < 7200 else f"{seconds / 3600:.1f} hours"
