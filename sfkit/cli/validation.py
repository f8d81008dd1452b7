"""What guides searches and baselines: one benchmark, or several under one rule."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sfkit.cli.foreseen import ensure_benchmark
from sfkit.cli.groups import names
from sfkit.cli.options import say, store_of
from sfkit.cli.panels import BenchmarkChoice, Guidance
from sfkit.datasets.shipped import UNLABELLED
from sfkit.errors import InputError
from sfkit.outside import once

if TYPE_CHECKING:
    from sfkit.analysis.trust import Trust
    from sfkit.datasets.benchmark import Benchmark
    from sfkit.evaluation import CombinedScorer, Compute, Evaluator
    from sfkit.merging import Pool

FORESEEN = ("root", "protocol", "metric")


def guides_of(
    data: BenchmarkChoice, guidance: Guidance, tests: Sequence[str] | None = None
) -> tuple[Benchmark, ...]:
    """The validation benchmarks, their files found and not yet read.

    Raises:
        InputError: a benchmark, ``--also``, ``--combine`` or one of ``--test`` cannot be understood.
    """
    if guidance.combine not in ("mean", "worst"):
        raise InputError(f"--combine: found {guidance.combine!r}, expected mean or worst")
    if guidance.combine != "mean" and not guidance.also:
        raise InputError(f"--combine: found {guidance.combine} and one benchmark; name others by --also")
    for option, texts in (("--also", guidance.also), ("--test", tests)):
        for text in texts or ():
            values = _arguments(option, text)
            # What else is said is refused, or not, where the benchmark is opened.
            if set(values) <= {"name", *FORESEEN}:
                ensure_benchmark(**values, place=f"{option}: root")
            if option == "--test" and values == {"name": data.benchmark}:
                raise InputError(
                    f"--test: found {text!r}, which guides the search, expected pairs it never sees"
                )
    first = data.open()
    return _distinct([first, *(_named("--also", text, first.metric) for text in guidance.also or ())])


def tests_of(texts: Sequence[str] | None, guides: Sequence[Benchmark]) -> tuple[Benchmark, ...]:
    """The benchmarks of ``--test``, each under its own metric where that has the guides' unit.

    Raises:
        InputError: one cannot be understood, or shares a pair with what guides.
    """
    from sfkit.evaluation.separation import check_separation, under_one_unit

    tests = under_one_unit([one.metric for one in guides], [_named("--test", t, None) for t in texts or ()])
    # Named apart from the guides as well.
    found = _distinct([*guides, *tests])[len(guides) :]
    check_separation(guides, found)
    return found


def guide_of(
    pool: Pool, guides: Sequence[Benchmark], combine: str, compute: Compute
) -> Evaluator | CombinedScorer:
    """What the validation benchmarks say together, before any store is opened.

    Args:
        pool: whose networks are merged.
        guides: from :func:`guides_of`.
        combine: how several are combined.
        compute: where and how networks run.

    Raises:
        InputError: a benchmark cannot be evaluated as it is, or their metrics cannot be combined.
    """
    from sfkit.evaluation import Evaluator
    from sfkit.evaluation.combining import combined

    return combined([Evaluator(pool, guide, compute=compute) for guide in guides], combine)


@contextmanager
def scoring(
    pool: Pool, guide: Evaluator | CombinedScorer, store: Path | None
) -> Iterator[tuple[list[Evaluator], Evaluator | CombinedScorer]]:
    """An evaluator for each validation benchmark, and what they say together.

    Args:
        pool: whose networks are merged.
        guide: from :func:`guide_of`.
        store: the evaluation store's file, opened once all else is in order; None keeps nothing.
    """
    from sfkit.evaluation.combining import LABEL, CombinedScorer, evaluators_of

    with store_of(store) as kept, ExitStack() as stack:
        evaluators = [stack.enter_context(one.with_store(kept)) for one in evaluators_of(guide)]
        say(f"{pool!r}")
        for one in evaluators:
            benchmark = one.benchmark
            say(
                f"validation: {benchmark.name} ({benchmark.coverage}), {one.metric}, "
                f"protocol {benchmark.protocol}"
            )
        say(f"engine: {evaluators[0].engine.describe()}")
        if not isinstance(guide, CombinedScorer):
            yield evaluators, evaluators[0]
            return
        # Made anew, of evaluators that have the store.
        together = CombinedScorer(evaluators, guide.how)
        if together.changes is not None:
            say(f"guided by: {together.how} {LABEL} (metrics with and without ground truth)")
        yield evaluators, together


def described(guides: Sequence[Benchmark], combine: str) -> dict[str, Any]:
    """For a document: the benchmarks' names, and how several are combined."""
    return {
        "validation": [guide.name for guide in guides],
        "combine": combine if len(guides) > 1 else None,
    }


def trust_entry(trusted: Trust) -> dict[str, Any]:
    """For a document: what speaks for and against a guide without labels."""
    return {"trust": {**asdict(trusted), "trusted": trusted.trusted, "sentence": trusted.sentence}}


def trust_lines(trusted: Trust) -> list[str]:
    """For a text: the sentence, where no warning has said it already."""
    return [trusted.sentence] if trusted.trusted else []


def _distinct(benchmarks: Sequence[Benchmark]) -> tuple[Benchmark, ...]:
    """Folders of one name are told apart: the second of ``pairs`` is ``pairs (2)``."""
    found: dict[str, Benchmark] = {}
    for one in benchmarks:
        name, number = one.name, 1
        while name in found:
            number += 1
            name = f"{one.name} ({number})"
        found[name] = replace(one, name=name)
    return tuple(found.values())


def _named(option: str, text: str, metric: str | None) -> Benchmark:
    """A further benchmark: ``NAME[,root=FOLDER][,protocol=...][,pairs=...]...``, measured by ``metric``,
    or by its own where none is given or only one of the two needs ground truth.
    """
    from sfkit.datasets.benchmark import open_benchmarks
    from sfkit.datasets.metric import Metric

    values = _arguments(option, text)
    own = metric is None or values["name"] == UNLABELLED or not Metric.parse(metric).needs_truth
    (benchmark,) = open_benchmarks([values if own else {"metric": metric, **values}])
    benchmark.ensure_scorable()
    return benchmark


def _arguments(option: str, text: str) -> dict[str, Any]:
    """What is said of a further benchmark, by name."""
    if not names(text):
        raise InputError(f"{option} is empty, expected a benchmark such as kitti2012,root=~/KITTI")
    name, *entries = names(text)
    return dict(once(option, [("name", name), *(_entry(option, entry) for entry in entries)]))


def _entry(option: str, text: str) -> tuple[str, str | int]:
    key, _, value = (piece.strip() for piece in text.partition("="))
    if not value:
        raise InputError(f"{option}: found {text!r}, expected KEY=VALUE such as root=~/KITTI")
    return key, int(value) if key in ("pairs", "every") and value.isdecimal() else value
