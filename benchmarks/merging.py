"""How near merging comes to the speed of memory: times as multiples of the limit, in one run.

    python benchmarks/merging.py [--elements 50000000] [--threads 1 2] [--json]

The limit of a merge is the bytes that must move (E task vectors and the base read, the result written)
over the machine's triad bandwidth, which is measured in the same run on arrays far larger than the last
cache. TIES is measured at 50 M elements, against the limit of a linear merge: one lambda needs a threshold
for each source and the election, each further one is a merge of the elected vector, and another electing rule
finds the thresholds it had. mergekit takes part where it is installed (``make bench``).
"""

from __future__ import annotations

import importlib.util
import time
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import torch
from pictures import bars, picture
from processes import answered, call, shown
from tabulated import numbers

from sfkit.checkpoints.checks import Kind, TensorSpec
from sfkit.merging.blocks import BlockPartition
from sfkit.merging.flat import FlatLayout
from sfkit.merging.fusion import fuse
from sfkit.merging.linear import merge_flat, weighted_sum
from sfkit.merging.recipe import Recipe
from sfkit.merging.sparsity import Piece, Row, Thresholds, thinned
from sfkit.merging.steps import Elect, Trim

DOCUMENT = "benchmarks/README.md"

SOURCES, TENSORS, BLOCKS = 11, 400, 12
TIES_ELEMENTS, DENSITY = 50_000_000, 0.2
MERGEKIT = importlib.util.find_spec("mergekit") is not None
AIM = 1.15

Work = Callable[[], object]
Cases = dict[str, dict[str, float]]
"""Variant -> size and threads -> figure."""


def best_of(work: Work, repeats: int = 5) -> float:
    """The shortest of several runs, in seconds; the first one warms up and does not count."""
    work()
    times = []
    for _ in range(repeats):
        started = time.perf_counter()
        work()
        times.append(time.perf_counter() - started)
    return min(times)


def bandwidth(elements: int) -> tuple[float, float]:
    """Copy and triad bandwidth in bytes a second, on arrays of ``elements`` float32 each."""
    a, b, c = (torch.full((elements,), float(i)) for i in range(3))
    copy = best_of(lambda: a.copy_(b))
    triad = best_of(lambda: torch.add(b, c, alpha=0.5, out=a))
    return 2 * 4 * elements / copy, 3 * 4 * elements / triad


