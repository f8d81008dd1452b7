"""Small tables as HTML, for what a notebook shows of an object at the end of a cell.

Everything is escaped. Colours and fonts are those of the page it stands on, light or dark.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape

MOST_ROWS = 24
"""Longer tables end with how many rows more there are."""

_LINE = "border-bottom: 1px solid color-mix(in srgb, currentColor 25%, transparent)"
_CELL = f"text-align: left; padding: 2px 14px 2px 0; {_LINE}"


def card(
    title: str,
    facts: Mapping[str, object],
    *,
    columns: Sequence[str] = (),
    rows: Sequence[Sequence[object]] = (),
) -> str:
    """A title, facts by name, and a table.

    Args:
        title: what it is, and its name.
        facts: name -> value; those that are None or empty are left out.
        columns: heads of the table.
        rows: its rows, as long as ``columns``.
    """
    parts = [f"<strong>{escape(title)}</strong>"]
    # Zero is worth showing, what is empty is not.
    known = {name: str(value) for name, value in facts.items() if value is not None and str(value)}
    parts += [f"<div>{escape(name)}: {escape(value)}</div>" for name, value in known.items()]
    if rows:
        heads = "".join(f'<th scope="col" style="{_CELL}">{escape(name)}</th>' for name in columns)
        body = "".join(f"<tr>{''.join(map(_cell, row))}</tr>" for row in rows[:MOST_ROWS])
        parts.append(
            f'<table style="border-collapse: collapse; margin-top: 4px"><thead><tr>{heads}</tr></thead>'
            f"<tbody>{body}</tbody></table>"
        )
        if len(rows) > MOST_ROWS:
            parts.append(f"<div>and {len(rows) - MOST_ROWS} more</div>")
    return f'<div style="color: inherit; line-height: 1.5">{"".join(parts)}</div>'


def _cell(value: object) -> str:
    return f'<td style="{_CELL}">{escape(str(value))}</td>'
