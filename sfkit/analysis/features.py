"""What a block of any network puts out: hooks on the modules that the block partition names."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from sfkit.errors import InputError, ensure_known
from sfkit.merging.blocks import BlockPartition

Values = NDArray[np.float64]


def block_modules(network: nn.Module, partition: BlockPartition, block: str) -> dict[str, nn.Module]:
    """The outermost modules with a forward pass all of whose tensors lie in one block, by name.

    Raises:
        InputError: no such block, or no module lies in it as a whole.
    """
    ensure_known("block", block, partition.names)
    number = partition.names.index(block)
    found = dict(_outermost(network, "", partition, number))
    if not found:
        raise InputError(
            f"block {block!r}: found no module that lies in it as a whole, expected patterns over modules"
        )
    return found


def _outermost(
    module: nn.Module, prefix: str, partition: BlockPartition, block: int
) -> Iterator[tuple[str, nn.Module]]:
    inside = [partition.block_of(prefix + key) == block for key in module.state_dict()]
    # Containers such as ModuleList hold modules and are never called themselves.
    callable_ = type(module).forward is not nn.Module.forward
    if inside and all(inside) and callable_:
        yield prefix.removesuffix("."), module
    elif any(inside):
        for name, child in module.named_children():
            yield from _outermost(child, f"{prefix}{name}.", partition, block)


class BlockOutputs:
    """Listens to modules while a network runs, and keeps their outputs' moments; a context manager.

    Tensors of shape (N, L, C) have their channels in the last place. Maps are (N, C, H, W), or (N, H, W, C)
    as some transformers have them: of both, that whose H / W is nearer to the image's. A module that runs
    several times, such as once a view, counts each time alike.

    Args:
        modules: by name, from :func:`block_modules`.
        size: height and width of the network's input; without it maps are (N, C, H, W).
    """

    def __init__(self, modules: Mapping[str, nn.Module], size: tuple[int, int] | None = None) -> None:
        self._modules = dict(modules)
        self._size = size
        self._seen: dict[tuple[str, int, int], list[tuple[Values, Values]]] = {}
        self._handles: list[torch.utils.hooks.RemovableHandle] = []

    def __enter__(self) -> BlockOutputs:
        for name, module in self._modules.items():
            self._handles.append(module.register_forward_hook(self._listener(name)))
        return self

    def __exit__(self, *_: object) -> None:
        for handle in self._handles:
            handle.remove()
        self._handles.clear()

    def moments(self) -> tuple[Values, Values]:
        """Means of all channels, and of their squares, (C,) each, over positions and calls.

        Raises:
            InputError: no module put out a tensor.
        """
        if not self._seen:
            raise InputError(
                f"features: found no output of {', '.join(self._modules)}, expected modules that the network "
                "calls: choose another block"
            )
        # In one order, whichever module ran first.
        calls = [np.mean(self._seen[key], axis=0) for key in sorted(self._seen)]
        mean, square = np.concatenate(calls, axis=1)
        return mean, square

    def _listener(self, name: str) -> Any:
        def listen(_module: nn.Module, _inputs: Any, output: Any) -> None:
            for number, tensor in enumerate(_tensors(output)):
                last = tensor.movedim(1, -1) if self._channels_first(tensor) else tensor
                channels = last.shape[-1]
                # In double precision: sums over a map of many positions lose small channels otherwise.
                rows = last.reshape(-1, channels).double().cpu().numpy()
                moments = rows.mean(axis=0), np.square(rows).mean(axis=0)
                self._seen.setdefault((name, number, channels), []).append(moments)

        return listen

    def _channels_first(self, tensor: torch.Tensor) -> bool:
        # Without the images' shape four dimensions are (B, C, h, w).
        if tensor.ndim != 4 or self._size is None:
            return tensor.ndim == 4
        # By logarithms: twice too wide is as far off as twice too high.
        wanted = math.log(self._size[0] / self._size[1])
        first, last = (abs(math.log(tensor.shape[n] / tensor.shape[n + 1]) - wanted) for n in (2, 1))
        return first <= last


def _tensors(output: Any) -> Iterator[torch.Tensor]:
    if isinstance(output, torch.Tensor):
        # What has no positions has no moments over them.
        if output.is_floating_point() and output.ndim >= 3:
            yield output
    elif isinstance(output, Mapping):
        for value in output.values():
            yield from _tensors(value)
    elif isinstance(output, list | tuple):
        for value in output:
            yield from _tensors(value)