class RandomPool:
    """A layout of 400 tensors in 12 blocks, a base and 11 task vectors of random numbers."""

    def __init__(self, elements: int) -> None:
        shape = (elements // TENSORS,)
        specs = [TensorSpec(f"b{i % BLOCKS}.{i:03d}.weight", shape, Kind.WEIGHT) for i in range(TENSORS)]
        self.partition = BlockPartition.of({f"b{b}": [f"b{b}.*"] for b in range(BLOCKS)})
        self.layout = FlatLayout.of(specs, self.partition)
        generator = torch.Generator().manual_seed(0)
        self.base = torch.randn(self.layout.size, generator=generator)
        self.rows = torch.randn(SOURCES, self.layout.size, generator=generator)
        self.vectors = list(self.rows)
        self.names = tuple(f"s{e}" for e in range(SOURCES))
        self.out = torch.empty(self.layout.size)

    def equal(self, count: int) -> Recipe:
        """Equal weights over the first ``count`` sources."""
        weights = {name: 1 / count if e < count else 0.0 for e, name in enumerate(self.names)}
        return Recipe.weighted(weights, self.partition.names)

    def routed(self, seed: int) -> Recipe:
        """Weights and scales of their own for every block."""
        generator = torch.Generator().manual_seed(seed)
        rows = torch.softmax(torch.randn(BLOCKS, SOURCES, generator=generator), dim=1).tolist()
        scales = (0.25 + 1.5 * torch.rand(BLOCKS, generator=generator)).tolist()
        return Recipe(self.names, self.partition.names, tuple(map(tuple, rows)), tuple(scales))

    def merge(self, recipe: Recipe) -> torch.Tensor:
        """Ours, into the buffer the live network's parameters are views of."""
        merge_flat(recipe, self.layout, self.base, self.vectors, self.out)
        return self.out


def measure(
    elements: tuple[int, ...] = (50_000_000, 100_000_000), threads: tuple[int, ...] = (1, 2)
) -> dict[str, Any]:
    """``bandwidth`` by number of threads, and ``rows``: every variant at each size and number of threads."""
    bandwidths, rows = [], list[dict[str, Any]]()
    for count in threads:
        torch.set_num_threads(count)
        copy, triad = bandwidth(1 << 27)
        bandwidths.append({"threads": count, "copy": copy, "triad": triad})
        works = [(linear, size) for size in elements]
        works += [(ties, TIES_ELEMENTS)] if TIES_ELEMENTS in elements else []
        for kind, size in works:
            world = RandomPool(size)
            _, triad = bandwidth(max(size, 1 << 26))
            for name, seconds, vectors in kind(world):
                # What must move: the vectors and the base read, the result written.
                limit = 4 * world.layout.size * (vectors + 2) / triad
                times = {"milliseconds": 1e3 * seconds, "limit_milliseconds": 1e3 * limit}
                about = {"name": name, "elements": world.layout.size, "threads": count}
                rows.append({**about, **times, "ratio": seconds / limit})
    return {"bandwidth": bandwidths, "rows": rows}


def linear(world: RandomPool) -> Iterator[tuple[str, float, float]]:
    """Variants of a weighted sum: name, seconds, and how many vectors must be read."""
    check(world)
    full, few = world.equal(SOURCES), world.equal(3)
    yield "ours, 11 sources", best_of(lambda: world.merge(full)), SOURCES
    yield "ours, 12 blocks routed", best_of(lambda: world.merge(world.routed(0))), SOURCES
    yield "ours, 3 of 11 sources", best_of(lambda: world.merge(few)), 3
    # What task vectors in one buffer would allow, by one call of BLAS: no pool holds them so.
    weights = torch.full((1, SOURCES), 1 / SOURCES)
    target, base = world.out.unsqueeze(0), world.base.unsqueeze(0)
    one_call = best_of(lambda: torch.addmm(base, weights, world.rows, out=target))
    yield "one buffer, one call", one_call, SOURCES
    yield "naive dict of tensors", best_of(lambda: naive(world), 3), SOURCES
    yield "in-place add_", best_of(lambda: in_place(world), 3), SOURCES
    halves = [vector.bfloat16() for vector in world.vectors]
    ours = best_of(lambda: merge_flat(full, world.layout, world.base, halves, world.out), 3)
    yield "ours, bf16 task vectors", ours, SOURCES / 2
    halves.clear()
    if MERGEKIT:
        for method in ("linear", "task_arithmetic"):
            yield f"mergekit {method}", best_of(mergekit_work(world, method), 3), SOURCES


def check(world: RandomPool) -> None:
    """Ours equals the sum written plainly, and the network's parameters are views of the buffer."""
    recipe = world.routed(3)
    out = world.merge(recipe)
    if any(view.data_ptr() < out.data_ptr() for view in world.layout.views(out).values()):
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


def ties(world: RandomPool) -> Iterator[tuple[str, float, float]]:
    """As :func:`linear`: one lambda, one more, and another election with the thresholds known."""
    size = world.layout.size
    vector = torch.empty(size)

    def once() -> None:
        elected(world, Thresholds(), vector)
        weighted_sum(world.base, [(vector, 1.0)], world.out, 0, size)

    yield "TIES, one lambda", best_of(once, 2), SOURCES
    check_elected(world, vector)
    further = best_of(lambda: weighted_sum(world.base, [(vector, 0.8)], world.out, 0, size))
    yield "TIES, each further lambda", further, SOURCES
    known = Thresholds()
    elected(world, known, vector)
    yield "TIES, thresholds known", best_of(lambda: elected(world, known, vector), 2), SOURCES
    if MERGEKIT:
        work = mergekit_work(world, "ties")
        started = time.perf_counter()
        work()  # once: at full size it takes a minute
        yield "mergekit ties", time.perf_counter() - started, SOURCES


def elected(world: RandomPool, known: Thresholds, out: torch.Tensor) -> None:
    """The task vector that TIES makes of all sources."""
    step = Trim(DENSITY)
    read = [Row(n, partial(_part, v)) for n, v in zip(world.names, world.vectors, strict=True)]
    known.find(read, step, world.layout)
    rows = [thinned(row, step, world.layout, f"{row.fingerprint} trimmed", known) for row in read]
    fuse(Elect(), rows, world.layout, out)


def _part(vector: torch.Tensor, piece: Piece) -> torch.Tensor:
    return vector[piece.start : piece.stop]


def check_elected(world: RandomPool, found: torch.Tensor) -> None:
    """The elected vector is that of the formula, on the first tensor."""
    part, size = slice(0, world.layout.entries[0][0].size), world.layout.size
    smallest = (torch.topk(v.abs(), int(DENSITY * size)).values[-1] for v in world.vectors)
    kept = [
        torch.where(v[part].abs() >= s, v[part], 0.0) for v, s in zip(world.vectors, smallest, strict=True)
    ]
    stack = torch.stack(kept).double()
    agree = stack.sign() == stack.sum(dim=0).sign()
    expected = (stack * agree).sum(dim=0) / (agree & (stack != 0)).sum(dim=0).clamp(min=1)
    if not torch.allclose(found[part].double(), expected, atol=1e-5):
        raise SystemExit("the elected task vector is not that of the formula")


def mergekit_work(world: RandomPool, method: str) -> Work:
    """A merge of all sources by mergekit, ready to be timed; an equal-weight one is checked once.

    ``linear`` adds the base and the weighted task vectors, which is our sum. The others take the
    difference from the base themselves: what they are given as models are the same buffers, so that no more
    has to lie in memory; with weights that sum to one the base cancels. ``ties`` trims each tensor by itself.

    Raises:
        SystemExit: mergekit's result is not that sum.
    """
    from mergekit.merge_methods.api import merge_state_dicts

    base, weight = world.layout.views(world.base), 1.0 if method == "ties" else 1 / SOURCES
    models: dict[str, Any] = {
        name: world.layout.views(vector) for name, vector in zip(world.names, world.vectors, strict=True)
    }
    weights: dict[str, float] = dict.fromkeys(models, weight) | ({"base": 1.0} if method == "linear" else {})
    more = {"density": dict.fromkeys(models, DENSITY)} if method == "ties" else {"normalize": False}
    options: dict[str, Any] = {"weight": weights, **more}

    def work() -> dict[str, torch.Tensor]:
        with torch.inference_mode():
            given = {"base": base, **models}
            return merge_state_dicts(
                given, method, parameters=options, base=None if method == "linear" else "base"
            )

    for key, found in () if method == "ties" else list(work().items())[::37]:
        expected = sum(weight * model[key].double() for model in models.values())
        expected = expected + base[key].double() if method == "linear" else expected
        if not torch.allclose(found.double(), expected, atol=1e-5):
            raise SystemExit(f"mergekit {method}: {key} is not the sum it was asked for")
    return work


COMMAND = ("merging.py", "--json")


def section() -> str:
    """One row a variant; ratios at each size and number of threads."""
    found = call(*COMMAND)
    ratios = _by_case(found["rows"], "ratio")
    of_ties = {name: ratios.pop(name) for name in list(ratios) if "ties" in name.lower()}
    low, high = (end(ratios["ours, 11 sources"].values()) for end in (min, max))
    figure = bars(
        ratios,
        title="How many times the memory limit does a merge take?",
        subtitle=f"11 sources, 400 tensors: ours takes {low:.2f} to {high:.2f} times",
        x="time / (bytes that must move / triad bandwidth)",
    )
    bandwidths = "; ".join(
        f"{_threads(b)}: copy {b['copy'] / 1e9:.1f} GB/s, triad {b['triad'] / 1e9:.1f} GB/s"
        for b in found["bandwidth"]
    )
    return f"""## Merging at the speed of memory

`{shown(*COMMAND)}`: float32, 400 tensors in 12 blocks, 11 sources; time as a multiple of the
limit, the bytes that must move over the triad bandwidth of the same run on arrays larger than
the last cache. {bandwidths}. Every result is checked, and that parameters are views of the
merged buffer.

{picture(figure, "merging", "Time of merges as multiples of the memory limit")}

{_table(ratios)}

The aim of {AIM} times the limit is {"met" if high <= AIM else "not met"}. {_beside(found["rows"])}

TIES at 50 M elements, against the limit of a linear merge (aims: 15 for one lambda, 2 for each further one):

{_table(of_ties)}"""


def _threads(row: dict[str, Any]) -> str:
    return f"{row['threads']} thread{'s' * (row['threads'] > 1)}"


def _by_case(rows: list[dict[str, Any]], figure: str) -> Cases:
    found: Cases = {}
    for row in rows:
        found.setdefault(row["name"], {})[f"{row['elements'] / 1e6:.0f} M, {_threads(row)}"] = row[figure]
    return found


def _table(figures: Cases) -> str:
    heads = list(next(iter(figures.values())))
    return numbers(
        ("variant", *heads), [(name, *(f"{row[h]:.2f}" for h in heads)) for name, row in figures.items()]
    )


def _beside(rows: list[dict[str, Any]]) -> str:
    """How many times faster than mergekit, where that was measured."""
    milliseconds, sentences = _by_case(rows, "milliseconds"), []
    for name, aim in (("mergekit linear", 2.5), ("mergekit task_arithmetic", 5.0)):
        if name in milliseconds:
            ours = milliseconds["ours, 11 sources"]
            times = [theirs / ours[case] for case, theirs in milliseconds[name].items()]
            sentences.append(f"{name} takes {min(times):.1f} to {max(times):.1f} times as long (aim {aim}).")
    return " ".join(sentences)


if __name__ == "__main__":
    answered(measure)
