"""Blocks from what a network consists of: its top-level modules, or those of a list that it has."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from fnmatch import fnmatchcase

from torch import nn


def top_level_blocks(network: nn.Module) -> dict[str, list[str]]:
    """A block for each module that the network itself names and that has parameters."""
    children = {
        n: [f"{n}.*"] for n, child in network.named_children() if any(True for _ in child.parameters())
    }
    return children or {"all": ["*"]}


def fitting_blocks(network: nn.Module, blocks: Mapping[str, Sequence[str]]) -> dict[str, list[str]]:
    """The blocks without patterns that match no parameter: a variant of a network may lack a part."""
    keys = [key for key, _ in network.named_parameters()]
    fitting = {
        name: [glob for glob in globs if any(fnmatchcase(key, glob) for key in keys)]
        for name, globs in blocks.items()
    }
    return {name: globs for name, globs in fitting.items() if globs}
