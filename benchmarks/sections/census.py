"""Search without ground truth: how census ranks networks, and what both stages guided by it find."""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Sequence
from typing import Any

import census
import census_bank
import evidence_real
from processes import call, shown

from sfkit import bank
from sfkit.analysis.tables import markdown_lines

COMMAND = ("census.py", "--json")
GUIDED = ("census_guides.py", "--seeds", "2", "--json")
WORLDS = ("census_bank.py", "--seeds", "1", "--json")
SIGNED = ("census_signs.py", "--json")


def section() -> str:
    """The tables of both scripts."""
    rows = call(*COMMAND)
    parts = [HEAD, _real([row for row in rows if row["kind"] == "real"]), VARIANTS, _variants(rows)]
    parts += [TWICE, _two_passes(rows), GUIDES, _guides(call(*GUIDED))]
    parts += [BANK, worlds(call(*WORLDS)), SIGNS, _signs(call(*SIGNED))]
    return "\n\n".join(parts)


HEAD = f"""## Search without ground truth

`{shown(*COMMAND)}`: base and all 15 merges of the four real AnyNet sources, each pair alone, with the
propagation stage and without. `census` sees the two images and the prediction; the true error is bad-1.0
over all pixels with ground truth, which it never sees. The KITTI 2012 pair belongs to the sources'
training images."""
VARIANTS = f"""### What was tried

Rank correlation (Spearman) with the true error, and in brackets the regret: how much worse the picked
network is than the best there is, in points. Real pairs: the mean over five pairs, and the lowest
correlation of them. Frames: the same over SceneFlow (three frames), InStereo2K and TartanAir (one each).
The bank: 60 of its merges on 8 pairs a world, bad-3.0. Cost is CPU time against a forward pass of the
network on the same pairs, one thread. Smoothness adds {census.SMOOTHNESS:g} times the percentage of
neighbours more than {census.JUMP:g} px apart. Two scales are the definition: the fine one alone ranks the
real pairs a little better, and picks 5 points worse in haze. Occluded are pixels on which the disparities of
both views differ by more than 1 px; their rows cost a second pass, which is counted, and of the bank they are
measured on fewer networks and pairs, in a table of their own. Leaving occluded pixels out, or weighing them
less, lets a network choose the pixels it is judged by: on eth3d both pick a network about 4 points worse than
the best."""
TWICE = f"""{census.FEWER[0]} of the bank's networks on {census.FEWER[1]} pairs a world:"""
GUIDES = f"""### Both stages guided without labels

`{shown(*GUIDED)}`: bad-1.0 in percent on each pair, over all pixels with ground truth. The unlabelled
guide sees the images of all five pairs; of a labelled guide's own pairs the columns are validation
scores. Stage 1 with M = 8, T = 3, Stage 2 with 150 evaluations for every guide, two seeds. AdaMerging, 100
steps of gradient descent on the entropy of the matching, is the other guide without labels."""
BANK = f"""### The bank's worlds, each guided by its own pairs

`{shown(*WORLDS)}`: eight pairs of a world guide both stages (M = {census_bank.POPULATION},
T = {census_bank.GENERATIONS}, 80 evaluations) without their labels or with them, eight labelled ones of
{bank.VALIDATION} do instead, and AdaMerging descends on their entropy. bad-3.0 in percent on 16 further
pairs of that world, one seed."""

SIGNS = f"""### What a guide without labels might betray of itself

`{shown(*SIGNED)}`: the unlabelled searches above. Correlation: of census with the true error over the
networks that every pool has. Stability: rank correlation over halves of the pairs, of these networks and of
those the search compared. Kept: of the gain over the equal mixture of the best network on half of the pairs,
the share on the other half. Then the change of the network found against the equal mixture, in points of
census and of true error, on the guide's own pairs and on further ones."""


def _table(heads: Sequence[str], rows: Iterable[Sequence[object]], texts: int = 1) -> str:
    """The first columns are ``texts``; numbers stand right."""
    return markdown_lines(heads, rows, [False] * texts + [True] * (len(heads) - texts))


def _real(rows: Sequence[dict[str, Any]]) -> str:
    lines = []
    for row in rows:
        own = row["variants"][census.DEFAULT]
        numbers = (own["correlation"], own["picked"], row["best"], row["uniform"])
        stage = "with propagation" if row["spn"] else "without"
        lines.append((row["benchmark"], stage, *(f"{number:.2f}" for number in numbers)))
    return _table(("pair", "stage", "rank correlation", "its pick", "best", "uniform"), lines, 2)


