"""What each widget looks like on paper, from the same state its script draws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from sfkit_widgets._pictures import MIME
from sfkit_widgets._sheet import BLUE, EMPTY, MARGIN, MUTED, ORANGE, WIDTH, Sheet, in_lines

GAP = 10
INNER = WIDTH - 2 * MARGIN
NAMES = 150  # px for names of rows
ROW = 24


def weights_table(
    sheet: Sheet,
    sources: Sequence[str],
    blocks: Sequence[str],
    rows: Sequence[Sequence[float]],
    scales: Sequence[float],
    colour: Any,
) -> None:
    """Weights of blocks (rows) over sources, each in its colour, and module scales.

    ``colour`` gives background and text colour of a weight.
    """
    wide = (INNER - NAMES - 70) / len(sources)
    lines = [in_lines(source, wide - 4, 11) for source in sources]
    sheet.y += 13 * (max(map(len, lines)) - 1)
    for e, words in enumerate(lines):
        middle = MARGIN + NAMES + (e + 0.5) * wide
        # From the bottom up: names of one line and of three end at the same height.
        for n, line in enumerate(reversed(words)):
            top = sheet.y + 14 - 13 * n
            sheet.text(middle, top, line, size=11, colour=MUTED, anchor="middle", room=wide - 4)
    sheet.text(WIDTH - MARGIN, sheet.y + 14, "scale", size=11, colour=MUTED, anchor="end")
    for b, block in enumerate(blocks):
        top = sheet.y + 20 + b * ROW
        sheet.text(MARGIN, top + 16, block, room=NAMES)
        # A tied recipe comes with one row for all blocks.
        for e, weight in enumerate(rows[b if len(rows) > 1 else 0]):
            fill, ink = colour(weight)
            left = MARGIN + NAMES + e * wide
            sheet.box(left, top, wide - 2, ROW - 2, fill)
            sheet.text(left + wide / 2, top + 16, f"{weight:.2f}", size=12, colour=ink, anchor="middle")
        sheet.text(WIDTH - MARGIN, top + 16, f"× {scales[b]:.2f}", anchor="end")
    sheet.y += 28 + len(blocks) * ROW


def pictures(sheet: Sheet, shown: Sequence[tuple[str, bytes]], size: Sequence[int], columns: int) -> None:
    """Captioned JPEG pictures of one size (height, width), in rows of ``columns``."""
    width = (INNER - (columns - 1) * GAP) / columns
    height = width * size[0] / size[1]
    for n, (caption, data) in enumerate(shown):
        left = MARGIN + n % columns * (width + GAP)
        top = sheet.y + n // columns * (height + 26)
        sheet.text(left, top + 14, caption, size=12, room=width)
        sheet.picture(left, top + 20, width, height, data, MIME)
    sheet.y += -(-len(shown) // columns) * (height + 26)


def inspector_sheet(widget: Any) -> Sheet:
    """Weights, scales, the pair's four pictures, scores."""
    sheet = Sheet("Routing inspector")
    shades = widget.shades
    weights_table(
        sheet,
        widget.sources,
        widget.blocks,
        widget.weights,
        widget.scales,
        lambda weight: shades[round(weight * (len(shades) - 1))],
    )
    name, unit = widget.metric["name"], widget.metric["unit"]
    pair, whole = (_score(score, unit) for score in (widget.look["score"], widget.scores))
    sheet.text(
        MARGIN, sheet.y + 12, f"pair {widget.pair}: {name} {pair}; {widget.metric['benchmark']}: {whole}"
    )
    sheet.y += 22
    captions = widget.captions
    shown = [
        ("left image", widget.left_picture),
        (captions["truth"], widget.truth_picture),
        (f"disparity, {' to '.join(widget.legends['disparity']['ticks'][::2])}", widget.disparity_picture),
        (f"{captions['error']}, {' to '.join(widget.legends['error']['ticks'][::2])}", widget.error_picture),
    ]
    pictures(sheet, shown, widget.size, columns=2)
    return sheet


def _score(score: Mapping[str, Any], unit: str) -> str:
    return f"{score['value']:.2f} {unit}" if score["value"] is not None else score["state"]


def control_sheet(progress: Mapping[str, Any]) -> Sheet:
    """Phase, bar and figures of a search."""
    sheet = Sheet(progress["title"])
    share = progress["done"] / progress["total"] if progress["total"] else 0.0
    sheet.box(MARGIN, sheet.y, INNER, 12, EMPTY)
    sheet.box(MARGIN, sheet.y, INNER * min(1.0, share), 12, BLUE)
    words = f"{progress['phase']}: {progress['says']}"
    sheet.text(MARGIN, sheet.y + 32, words, room=INNER)
    figures = ", ".join(f"{label} {value}" for label, value in progress["figures"])
    sheet.text(MARGIN, sheet.y + 54, figures, size=12, colour=MUTED, room=INNER)
    sheet.y += 64
    if best := progress["best"]:
        words = f"Best so far: {best['score']}, candidate {best['candidate']}: {', '.join(best['sources'])}"
        sheet.text(MARGIN, sheet.y + 12, words, bold=True, room=INNER)
        sheet.y += 20
    return sheet


