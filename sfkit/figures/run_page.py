"""All searches of a folder as one page that needs no network: a sortable table, and small pictures.

Pictures are SVG in the page: no library is loaded, and what a journal says is escaped.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from html import escape
from importlib.resources import files

from sfkit.analysis.run_overview import (
    COLUMNS,
    RoutedCandidate,
    RunOverview,
    StageOverview,
    parallel_axes,
    run_cells,
)

WIDTH, HEIGHT, LEFT, BOTTOM = 420, 170, 54, 24
NAMES = 90  # below parallel axes: their names stand upright, for side by side they would overlap
# The page runs its own script alone and fetches nothing.
_POLICY = "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'"


def run_page(overviews: Sequence[RunOverview], metrics: Mapping[str, str], title: str) -> str:
    """The page as HTML.

    Args:
        overviews: the searches, in order.
        metrics: folder -> metric and unit of its scores, where they are known.
        title: heading.
    """
    rows, pictures = [], []
    for run in overviews:
        folder = str(run.folder)
        metric = metrics.get(folder, "")
        pictures.append(f"<h2>{escape(folder)}</h2>")
        for stage in run.stages:
            rows.append(_row(folder, metric, stage))
            pictures.append(_pictures(stage, metric))
    heads = "".join(f"<th scope='col'><button>{name}</button></th>" for name in COLUMNS)
    here = files("sfkit.figures")
    return (
        "<!doctype html>\n<html lang='en'><head><meta charset='utf-8'>"
        f'<meta http-equiv="Content-Security-Policy" content="{_POLICY}">'
        "<meta name='viewport' content='width=device-width'>"
        f"<title>{escape(title)}</title><style>{here.joinpath('run_page.css').read_text(encoding='utf-8')}"
        f"</style></head><body><main><h1>{escape(title)}</h1>"
        "<p>Lower is better. A heading of the table sorts by its column.</p>"
        f"<div class='wide'><table><thead><tr>{heads}"
        f"</tr></thead><tbody>{''.join(rows)}</tbody></table></div>{''.join(pictures)}</main>"
        f"<script>{here.joinpath('run_page.js').read_text(encoding='utf-8')}</script></body></html>\n"
    )


def _row(folder: str, metric: str, stage: StageOverview) -> str:
    cells = run_cells(folder, metric, stage)
    return (
        "<tr>"
        + "".join(
            # JavaScript reads Infinity, and not inf.
            f"<td data-sort='{escape('Infinity' if key == math.inf else str(key))}'>{escape(text)}</td>"
            for text, key in cells
        )
        + "</tr>"
    )


def _pictures(stage: StageOverview, metric: str) -> str:
    parts = [
        _figure(f"{stage.run.stage}: best so far", _best_so_far(stage.best_so_far), "candidates", metric)
    ]
    if stage.importance:
        title = f"{stage.run.stage}: how much the best score rises without a source"
        parts.append(_figure(title, _importance(stage.importance), "", metric))
    if stage.routes:
        title = (
            f"{stage.run.stage}: every candidate, mean weights, scales and score; the best tenth in colour"
        )
        parts.append(_figure(title, _parallel(stage.routes), "", metric, HEIGHT + NAMES))
    return f"<div class='row'>{''.join(parts)}</div>"


def _figure(title: str, drawing: str, below: str, metric: str, height: int = HEIGHT) -> str:
    axis = f"<text x='{(WIDTH + LEFT) / 2}' y='{HEIGHT - 4}' text-anchor='middle'>{escape(below)}</text>"
    unit = f" ({escape(metric)})" if metric else ""
    return (
        f"<figure><figcaption>{escape(title)}{unit}</figcaption>"
        f"<svg viewBox='0 0 {WIDTH} {height}' role='img' aria-label='{escape(title)}'>"
        f"{drawing}{axis}</svg></figure>"
    )


def _best_so_far(scores: Sequence[float]) -> str:
    known = [(number, score) for number, score in enumerate(scores) if math.isfinite(score)]
    if not known:
        return f"<text x='{WIDTH / 2}' y='{HEIGHT / 2}' text-anchor='middle'>no finite score</text>"
    # The best so far only falls.
    low, high = known[-1][1], known[0][1]
    span = (high - low) or 1.0
    points, last = [], known[0][1]
    for number, score in known:
        x = LEFT + (WIDTH - LEFT - 8) * number / max(len(scores) - 1, 1)
        # A step: along at the old height, then down.
        points += [(x, _y(last, low, span)), (x, _y(score, low, span))]
        last = score
    line = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    return (
        f"<polyline class='line' points='{line}'/>"
        f"<text x='{LEFT - 6}' y='{_y(high, low, span) + 4:.0f}' text-anchor='end'>{high:.3g}</text>"
        + (
            ""
            if high == low
            else f"<text x='{LEFT - 6}' y='{_y(low, low, span) + 4:.0f}' text-anchor='end'>{low:.3g}</text>"
        )
        + f"<text x='{WIDTH - 8}' y='{HEIGHT - 4}' text-anchor='end'>{len(scores)}</text>"
    )


def _y(value: float, low: float, span: float) -> float:
    return 14 + (HEIGHT - BOTTOM - 24) * (1 - (value - low) / span)


def _importance(importance: Mapping[str, float]) -> str:
    ordered = sorted(importance.items(), key=lambda entry: -entry[1])
    top = max((rise for rise in importance.values() if math.isfinite(rise)), default=0.0) or 1.0
    step, parts = (HEIGHT - 8) / len(ordered), []
    for number, (source, rise) in enumerate(ordered):
        y = 4 + step * number
        # A source of every subset, whose rise is infinite, is as long as the longest.
        width = 190 * min(rise / top, 1.0)
        text = "in every subset that was scored" if math.isinf(rise) else f"{rise:.3g}"
        parts.append(
            f"<text x='130' y='{y + step / 2 + 4:.1f}' text-anchor='end'>{escape(source)}</text>"
            f"<rect class='bar' x='136' y='{y + 1:.1f}' width='{width:.1f}' height='{max(step - 2, 1):.1f}'/>"
            f"<text x='{140 + width:.1f}' y='{y + step / 2 + 4:.1f}'>{escape(text)}</text>"
        )
    return "".join(parts)


def _parallel(routes: Sequence[RoutedCandidate]) -> str:
    axes = parallel_axes(routes)
    names, lows, highs = axes.names, axes.lows, axes.highs
    xs = [24 + (WIDTH - 48) * number / max(len(names) - 1, 1) for number in range(len(names))]
    lines = []
    for number in axes.lines:  # the best are drawn last, on top
        # A single value has no range; its line is flat.
        points = " ".join(
            f"{x:.1f},{_y(value, low, (high - low) or 1.0):.1f}"
            for x, value, low, high in zip(xs, axes.values[number], lows, highs, strict=True)
        )
        kind = "line" if number in axes.best else "faint"
        tip = ", ".join(f"{name} {value:.3g}" for name, value in zip(names, axes.values[number], strict=True))
        lines.append(
            f"<polyline class='{kind}' points='{points}'>"
            f"<title>{escape(f'evaluation {routes[number].number}: {tip}')}</title></polyline>"
        )
    below = HEIGHT - BOTTOM + 12
    for x, name, low, high in zip(xs, names, lows, highs, strict=True):
        lines.append(
            f"<line class='axis' x1='{x:.1f}' x2='{x:.1f}' y1='14' y2='{HEIGHT - BOTTOM - 10}'/>"
            f"<text x='{x:.1f}' y='10' text-anchor='middle'>{high:.2g}</text>"
            f"<text x='{x:.1f}' y='{HEIGHT - BOTTOM + 2}' text-anchor='middle'>{low:.2g}</text>"
            f"<text transform='translate({x + 4:.1f} {below}) rotate(-90)' text-anchor='end'>"
            f"{escape(name)}</text>"
        )
    return "".join(lines)
