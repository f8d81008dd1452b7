"""AnyNet on the CPU: the fast route against plain 3-D convolutions.

Everything but the 3-D convolutions is the same on both routes. The two take turns and the shortest time
of each counts, because on a busy machine only that repeats.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import torch

from sfkit.analysis.tables import markdown_lines
from sfkit.architectures.anynet import AnyNet, Route

DOCUMENT = "benchmarks/README.md"


@dataclass(frozen=True)
class RouteTimes:
    """Milliseconds of a whole forward pass of one height x width pair, propagation stage included."""

    height: int
    width: int
    threads: int
    plain_ms: float
    fast_ms: float

    @property
    def ratio(self) -> float:
        """How many times faster the fast route is."""
        return self.plain_ms / self.fast_ms


def measure(
    sizes: Sequence[tuple[int, int]] = ((256, 512), (384, 1248), (496, 752)),
    threads: Sequence[int] = (1, 2),
    repeats: int = 7,
) -> list[RouteTimes]:
    """Both routes at every size (height, width in pixels, multiples of 16) and number of threads.

    Weights and images are random: they do not change the time.
    """
    network = AnyNet().eval()
    before, records = torch.get_num_threads(), []
    for count in threads:
        torch.set_num_threads(count)
        for height, width in sizes:
            plain, fast = _times(network, height, width, repeats)
            records.append(RouteTimes(height, width, count, plain, fast))
    torch.set_num_threads(before)
    return records


def _times(network: AnyNet, height: int, width: int, repeats: int) -> tuple[float, float]:
    left, right = torch.rand(2, 1, 3, height, width, generator=torch.Generator().manual_seed(0))
    best = {route: float("inf") for route in Route}
    for _ in range(repeats + 1):  # the first pass prepares the kernels and is never the shortest
        for route in Route:
            network.use_route(route)
            start = time.perf_counter()
            with torch.inference_mode():
                network(left, right)
            best[route] = min(best[route], 1e3 * (time.perf_counter() - start))
    return best[Route.PLAIN], best[Route.FAST]


def section() -> str:
    """One row a size and number of threads."""
    columns = ("height x width", "threads", "plain Conv3d, ms", "fast route, ms", "ratio")
    rows = [
        (f"{r.height} x {r.width}", r.threads, f"{r.plain_ms:.1f}", f"{r.fast_ms:.1f}", f"{r.ratio:.2f}")
        for r in measure()
    ]
    return f"""## AnyNet, one disparity map on the CPU

Shortest of several passes that take turns; both routes give the same map.

{markdown_lines(columns, rows, [False, *[True] * 4])}"""
