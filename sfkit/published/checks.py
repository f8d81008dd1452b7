"""Where the paper's tables disagree with each other, or with what its text quotes from them.

Two kinds of check run over the tables: one experiment that is printed in several places must have one row
of numbers, and a number quoted in the text must follow from the table it is quoted from. What fails is
listed; what the checks cannot see stands in :data:`~sfkit.published.claims.REMARKS`.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from sfkit.published.claims import EXPERIMENTS, QUOTES, ROUNDING
from sfkit.published.tables import BENCHMARKS, FOUNDATION_STEREO, LABELS, NMRF, numbers, published_table


@dataclass(frozen=True)
class Disagreement:
    """One finding.

    Attributes:
        title: what disagrees, in one line.
        evidence: one line a place, with its numbers.
    """

    title: str
    evidence: tuple[str, ...]


def disagreements() -> tuple[Disagreement, ...]:
    """Every experiment printed with different scores, and every quote its table does not bear out."""
    return (*_experiments(), *_quotes())


def _experiments() -> Iterator[Disagreement]:
    for experiment in EXPERIMENTS:
        rows = [(place, place.scores()) for place in experiment.places]
        if any(math.dist(rows[0][1], scores) > ROUNDING for _, scores in rows[1:]):
            evidence = tuple(
                f"{place}: {', '.join(f'{v:g}' for v in scores)} (mean {math.fsum(scores) / len(scores):.2f})"
                for place, scores in rows
            )
            yield Disagreement(f"{experiment.name}: one experiment, different scores", evidence)


def _quotes() -> Iterator[Disagreement]:
    for quote in QUOTES:
        held = quote.compute()
        if abs(held - quote.printed) > quote.rounding:
            seen = "; ".join(_where(quote.label, quote.printed)) or "nowhere in it"
            yield Disagreement(
                f"The text says: {quote.text}",
                (f"{quote.label} gives {held:g}", f"{quote.printed:g} stands in it at: {seen}"),
            )


def _where(label: str, value: float) -> Iterator[str]:
    for (row, column), cell in numbers(label).items():
        if abs(cell - value) <= 1e-9:
            yield f"{row if isinstance(row, str) else ' '.join(row)}, {column}"


def wrong_means() -> tuple[str, ...]:
    """Rows whose printed mean is not that of their four scores, within rounding; none if all is well."""
    found = []
    for label in LABELS:
        held = numbers(label)
        for row in dict.fromkeys(row for row, column in held if column == "mean"):
            mean = math.fsum(held[row, benchmark] for benchmark in BENCHMARKS) / len(BENCHMARKS)
            if abs(mean - held[row, "mean"]) > ROUNDING:
                found.append(f"{label}, {row}: {held[row, 'mean']:g}, not {mean:g}")
    return tuple(found)


def wrong_marks() -> tuple[str, ...]:
    """Cells printed as best or second best that are not, or the reverse; none if all is well.

    ``tab:merging_comparison`` marks within the columns of an architecture, the two tables of sources and
    combinations within rows, as their captions say.
    """
    found = []
    for label, by_row in (
        ("tab:merging_comparison", False),
        ("tab:individual_datasets", True),
        ("tab:benchmark_results", True),
    ):
        table = published_table(label)
        for architecture in (NMRF, FOUNDATION_STEREO):
            values = table.values.loc[architecture].to_numpy(float)
            marks = table.marks.loc[architecture].to_numpy(str)
            for group, printed in zip(*((values, marks) if by_row else (values.T, marks.T)), strict=True):
                ranked = sorted(set(group))
                earned = [{ranked[0]: "best", ranked[1]: "second"}.get(value, "") for value in group]
                if earned != list(printed):
                    found.append(f"{label}, {architecture}: {list(printed)}, earned {earned}")
    return tuple(found)
