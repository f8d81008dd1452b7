"""Blocks from what a network consists of: its top-level modules, or those of a list that it has."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any

from torch import nn

Blocks = Mapping[str, Sequence[str]]


@dataclass(frozen=True)
class ByNetwork:
    """Blocks that only the network itself tells: whoever has built it asks, and nobody builds another.

    Attributes:
        tell: network, options -> block name -> glob patterns over state-dict keys.
    """

    tell: Callable[[nn.Module, Mapping[str, Any]], Blocks]

    @classmethod
    def fitting(cls, blocks: Blocks) -> ByNetwork:
        """These, without what a variant of the network does not have."""
        return cls(lambda network, _options: fitting_blocks(network, blocks))


def by_options(
    blocks: Blocks | Callable[[Mapping[str, Any]], Blocks] | ByNetwork, build: Callable[..., nn.Module]
) -> Callable[[Mapping[str, Any]], Blocks]:
    """Options -> blocks, whichever way they were given."""
    if isinstance(blocks, ByNetwork):
        return lambda options: blocks.tell(build(**options), options)
    return blocks if callable(blocks) else lambda _options: blocks


def top_level_blocks(network: nn.Module) -> dict[str, list[str]]:
    """A block for each module that the network itself names and that has parameters."""
    children = {
        n: [f"{n}.*"] for n, child in network.named_children() if any(True for _ in child.parameters())
    }
    return children or {"all": ["*"]}


def fitting_blocks(network: nn.Module, blocks: Blocks) -> dict[str, list[str]]:
    """The blocks without patterns that match no parameter: a variant of a network may lack a part."""
    keys = [key for key, _ in network.named_parameters()]
    fitting = {
        name: [glob for glob in globs if any(fnmatchcase(key, glob) for key in keys)]
        for name, globs in blocks.items()
    }
    return {name: globs for name, globs in fitting.items() if globs}
