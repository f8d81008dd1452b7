"""A sheet of paper for a widget's still: texts, boxes, lines and pictures as one SVG text."""

from __future__ import annotations

import base64
import math
import re
from collections.abc import Iterable, Sequence
from html import escape

INK, MUTED, RULE, PAPER = "#1f2328", "#59636e", "#d0d4d9", "#ffffff"
BLUE, ORANGE, EMPTY = "#2b79cf", "#b34d0c", "#e9e9e9"
PALE = "#93bbe8"  # a blue for what lies around another
WIDTH = 960
MARGIN = 14
LETTER = 0.56
"""Width of a letter, at the mean, in parts of its height."""


def in_lines(name: str, room: float, size: int) -> list[str]:
    """A name in lines of ``room`` pixels, broken after its hyphens and underscores where it can be."""
    most = max(1, int(room / (size * LETTER)))
    lines = [""]
    for part in re.split(r"(?<=[-_])", name):
        if lines[-1] and len(lines[-1] + part) > most:
            lines.append("")
        lines[-1] += part
    return lines


class Sheet:
    """Drawn from the top; ``y`` is where the next part begins, in pixels.

    Args:
        title: the widget's, on the first line.
    """

    def __init__(self, title: str) -> None:
        self.parts: list[str] = []
        self.y = 40.0
        self.title = title
        self.text(MARGIN, 26, title, size=15, bold=True)

    def text(
        self,
        x: float,
        y: float,
        words: str,
        *,
        size: int = 13,
        bold: bool = False,
        colour: str = INK,
        anchor: str = "start",
        room: float = math.inf,
    ) -> None:
        """A line of text, cut where it has no ``room`` in pixels."""
        most = max(1, int(room / (size * LETTER))) if math.isfinite(room) else len(words)
        shown = words if len(words) <= most else f"{words[: most - 1]}…"
        weight = "600" if bold else "400"
        self.parts.append(
            f'<text x="{x:.1f}" y="{y:.1f}" font-size="{size}" fill="{colour}" text-anchor="{anchor}" '
            f'font-weight="{weight}">{escape(shown)}</text>'
        )

    def box(self, x: float, y: float, width: float, height: float, fill: str, edge: str = "none") -> None:
        """A filled rectangle."""
        self.parts.append(
            f'<rect x="{x:.1f}" y="{y:.1f}" width="{max(0.0, width):.1f}" height="{height:.1f}" '
            f'fill="{fill}" stroke="{edge}"/>'
        )

    def line(self, points: Iterable[tuple[float, float]], colour: str, *, dash: str = "none") -> None:
        """A line through points."""
        along = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
        self.parts.append(
            f'<polyline points="{along}" fill="none" stroke="{colour}" stroke-width="2" '
            f'stroke-dasharray="{dash}"/>'
        )

    def dot(self, x: float, y: float, colour: str) -> None:
        """A small disc."""
        self.parts.append(f'<circle cx="{x:.1f}" cy="{y:.1f}" r="2.4" fill="{colour}"/>')

    def picture(self, x: float, y: float, width: float, height: float, data: bytes, mime: str) -> None:
        """A picture from its file's bytes."""
        code = base64.b64encode(data).decode()
        self.parts.append(
            f'<image x="{x:.1f}" y="{y:.1f}" width="{width:.1f}" height="{height:.1f}" '
            f'preserveAspectRatio="none" href="data:{mime};base64,{code}"/>'
        )

    def chart(
        self,
        title: str,
        place: tuple[float, float, float, float],
        lines: Sequence[tuple[str, Sequence[float], Sequence[float | None], str, bool]],
        along: str,
        spans: Sequence[tuple[float, float | None, float | None]] = (),
    ) -> None:
        """A chart of lines and dots with the ends of both axes written at them.

        Args:
            title: what the values are.
            place: left, upper edge, width and height in pixels, with title and axis.
            lines: name, x, y (None is a gap), colour, and whether dots are drawn in place of a line.
            along: what x counts.
            spans: x and the two ends of an upright line behind everything else; None draws none.
        """
        left, top, width, height = place
        upright = [(x, low, high) for x, low, high in spans if low is not None and high is not None]
        known = [y for _, _, values, _, _ in lines for y in values if y is not None]
        known += [end for _, *ends in upright for end in ends]
        xs = [x for _, values, _, _, _ in lines for x in values]
        if not known or not xs:
            return
        (low, high), (first, last) = (min(known), max(known)), (min(xs), max(xs))
        x0, x1, y0, y1 = left + 52, left + width - 8, top + height - 22, top + 26
        self.text(left, top + 12, title, bold=True, room=width)
        for value, y in ((low, y0), (high, y1)):
            self.line([(x0, y), (x1, y)], RULE)
            self.text(x0 - 6, y + 4, f"{value:.4g}", size=11, colour=MUTED, anchor="end")
        for number, x in ((first, x0), (last, x1)):
            self.text(x, y0 + 16, f"{number:g}", size=11, colour=MUTED, anchor="middle")
        names = f"{along}: " + ", ".join(name for name, *_ in lines)
        self.text((x0 + x1) / 2, y0 + 16, names, size=11, colour=MUTED, anchor="middle", room=x1 - x0 - 40)

        def at(x: float, y: float) -> tuple[float, float]:
            # One candidate alone, or equal scores: there is no range to divide by.
            return (
                x0 + (x1 - x0) * (x - first) / ((last - first) or 1),
                y0 + (y1 - y0) * (y - low) / ((high - low) or 1),
            )

        for x, *ends in upright:
            self.line([at(x, end) for end in ends], PALE)
        for _, along_x, values, colour, dots in lines:
            points = [at(x, y) for x, y in zip(along_x, values, strict=True) if y is not None]
            if not dots and len(points) > 1:
                self.line(points, colour)
            for point in points if dots or len(points) == 1 else ():
                self.dot(*point, colour)

    def add(self, other: Sheet) -> None:
        """Another sheet's content, below."""
        self.parts.append(f'<g transform="translate(0 {self.y:.1f})">{"".join(other.parts)}</g>')
        self.y += other.y + MARGIN

    def svg(self) -> str:
        """The sheet, as high as it was drawn on."""
        height = round(self.y + MARGIN)
        return (
            f'<svg xmlns="http://www.w3.org/2000/svg" width="{WIDTH}" height="{height}" '
            f'viewBox="0 0 {WIDTH} {height}" font-family="system-ui, sans-serif">'
            f'<rect x="0.5" y="0.5" width="{WIDTH - 1}" height="{height - 1}" rx="4" fill="{PAPER}" '
            f'stroke="{RULE}"/>{"".join(self.parts)}</svg>'
        )
