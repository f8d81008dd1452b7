"""How near merging comes to the speed of memory: times as multiples of the limit, in one run.

    python benchmarks/merging.py [--elements 50000000] [--threads 1 2] [--json]

The limit of a merge is the bytes that must move (E task vectors and the base read, the result written)
over the machine's triad bandwidth, which is measured in the same run on arrays far larger than the last
cache. TIES (``ties.py``) is measured at 50 M elements, against the limit of a linear merge. Peers (mergekit)
are measured where they are installed: ``make bench`` puts them into an environment of their own.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Sequence
from dataclasses import asdict
from typing import Any

import torch
from memory import SOURCES, MergeTime, RandomPool, bandwidth, best_of
from pictures import bars, picture
from processes import call, shown
from stages import answered
from ties import measure as measure_ties

from sfkit.analysis.tables import markdown_lines
from sfkit.merging.linear import merge_flat

DOCUMENT = "benchmarks/README.md"

TIES_ELEMENTS = 50_000_000
TIES_DENSITY = 0.2


def measure(elements: int, threads: int) -> list[MergeTime]:
    """All variants at one size and thread count, each checked against a plain sum."""
    torch.set_num_threads(threads)
    world = RandomPool(elements)
    _, triad = bandwidth(max(elements, 1 << 26))
    size = world.layout.size
    records = []

    def record(name: str, seconds: float, vectors: float) -> None:
        # What must move: the vectors and the base read, the result written.
        limit = 4 * size * (vectors + 2) / triad
        records.append(MergeTime(name, size, threads, 1e3 * seconds, 1e3 * limit))

    check(world)
    full, few = world.equal(SOURCES), world.equal(3)
    record("ours, 11 sources", best_of(lambda: world.merge(full)), SOURCES)
    record("ours, 12 blocks routed", best_of(lambda: world.merge(world.routed(0))), SOURCES)
    record("ours, 3 of 11 sources", best_of(lambda: world.merge(few)), 3)
    # What task vectors in one buffer would allow, by one call of BLAS: no pool holds them so.
    weights = torch.full((1, SOURCES), 1 / SOURCES)
    target, base = world.out.unsqueeze(0), world.base.unsqueeze(0)
    one_call = best_of(lambda: torch.addmm(base, weights, world.rows, out=target))
    record("one buffer, one call", one_call, SOURCES)
    record("naive dict of tensors", best_of(lambda: naive(world), 3), SOURCES)
    record("in-place add_", best_of(lambda: in_place(world), 3), SOURCES)
    halves = [vector.bfloat16() for vector in world.vectors]
    record(
        "ours, bf16 task vectors",
        best_of(lambda: merge_flat(full, world.layout, world.base, halves, world.out), 3),
        SOURCES / 2,
    )
    halves = []
    if importlib.util.find_spec("mergekit"):
        from peers import METHODS, mergekit_work

        for method in METHODS:
            record(f"mergekit {method}", best_of(mergekit_work(world, method), 3), SOURCES)
    return records


def check(world: RandomPool) -> None:
    """Ours equals the sum written plainly, and the network's parameters are views of the buffer."""
    recipe = world.routed(3)
    out = world.merge(recipe)
    views = world.layout.views(out)
    if any(view.data_ptr() < out.data_ptr() for view in views.values()):
        raise SystemExit("a parameter is no view of the buffer")
    for spec, offset in world.layout.entries[::37]:
        part, block = slice(offset, offset + spec.size), world.partition.block_of(spec.key)
        row, scale = recipe.weights[block], recipe.scales[block]
        moved = sum(w * v[part].double() for w, v in zip(row, world.vectors, strict=True))
        if not torch.allclose(out[part].double(), world.base[part].double() + scale * moved, atol=1e-5):
            raise SystemExit(f"{spec.key}: our merge differs from the plain sum")


def naive(world: RandomPool) -> dict[str, torch.Tensor]:
    """What a first version does: a dictionary of new tensors."""
    views = [world.layout.views(vector) for vector in world.vectors]
    base = world.layout.views(world.base)
    return {key: base[key] + sum(view[key] for view in views) / SOURCES for key in base}