def population_sheet(evolution: Mapping[str, Any], model: Mapping[str, Any]) -> Sheet:
    """Scores by generation, shares of sources, the best subsets; what a model expected."""
    sheet = Sheet("Population of the subset search")
    if not evolution:
        return _nothing(sheet, "No generation yet.")
    x, people, sources = evolution["generations"], evolution["people"], evolution["sources"]
    half = INNER / 2 - GAP
    lines = [
        ("median (orange)", x, evolution["median"], ORANGE, False),
        ("best so far (blue)", x, evolution["best"], BLUE, False),
    ]
    top = sheet.y
    sheet.chart(evolution["metric"], (MARGIN, top, half, 200), lines, "generation")
    left, last = MARGIN + half + 2 * GAP, evolution["share"][-1]
    sheet.text(left, top + 12, f"Have the source in generation {x[-1]}", bold=True, room=half)
    for e, source in enumerate(sources):
        at = top + 24 + e * 18
        sheet.text(left, at + 12, source, size=12, room=NAMES - 4)
        sheet.box(left + NAMES, at, half - NAMES - 50, 13, EMPTY)
        sheet.box(left + NAMES, at, (half - NAMES - 50) * last[e], 13, BLUE)
        sheet.text(left + half, at + 12, f"{100 * last[e]:.0f} %", size=12, anchor="end")
    sheet.y = top + max(210, 32 + 18 * len(sources))
    for rank, number in enumerate(evolution["archive"], start=1):
        one = people[str(number)]
        words = f"{rank}. {one['score']}: {', '.join(sources[e] for e in one['sources'])}"
        sheet.text(MARGIN, sheet.y + 14, words, size=12, room=INNER)
        sheet.y += 19
    _expected(sheet, model)
    return sheet


def routing_sheet(trace: Mapping[str, Any], model: Mapping[str, Any]) -> Sheet:
    """The best recipe, scores and scales by evaluation; what a model expected."""
    sheet = Sheet("Routing search")
    if not trace:
        return _nothing(sheet, "No evaluation yet.")
    # Where every evaluation failed there is no best one: the last is shown.
    at = trace["best"] if trace["best"] is not None else len(trace["drawn"]) - 1
    shades = trace["shades"]
    sheet.text(MARGIN, sheet.y + 12, f"evaluation {trace['drawn'][at]}: {trace['text'][at]}", room=INNER)
    sheet.y += 20
    weights_table(
        sheet,
        trace["sources"],
        trace["blocks"],
        trace["weights"][at],
        trace["scales"][at],
        lambda weight: shades[round(weight * (len(shades) - 1))],
    )
    best = [None if n is None else trace["score"][n] for n in trace["incumbent"]]
    lines = [
        ("candidate (orange)", trace["drawn"], trace["score"], ORANGE, True),
        ("best so far (blue)", trace["drawn"], best, BLUE, False),
    ]
    sheet.chart(trace["metric"], (MARGIN, sheet.y, INNER, 190), lines, "evaluation")
    sheet.y += 196
    _expected(sheet, model)
    return sheet


def runs_sheet(columns: Sequence[str], rows: Sequence[Mapping[str, Any]], most: int = 20) -> Sheet:
    """The table of searches, and the best so far of the first."""
    sheet = Sheet("Searches")
    if not rows:
        return _nothing(sheet, "No search has left a journal here.")
    widths = [0.15, 0.07, 0.08, 0.12, 0.07, 0.16, 0.09, 0.085, 0.09, 0.085]
    lefts = [MARGIN + INNER * sum(widths[:n]) for n in range(len(widths))]
    texts = [list(columns), *([text for text, _ in row["cells"]] for row in rows[:most])]
    for line, cells in enumerate(texts):
        for left, width, text in zip(lefts, widths, cells, strict=True):
            sheet.text(left, sheet.y + 12, text, size=12, bold=line == 0, room=INNER * width - 8)
        sheet.y += 19
    if len(rows) > most:
        sheet.text(MARGIN, sheet.y + 12, f"and {len(rows) - most} more", size=12, colour=MUTED)
        sheet.y += 19
    first = rows[0]
    name = f"{first['cells'][0][0]}, {first['stage']}: best so far"
    lines = [("best so far", first["numbers"], first["best"], BLUE, False)]
    sheet.chart(name, (MARGIN, sheet.y + 6, INNER, 180), lines, "candidate")
    sheet.y += 190
    return sheet


def _expected(sheet: Sheet, model: Mapping[str, Any]) -> None:
    """What a model expected of its proposals and what came, where one proposes."""
    if not model:
        return
    x = model["number"]
    lines = [
        ("measured (orange)", x, model["score"], ORANGE, True),
        ("predicted, with its 95 % interval (blue)", x, model["mean"], BLUE, False),
    ]
    intervals = list(zip(x, model["low"], model["high"], strict=True))
    place = (MARGIN, sheet.y + 6, INNER, 180)
    sheet.chart("What the model expects", place, lines, "candidate", intervals)
    sheet.y += 192 if x else 6
    sheet.text(MARGIN, sheet.y + 12, model["says"], size=12, room=INNER)
    sheet.y += 20


def _nothing(sheet: Sheet, words: str) -> Sheet:
    sheet.text(MARGIN, sheet.y + 12, words, colour=MUTED)
    sheet.y += 20
    return sheet
