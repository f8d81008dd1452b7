"""Models of a fetched OpenStereo checkout, from opening to a tiny search."""

from __future__ import annotations

import importlib
from collections.abc import Iterable
from typing import Any

from processes import call, shown

from sfkit.analysis.tables import markdown_lines


def section() -> str:
    """One row a model, each measured in a process of its own."""
    cases = importlib.import_module("openstereo").CASES
    lines = [
        "## Networks of an OpenStereo checkout",
        "",
        f"`{shown('openstereo.py', 'MODEL')}` with `SFKIT_OPENSTEREO` naming a checkout of",
        "XiandaGuo/OpenStereo (May 2026), whose code runs as it stands, and timm 1.0. Base and two sources",
        "have random weights, in files as its trainer writes them; the pair is a part of Middlebury's Cones",
        "of the size that the table names. So this says that each step runs and what it takes, not how well",
        "such networks merge. CPU seconds of one thread, opening with everything imported; the search is",
        "Stage 1 over the one subset of two sources, which was scored before, and three mixtures more in "
        "Stage 2.",
        "",
        rows(call("openstereo.py", name, "--json") for name in cases),
    ]
    return "\n".join(lines)


def rows(results: Iterable[dict[str, Any]]) -> str:
    """What ``walk`` of ``benchmarks/openstereo.py`` found, a network a row."""
    steps = {"open": "open", "merge": "merge, write", "evaluate": "one evaluation", "search": "search"}
    cells = []
    for r in results:
        first = (r["name"], f"{r['parameters']:,}", "{} x {}".format(*r["size"]), ", ".join(r["blocks"]))
        cells.append((*first, *(f"{r[step]} s" for step in steps), f"{r['peak_memory_mb']:,}"))
    heads = ("model", "parameters", "size", "blocks", *steps.values(), "peak MB")
    return markdown_lines(heads, cells, [False, True, True, False, *[True] * 5])