def in_place(world: RandomPool) -> torch.Tensor:
    """Whole vectors added one after the other: the result passes through memory 11 times."""
    world.out.copy_(world.base)
    for vector in world.vectors:
        world.out.add_(vector, alpha=1 / SOURCES)
    return world.out


def rows(elements: Sequence[int], threads: Sequence[int]) -> dict[str, Any]:
    """The bandwidths and all records, at every size and number of threads."""
    found, bandwidths = [], []
    for count in threads:
        torch.set_num_threads(count)
        copy, triad = bandwidth(1 << 27)
        bandwidths.append({"threads": count, "copy": copy, "triad": triad})
        for size in elements:
            found += measure(size, count)
        if TIES_ELEMENTS in elements:
            found += measure_ties(TIES_ELEMENTS, count, TIES_DENSITY)
    return {"bandwidth": bandwidths, "rows": [{**asdict(row), "ratio": row.ratio} for row in found]}


COMMAND = ("merging.py", "--json")
AIM = 1.15


def section() -> str:
    """One row a variant; ratios at each size and number of threads."""
    found = call(*COMMAND)
    ties = [row for row in found["rows"] if "ties" in row["name"].lower()]
    rows = [row for row in found["rows"] if row not in ties]
    ratios = _by_case(rows, "ratio")
    milliseconds = _by_case(rows, "milliseconds")
    ours = ratios["ours, 11 sources"]
    low, high = min(ours.values()), max(ours.values())
    figure = bars(
        ratios,
        title="How many times the memory limit does a merge take?",
        subtitle=f"11 sources, 400 tensors: ours takes {low:.2f} to {high:.2f} times",
        x="time / (bytes that must move / triad bandwidth)",
    )
    bandwidths = "; ".join(
        f"{b['threads']} thread{'s' * (b['threads'] > 1)}: copy {b['copy'] / 1e9:.1f} GB/s, "
        f"triad {b['triad'] / 1e9:.1f} GB/s"
        for b in found["bandwidth"]
    )
    met = "met" if high <= AIM else "not met"
    return "\n".join(
        [
            "## Merging at the speed of memory",
            "",
            f"`{shown(*COMMAND)}`: float32, 400 tensors in 12 blocks, 11 sources; time as a multiple of the "
            "limit, the bytes that must move over the triad bandwidth of the same run on arrays larger than "
            f"the last cache. {bandwidths}. Every result is checked, and that parameters are views of the "
            "merged buffer.",
            "",
            picture(figure, "merging", "Time of merges as multiples of the memory limit"),
            "",
            _table(ratios),
            "",
            f"The aim of {AIM} times the limit is {met}. {_beside(milliseconds)}",
            "",
            "TIES at 50 M elements, against the limit of a linear merge (aims: 15 for one lambda, 2 for each "
            "further one):",
            "",
            _table(_by_case(ties, "ratio")),
        ]
    )


Cases = dict[str, dict[str, float]]
"""Variant -> size and threads -> figure."""


def _by_case(rows: list[dict[str, Any]], figure: str) -> Cases:
    found: Cases = {}
    for row in rows:
        threads = f"{row['threads']} thread{'s' * (row['threads'] > 1)}"
        found.setdefault(row["name"], {})[f"{row['elements'] / 1e6:.0f} M, {threads}"] = row[figure]
    return found


def _table(figures: Cases) -> str:
    heads = list(next(iter(figures.values())))
    rows = [(name, *(f"{row[h]:.2f}" for h in heads)) for name, row in figures.items()]
    return markdown_lines(("variant", *heads), rows, [False, *[True] * len(heads)])


def _beside(milliseconds: Cases) -> str:
    """How many times faster than mergekit, where that was measured."""
    ours, sentences = milliseconds["ours, 11 sources"], []
    for name, aim in (("mergekit linear", 2.5), ("mergekit task_arithmetic", 5.0)):
        if name in milliseconds:
            times = [theirs / ours[case] for case, theirs in milliseconds[name].items()]
            sentences.append(f"{name} takes {min(times):.1f} to {max(times):.1f} times as long (aim {aim}).")
    return " ".join(sentences)


if __name__ == "__main__":
    answered(__doc__, rows, {"elements": (50_000_000, 100_000_000), "threads": (1, 2)})
