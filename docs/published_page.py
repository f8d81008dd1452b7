"""``docs/published.md``: the paper's tables, and where they disagree, made by a command.

Run ``python docs/published_page.py`` in a checkout.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from published_claims import EXPERIMENTS, QUOTES, REMARKS, ROUNDING

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))

from tabulated import markdown_lines

from sfkit.published.tables import (
    BENCHMARKS,
    FOUNDATION_STEREO,
    LABELS,
    NMRF,
    PublishedTable,
    numbers,
    published_table,
)

INTRODUCTION = """\
# The paper's numbers

Every table of StereoFactory as `sfkit.published.published(label)` returns it, a DataFrame a label. KITTI
columns are D1 in percent, `middlebury` is bad-2.0 and `eth3d` bad-1.0 in percent; lower is better. In the
paper ETH3D guides the searches, so that its column is no test. **Bold** and _italics_ stand where the paper
prints bold and underlined. This page is made by `python docs/published_page.py`; a test compares
each printed mean with its row, each mark with its column, and each number quoted in the text with its table.
"""


def write_page(docs: Path) -> Path:
    """Write ``docs/published.md`` and return its path."""
    page = docs / "published.md"
    page.parent.mkdir(parents=True, exist_ok=True)
    page.write_text("\n".join([INTRODUCTION, *_findings(), *_tables()]), encoding="utf-8")
    return page


def _findings() -> Iterable[str]:
    found = disagreements()
    yield "## Where the tables disagree\n"
    for number, finding in enumerate(found, start=1):
        yield f"{number}. {finding.title}."
        yield from (f"   - {line}" for line in finding.evidence)
    means, marks = len(wrong_means()), len(wrong_marks())
    right = len(QUOTES) - sum(finding.title.startswith("The text") for finding in found)
    yield f"\nPrinted means that are not those of their rows: {means}. Rows or columns with a wrong mark of"
    yield f"best or second best: {marks}. Quotes of the text that agree with their tables: {right} of"
    yield f"{len(QUOTES)} checked.\n"
    yield "What a reader should know before comparing:\n"
    yield from (f"- {remark}" for remark in REMARKS)


def _tables() -> Iterable[str]:
    yield "\n## The tables\n"
    for label in LABELS:
        table = published_table(label)
        yield f"### {label}\n\n{table.about}.\n"
        yield _markdown(table)
        yield ""


def _markdown(table: PublishedTable) -> str:
    values, marks = table.values, table.marks
    head = [*map(str, values.index.names), *map(str, values.columns)]
    right = [False] * values.index.nlevels + [True] * len(values.columns)
    rows = []
    for number, name in enumerate(values.index):
        names = [*name] if isinstance(name, tuple) else [name]
        cells = [
            _cell(values.iloc[number, column], marks.iloc[number, column])
            for column in range(len(values.columns))
        ]
        rows.append([*(str(part).replace("*", "\\*") for part in names), *cells])
    return markdown_lines(head, rows, right)


def _cell(value: object, mark: object) -> str:
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return {"best": f"**{text}**", "second": f"_{text}_"}.get(str(mark), text)


@dataclass(frozen=True)
class Contradiction:
    """One finding.

    Attributes:
        title: what disagrees, in one line.
        evidence: one line a place, with its numbers.
    """

    title: str
    evidence: tuple[str, ...]


def disagreements() -> tuple[Contradiction, ...]:
    """Every experiment printed with different scores, and every quote its table does not bear out."""
    return (*_experiments(), *_quotes())


def _experiments() -> Iterator[Contradiction]:
    for experiment in EXPERIMENTS:
        rows = [(place, place.scores()) for place in experiment.places]
        if any(math.dist(rows[0][1], scores) > ROUNDING for _, scores in rows[1:]):
            evidence = tuple(
                f"{place}: {', '.join(f'{v:g}' for v in scores)} (mean {math.fsum(scores) / len(scores):.2f})"
                for place, scores in rows
            )
            yield Contradiction(f"{experiment.name}: one experiment, different scores", evidence)


def _quotes() -> Iterator[Contradiction]:
    for quote in QUOTES:
        held = quote.compute()
        if abs(held - quote.printed) > quote.rounding:
            seen = "; ".join(_where(quote.label, quote.printed)) or "nowhere in it"
            yield Contradiction(
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


if __name__ == "__main__":
    print(write_page(Path(sys.argv[1]) if len(sys.argv) > 1 else Path(__file__).parent))
