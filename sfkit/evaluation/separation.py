"""Validation and test kept apart: a benchmark that guided a search is no test of what it found."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence, Set
from contextlib import suppress
from dataclasses import dataclass
from typing import TYPE_CHECKING

from sfkit.datasets.benchmark import Benchmark
from sfkit.datasets.digests import file_digest
from sfkit.datasets.metric import Metric
from sfkit.datasets.pairs import Pair, StereoPair
from sfkit.datasets.training_set import FilePair
from sfkit.errors import InputError

if TYPE_CHECKING:  # the command line refuses --test before torch is imported
    from sfkit.merging.pool import Pool

GUIDED = "*"
"""Stands behind the name of what guided a search: its scores are no test."""
DIGITS = 16
"""Of the digests that a trained network's file names its pairs by."""
MOST_SEEN = 10_000
"""Pairs of a larger training set are not named one by one: a file's header would grow without end."""
PERCENT = "bad-1.0"
"""What tests in pixels are measured by where a guide without ground truth is in percent."""


@dataclass(frozen=True)
class Separation:
    """How validation and reported benchmarks relate.

    Attributes:
        validation: names of the benchmarks that guide the search.
        shared: reported benchmark -> ids of its pairs that the search sees as well; empty where the two
            are apart.
        columns: what a table shows: the validation benchmarks, then the reported ones, each set of pairs
            under one protocol once.
    """

    validation: tuple[str, ...]
    shared: Mapping[str, tuple[str, ...]]
    columns: tuple[Benchmark, ...]

    @property
    def clean(self) -> bool:
        """True where no reported pair was seen by the search."""
        return not self.shared

    @property
    def guided(self) -> tuple[str, ...]:
        """Names of all columns that are no test: to be marked in tables."""
        return tuple(dict.fromkeys((*self.validation, *self.shared)))

    def __str__(self) -> str:
        guide = " and ".join(self.validation)
        if self.clean:
            return f"The search sees {guide} only; no pair of it is in the benchmarks reported as a test."
        seen = "; ".join(f"{name} ({', '.join(ids)})" for name, ids in self.shared.items())
        return (
            f"The search was guided by pairs that are also reported: {seen}. "
            f"Scores marked {GUIDED} are validation scores, not a test."
        )


def check_separation(
    validation: Benchmark | Sequence[Benchmark],
    reported: Sequence[Benchmark],
    *,
    allow: bool = False,
) -> Separation:
    """Compare the pairs a search would see with those a report would test on.

    Two pairs are one where their fingerprints agree or their left images are the same file, whatever
    they are called and however their ground truth is coded. Images that were re-coded are not recognised.

    Args:
        validation: what guides the search.
        reported: what its result is tested on.
        allow: the explicit word: let pairs be in both, and say so.

    Raises:
        InputError: pairs are in both and ``allow`` is False, or two different benchmarks have one name.
    """
    guides = (validation,) if isinstance(validation, Benchmark) else tuple(validation)
    shared = pairs_in_common(guides, reported)
    if shared and not allow:
        name, ids = next(iter(shared.items()))
        raise InputError(
            f"benchmark {name!r}: found {_listed(ids)} among the pairs that guide the search, expected pairs "
            "it never sees: report on others, or allow it (allow_validation_in_report=True in a notebook), "
            "and the report says so"
        )
    return Separation(tuple(guide.name for guide in guides), shared, _columns((*guides, *reported)))


def under_one_unit(guides: Sequence[str], tests: Sequence[Benchmark]) -> list[Benchmark]:
    """Tests under their own metrics where these have the guides' unit, else under the guides' metric.

    Args:
        guides: the metrics that guide; one that needs no ground truth is percent, and ``bad-1.0`` its like.
        tests: the benchmarks.
    """
    guide = Metric.parse(next((name for name in guides if Metric.parse(name).needs_truth), PERCENT))
    return [
        one if Metric.parse(one.metric).unit == guide.unit else one.measured_by(metric=guide.name)
        for one in tests
    ]


