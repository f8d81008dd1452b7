"""Merging on a device other than the CPU: task vectors live there while they fit, and pass by where not.

Both ways run the same operations on the same chunks, so that which of the two a machine has room for
changes no bit. What is here has run on the CPU and the meta device only, on no GPU yet.
"""

from __future__ import annotations

from collections.abc import Iterator

import torch

from sfkit.merging.flat import FlatLayout, Segment
from sfkit.merging.linear import CHUNK, merge_flat
from sfkit.merging.recipe import Recipe
from sfkit.merging.vectors import TaskVectors

SHARE = 4  # task vectors may take 1/SHARE of the free device memory: activations need the rest
# Elements sent at a time where they do not fit, 4 MiB of each task vector: a multiple of the chunk that
# merge_flat works in, so that chunks end at the same elements as in the resident buffers.
WINDOW = 4 * CHUNK


class DeviceMerger:
    """Writes merged parameters into buffers on one device.

    Args:
        vectors: base and task vectors, wherever they lie.
        device: where the output lies.
        budget: bytes that base and task vectors may take on the device together; a quarter of what is
            free there unless given, and no limit on a device that cannot tell.

    Attributes:
        resident: True where base and all task vectors are kept on the device; else each merge sends
            those it needs, window by window.
    """

    def __init__(self, vectors: TaskVectors, device: torch.device, *, budget: int | None = None) -> None:
        self.vectors, self.device = vectors, device
        size = vectors.layout.size
        # A device that cannot tell what is free is taken to have room.
        room = free_bytes(device) if budget is None else budget
        # The base is one more.
        self.resident = room is None or (len(vectors.by_source) + 1) * size * 4 <= room
        if self.resident:
            self._base = vectors.base.to(device)
            self._vectors = {name: vector.to(device) for name, vector in vectors.by_source.items()}
        else:
            width = min(WINDOW, size)
            self._base = torch.empty(width, dtype=torch.float32, device=device)
            self._vectors = {name: torch.empty_like(self._base) for name in vectors.by_source}

    def merge_into(self, ordered: Recipe, out: torch.Tensor) -> torch.Tensor:
        """Write the merged flat parameters into ``out`` (P,) on the device, and return it.

        Args:
            ordered: a recipe over the sources of ``vectors``, which are added in its order.
            out: overwritten.
        """
        if self.resident:
            vectors = [self._vectors[name] for name in ordered.sources]
            merge_flat(ordered, self.vectors.layout, self._base, vectors, out)
        else:
            for window in windows(self.vectors.layout):
                self._merge_window(ordered, window, out)
        return self.vectors.rounded(out)

    def _merge_window(self, ordered: Recipe, window: Segment, out: torch.Tensor) -> None:
        part = slice(window.start, window.stop)
        width = window.stop - window.start
        base = self._base[:width].copy_(self.vectors.base[part])
        vectors = []
        for e, name in enumerate(ordered.sources):
            stage = self._vectors[name][:width]
            if any(row[e] for row in ordered.weights):  # merge_flat reads no source without a weight
                stage.copy_(self.vectors.by_source[name][part])
            vectors.append(stage)
        # One segment that begins at 0: the window is merged as if it were all there is.
        alone = FlatLayout((), (Segment(window.block, window.kind, 0, width),), width)
        merge_flat(ordered, alone, base, vectors, out[part])


def windows(layout: FlatLayout) -> Iterator[Segment]:
    """The layout's segments cut into pieces of at most ``WINDOW`` elements."""
    for segment in layout.segments:
        for start in range(segment.start, segment.stop, WINDOW):
            yield Segment(segment.block, segment.kind, start, min(start + WINDOW, segment.stop))


def free_bytes(device: torch.device) -> int | None:
    """Bytes that task vectors may take on a device; None where it cannot tell what is free."""
    if device.type != "cuda":
        return None
    free: int = torch.cuda.mem_get_info(device)[0]
    return free // SHARE
