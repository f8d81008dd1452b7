"""Block partitions: named groups of parameters, each given by patterns over state-dict keys."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase

from sfkit.checkpoints.fingerprints import text_digest
from sfkit.errors import InputError, unknown_name

OUTSIDE = -1  # the block number of a tensor that no pattern matches
WAYS = ("modules", "disagreement")
"""How :func:`~sfkit.merging.partitions.auto_partition` makes blocks."""
BLOCKS = 4
"""As many as the paper's architectures have."""


@dataclass(frozen=True)
class BlockPartition:
    """B named blocks in order; a key belongs to the first block one of whose globs matches it.

    The paper's blocks are backbone, neck, cost volume and head (section 4.4). A key outside every
    block follows the first block's routing weights with a module scale of 1.
    """

    names: tuple[str, ...]
    patterns: tuple[tuple[str, ...], ...]

    @classmethod
    def of(cls, blocks: Mapping[str, Sequence[str]]) -> BlockPartition:
        """From block name -> glob patterns.

        Raises:
            InputError: there is no block.
        """
        if not blocks:
            raise InputError("block partition: found no block, expected at least one, such as {'all': ['*']}")
        return cls(tuple(blocks), tuple(tuple(patterns) for patterns in blocks.values()))

    def block_of(self, key: str) -> int:
        """Number of the block ``key`` lies in, or ``OUTSIDE``."""
        # In order: a wider pattern further down takes what is left.
        for number, patterns in enumerate(self.patterns):
            if any(fnmatchcase(key, pattern) for pattern in patterns):
                return number
        return OUTSIDE

    def check(self, keys: Iterable[str]) -> None:
        """Refuse patterns that match nothing: most often a misspelt key.

        Raises:
            InputError: names the block and the pattern.
        """
        known = tuple(keys)
        for name, patterns in zip(self.names, self.patterns, strict=True):
            for pattern in patterns:
                if not any(fnmatchcase(key, pattern) for key in known):
                    raise InputError(
                        f"block {name!r}: the pattern {pattern!r} matches no parameter, expected a glob over "
                        f"keys such as {known[0] if known else 'none'!r}"
                    )

    def fingerprint(self) -> str:
        """Identity of the partition, for the keys of routed recipes."""
        return text_digest(json.dumps([list(self.names), [list(p) for p in self.patterns]]))


def parse_partition(text: str) -> tuple[str, int]:
    """``"modules"`` or ``"disagreement:6"`` as way and number of blocks.

    Raises:
        InputError: the text is neither.
    """
    way, colon, number = text.partition(":")
    if way not in WAYS:
        raise unknown_name("way to partition", way, WAYS)
    if colon and not (number.isdecimal() and int(number) >= 1):
        raise InputError(f"blocks: found {text!r}, expected a number of blocks after the colon, as {way}:4")
    return way, int(number) if colon else BLOCKS
