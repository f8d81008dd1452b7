"""What guides searches and baselines: one benchmark, or several under one rule."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

from sfkit.cli.groups import names
from sfkit.cli.options import say, store_of
from sfkit.cli.panels import Guidance
from sfkit.datasets.benchmark import Benchmark, open_benchmarks
from sfkit.datasets.metric import Metric
from sfkit.datasets.unlabelled import UNLABELLED
from sfkit.errors import InputError
from sfkit.evaluation import CombinedScorer, Compute, Evaluator
from sfkit.evaluation.changes import LABEL
from sfkit.evaluation.separation import check_separation
from sfkit.merging import Pool


def guides_of(first: Benchmark, guidance: Guidance) -> tuple[Benchmark, ...]:
    """The validation benchmarks, their files found and not yet read.

    Raises:
        InputError: ``--also`` or ``--combine`` cannot be understood.
    """
    if guidance.combine not in ("mean", "worst"):
        raise InputError(f"--combine: found {guidance.combine!r}, expected mean or worst")
    return (first, *(_named("--also", text, first.metric) for text in guidance.also or ()))


def tests_of(texts: Sequence[str] | None, guides: Sequence[Benchmark]) -> tuple[Benchmark, ...]:
    """The benchmarks of ``--test``, each under its own metric where that has the guide's unit.

    Raises:
        InputError: one cannot be understood, or shares a pair with what guides.
    """
    guide = guides[0].metric
    tests = []
    for text in texts or ():
        test = _named("--test", text, None)
        alike = Metric.parse(test.metric).unit == Metric.parse(guide).unit
        tests.append(test if alike else test.measured_by(metric=guide))
    check_separation(guides, tests)
    return tuple(tests)


@contextmanager
def scoring(
    pool: Pool, guides: Sequence[Benchmark], combine: str, store: Path | None, compute: Compute
) -> Iterator[tuple[list[Evaluator], Evaluator | CombinedScorer]]:
    """An evaluator for each validation benchmark, and what they say together.

    Args:
        pool: whose networks are merged.
        guides: from :func:`guides_of`.
        combine: how several are combined.
        store: the evaluation store's file, opened once all else is in order; None keeps nothing.
        compute: where and how networks run.
    """
    prepared = [Evaluator(pool, guide, compute=compute) for guide in guides]
    with store_of(store) as kept, ExitStack() as stack:
        evaluators = [stack.enter_context(one.with_store(kept)) for one in prepared]
        say(f"{pool!r}")
        for one in evaluators:
            guide = one.benchmark
            say(f"validation: {guide.name} ({guide.coverage}), {one.metric}, protocol {guide.protocol}")
        say(f"engine: {evaluators[0].engine.describe()}")
        if len(evaluators) == 1:
            yield evaluators, evaluators[0]
            return
        combined = CombinedScorer(evaluators, combine)
        if combined.changes is not None:
            say(f"guided by: {combine} {LABEL} (metrics with and without ground truth)")
        yield evaluators, combined


def described(guides: Sequence[Benchmark], combine: str) -> dict[str, Any]:
    """For a document: the benchmarks' names, and how several are combined."""
    return {
        "validation": [guide.name for guide in guides],
        "combine": combine if len(guides) > 1 else None,
    }


def _named(option: str, text: str, metric: str | None) -> Benchmark:
    """A further benchmark: ``NAME[,root=FOLDER][,protocol=...][,pairs=...]...``, measured by ``metric``,
    or by its own where none is given or only one of the two needs ground truth.
    """
    if not names(text):
        raise InputError(f"{option}: found {text!r}, expected a benchmark such as eth3d,root=~/ETH3D")
    name, *entries = names(text)
    own = metric is None or name == UNLABELLED or not Metric.parse(metric).needs_truth
    values: dict[str, Any] = {"name": name} if own else {"name": name, "metric": metric}
    for entry in entries:
        key, equals, value = (piece.strip() for piece in entry.partition("="))
        if not equals:
            raise InputError(f"{option}: found {entry!r}, expected KEY=VALUE such as root=~/KITTI")
        values[key] = int(value) if key in ("pairs", "every") and value.isdecimal() else value
    (benchmark,) = open_benchmarks([values])
    benchmark.ensure_scorable()
    return benchmark
