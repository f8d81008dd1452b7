"""``docs/published.md``: the paper's tables, and where they disagree, made by a command.

Run ``python -m sfkit.published.page docs`` in a checkout.
"""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from sfkit.published.checks import disagreements, wrong_marks, wrong_means
from sfkit.published.claims import QUOTES, REMARKS
from sfkit.published.tables import LABELS, PublishedTable, published_table

INTRODUCTION = """\
# The paper's numbers

Every table of StereoFactory as `sfkit.published.published(label)` returns it, a DataFrame a label. KITTI
columns are D1 in percent, `middlebury` is bad-2.0 and `eth3d` bad-1.0 in percent; lower is better. In the
paper ETH3D guides the searches, so that its column is no test. **Bold** and _italics_ stand where the paper
prints bold and underlined. This page is made by `python -m sfkit.published.page docs`; a test compares
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
    rule = ["---"] * values.index.nlevels + ["--:"] * len(values.columns)
    rows = [head, rule]
    for number, name in enumerate(values.index):
        names = [*name] if isinstance(name, tuple) else [name]
        cells = [
            _cell(values.iloc[number, column], marks.iloc[number, column])
            for column in range(len(values.columns))
        ]
        rows.append([*(str(part).replace("*", "\\*") for part in names), *cells])
    return "\n".join("| " + " | ".join(row) + " |" for row in rows)


def _cell(value: object, mark: object) -> str:
    text = f"{value:g}" if isinstance(value, float) else str(value)
    return {"best": f"**{text}**", "second": f"_{text}_"}.get(str(mark), text)


if __name__ == "__main__":
    print(write_page(Path(sys.argv[1] if len(sys.argv) > 1 else "docs")))