def pairs_in_common(seen: Iterable[Benchmark], reported: Iterable[Benchmark]) -> dict[str, tuple[str, ...]]:
    """Reported benchmark -> ids of its pairs that are in ``seen`` as well, where there are any."""
    known = {identity for benchmark in seen for identity in all_identities(benchmark)}
    return seen_in(known, reported)


def seen_in(known: Set[str], reported: Iterable[Benchmark]) -> dict[str, tuple[str, ...]]:
    """The same, of what :func:`identities` gave for the pairs that were seen."""
    shared = {one.name: tuple(pair.id for pair in one.pairs if known & identities(pair)) for one in reported}
    return {name: ids for name, ids in shared.items() if ids}


def all_identities(benchmark: Benchmark) -> frozenset[str]:
    """What tells the pairs of a benchmark from others."""
    return frozenset(identity for pair in benchmark.pairs for identity in identities(pair))


def marked(label: str, guided: bool) -> str:
    """A label with the ``*`` that says: this guided a search, or a person by hand, and is no test."""
    return f"{label} {GUIDED}" if guided else label


def column_name(benchmark: str, protocol: str, metric: str, unit: str, *, guided: bool) -> str:
    """The heading of a benchmark's scores, such as ``eth3d (openstereo) bad-1.0 [%] *``."""
    return marked(f"{benchmark} ({protocol}) {metric} [{unit}]", guided)


def identities(pair: Pair) -> set[str]:
    """What tells a pair from others: two that share one of these are one pair."""
    identities = {pair.fingerprint()}
    if isinstance(pair, StereoPair):
        # Ground truth in another coding has another fingerprint; the image is the same.
        identities.add(file_digest(pair.left))
    return identities


def seen_in_training(pairs: Sequence[Pair]) -> str:
    """Digests of a training set's pairs in one text, as a trained network's file carries them.

    Of a pair on disk it is that of the left image, of any other its fingerprint. Empty for more than 10,000
    pairs; a file that cannot be read is left out, for no training saw it.
    """
    found = []
    for pair in pairs if len(pairs) <= MOST_SEEN else ():
        with suppress(InputError):
            found.append(
                file_digest(pair.files()["left"]) if isinstance(pair, FilePair) else pair.fingerprint()
            )
    return " ".join(digest[:DIGITS] for digest in sorted(found))


def trained_on(pool: Pool, benchmark: Benchmark) -> str | None:
    """One sentence where members of a pool were trained on pairs of a benchmark, as their files tell.

    None where they were not, and where no file tells.
    """
    members = [member for member in (pool.base, *pool.sources) if member.seen]
    pairs = [{one[:DIGITS] for one in identities(pair)} for pair in benchmark.pairs] if members else []
    counts = {member.name: sum(bool(pair & member.seen) for pair in pairs) for member in members}
    learned = [f"{name!r} ({count} of {len(pairs)})" for name, count in counts.items() if count]
    if not learned:
        return None
    return (
        f"benchmark {benchmark.name!r}: members of the pool were trained on its pairs, which flatter them: "
        f"{', '.join(learned)}; validate and test on others"
    )


def _columns(benchmarks: Iterable[Benchmark]) -> tuple[Benchmark, ...]:
    columns: dict[str, Benchmark] = {}
    for benchmark in benchmarks:
        known = columns.setdefault(benchmark.name, benchmark)
        # Two contents by one name would share a column.
        if known is not benchmark and _content(known) != _content(benchmark):
            raise InputError(
                f"benchmark {benchmark.name!r}: found two of this name with other pairs or another protocol, "
                "expected a name for each: choose one protocol for both, or rename a folder of pairs"
            )
    return tuple(columns.values())


def _content(benchmark: Benchmark) -> tuple[str, str]:
    return benchmark.fingerprint(), benchmark.protocol


def _listed(ids: Sequence[str]) -> str:
    more = f" and {len(ids) - 3} more" if len(ids) > 3 else ""
    return ", ".join(ids[:3]) + more