def _variants(rows: Sequence[dict[str, Any]]) -> str:
    real = [row for row in rows if row["kind"] == "real"]
    groups = {"with": [r for r in real if r["spn"]], "without": [r for r in real if not r["spn"]]}
    worlds = [row for row in rows if row["kind"] == "bank"]
    groups["frames"] = [row for row in rows if row["kind"] == "frames"]
    heads = [
        "real, with",
        "real, without",
        "frames",
        *(row["benchmark"] for row in worlds),
        "cost on real",
        "on bank",
    ]
    lines = []
    for name in census.VARIANTS:
        cells = []
        for group in groups.values():
            found = [(row["variants"][name], row["best"]) for row in group]
            mean = statistics.fmean(v["correlation"] for v, _ in found)
            least = min(v["correlation"] for v, _ in found)
            regret = statistics.fmean(v["picked"] - best for v, best in found)
            cells.append(f"{mean:.2f}, {least:.2f} ({regret:.2f})")
        cells += [_cell(row, name) for row in worlds]
        for group in (real, worlds):
            costs = [row["variants"][name]["cost"] for row in group if name in row["variants"]]
            cells.append(f"{100 * statistics.fmean(costs):.0f} %" if costs else "")
        lines.append((name, *cells))
    return _table(("variant", *heads), lines)


def _cell(row: dict[str, Any], name: str) -> str:
    if name not in row["variants"]:
        return ""
    own = row["variants"][name]
    return f"{own['correlation']:.2f} ({own['picked'] - row['best']:.2f})"


def _two_passes(rows: Sequence[dict[str, Any]]) -> str:
    worlds = [row for row in rows if row["kind"] == "bank, two passes"]
    lines = []
    for name in (census.DEFAULT, *census.OCCLUDED):
        cost = statistics.fmean(row["variants"][name]["cost"] for row in worlds)
        lines.append((name, *(_cell(row, name) for row in worlds), f"{100 * cost:.0f} %"))
    return _table(("variant", *(row["benchmark"] for row in worlds), "cost"), lines)


def _guides(rows: Sequence[dict[str, Any]]) -> str:
    pairs = evidence_real.PAIRS
    lines = []
    for row in rows:
        errors = [row[pair] for pair in pairs]
        seed = row["seed"] if row["guide"] else ""
        cells = (f"{error:.2f}" for error in (*errors, statistics.fmean(errors)))
        lines.append((row["guide"], row["stage"], seed, *cells))
    return _table(("guide", "network", "seed", *pairs, "mean"), lines, 2)


def worlds(rows: Sequence[dict[str, Any]]) -> str:
    """What census_bank.py found: a column a world, then what is said of trust."""
    scored = [row for row in rows if "score" in row]
    places = list(dict.fromkeys(row["world"] for row in rows))
    found: dict[tuple[str, str, int], dict[str, float]] = {}
    for row in scored:
        found.setdefault((row["guide"], row["stage"], row["seed"]), {})[row["world"]] = row["score"]
    lines = [
        (guide, stage, *(f"{scores[world]:.2f}" for world in places))
        for (guide, stage, _), scores in found.items()
    ]
    said = [
        f"- {row['world']}, {row['stage'].partition(', ')[2]}: {row['sentence']}"
        for row in rows
        if "sentence" in row
    ]
    table = _table(("guide", "network", *places), lines, 2)
    return "\n".join([table, "", "What the trust sentence says of each world:", "", *said])


def _signs(rows: Sequence[dict[str, Any]]) -> str:
    heads = ["correlation", "stability", "of the searched", "kept"]
    heads += ["census, own pairs", "true error", "census, further pairs", "true error"]
    lines = []
    for row in rows:
        cells = [row[key] for key in ("correlation", "stability", "stability of the searched", "kept")]
        cells += [
            row["change"].get(f"{metric} on {where}")
            for where in ("its pairs", "further pairs")
            for metric in ("census", row["true"])
        ]
        told = ["" if cell is None else f"{cell:.2f}" for cell in cells[:4]]
        told += ["" if cell is None else f"{cell:+.2f}" for cell in cells[4:]]
        lines.append((row["guide"], *told))
    return _table(("guide", *heads), lines)
