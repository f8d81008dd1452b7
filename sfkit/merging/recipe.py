"""Recipes: what to merge, in which proportion, how strongly, block by block.

A recipe says theta_b = base_b + gamma_b * sum_e pi[b, e] * tau_e,b (StereoFactory, eq. 12). It names
sources and blocks and holds numbers, no tensors, so that searches can propose one, the evaluation
store can key it, and a merged file can carry it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from sfkit.cards import card
from sfkit.errors import InputError, ensure_known
from sfkit.merging.steps import Step, as_dicts, from_dicts
from sfkit.outside import number, parse_json, table
from sfkit.outside import text as read_text_value

_KEYS = frozenset(("format", "preparation", "networks", "sources", "blocks", "weights", "scales"))
FORMAT = "sfkit-recipe/1"
PREPARED = "sfkit-recipe/2"
"""With a preparation: a reader that does not know of them refuses it."""


@dataclass(frozen=True)
class Recipe:
    """Routing weights pi[b, e] and module scales gamma[b] over named sources and blocks.

    Attributes:
        sources: the E names of the subset; their order never matters for the merge.
        blocks: the B block names, in the partition's order. Parameters outside every block follow
            the first block's weights with a scale of 1.
        weights: B rows of E non-negative weights. Rows of a routed recipe sum to 1; a weighted merge
            such as task arithmetic may have another sum.
        scales: B module scales; they act on parameters, never on running statistics.
        preparation: the steps that made the sources' task vectors out of those the pool was read with. A
            prepared pool's own recipes may leave it out; :meth:`~sfkit.merging.pool.Pool.signed` adds it.
        merged_from: fingerprints by member (``base`` and sources) of the networks it was made with, which a
            pool must have to rebuild it; ``networks`` in its JSON. None of a recipe that nobody bound to any
            (:meth:`~sfkit.merging.pool.Pool.bound`).
    """

    sources: tuple[str, ...]
    blocks: tuple[str, ...]
    weights: tuple[tuple[float, ...], ...]
    scales: tuple[float, ...]
    preparation: tuple[Step, ...] = ()
    # Not compared: bound or not it is one candidate to a search, and keys name the networks themselves.
    merged_from: Mapping[str, str] | None = field(default=None, compare=False, repr=False)

    def __post_init__(self) -> None:
        if len(set(self.sources)) != len(self.sources):
            raise InputError(f"recipe: sources {list(self.sources)} name one twice, expected each once")
        if not self.blocks or len(set(self.blocks)) != len(self.blocks):
            raise InputError(f"recipe: blocks {list(self.blocks)}, expected at least one and each once")
        if len(self.weights) != len(self.blocks) or any(len(r) != len(self.sources) for r in self.weights):
            shape = [len(row) for row in self.weights]
            raise InputError(
                f"recipe: weights have rows of lengths {shape}, expected {len(self.blocks)} rows "
                f"(blocks) of {len(self.sources)} (sources)"
            )
        if len(self.scales) != len(self.blocks):
            raise InputError(
                f"recipe: {len(self.scales)} scales, expected one for each of {len(self.blocks)} blocks"
            )
        # A NaN would pass every comparison that says what is wrong: what is allowed is asked for.
        for value in (*self.scales, *(w for row in self.weights for w in row)):
            if not math.isfinite(value) or value < 0:
                raise InputError(f"recipe: found the value {value}, expected finite numbers of at least 0")

    @classmethod
    def equal(cls, sources: Iterable[str], blocks: Iterable[str]) -> Recipe:
        """The equal-weight merge of a subset (StereoFactory, eq. 4): 1/k each, all scales 1."""
        names = tuple(sources)
        if not names:
            return cls.base(blocks)
        return cls.weighted(dict.fromkeys(names, 1.0 / len(names)), blocks)

    @classmethod
    def base(cls, blocks: Iterable[str]) -> Recipe:
        """The base itself: no source takes part."""
        return cls.weighted({}, blocks)

    @classmethod
    def weighted(cls, weights: Mapping[str, float], blocks: Iterable[str], *, scale: float = 1.0) -> Recipe:
        """One weight a source, the same in every block, times one scale."""
        names = tuple(blocks)
        row = tuple(float(w) for w in weights.values())
        return cls(tuple(weights), names, (row,) * len(names), (float(scale),) * len(names))

    def _repr_html_(self) -> str:
        if not self.sources:
            return card("Recipe", {"sources": "none: the base itself"})
        rows = [
            (block, *(f"{weight:.2f}" for weight in row), f"× {scale:.2f}")
            for block, row, scale in zip(self.blocks, self.weights, self.scales, strict=True)
        ]
        if self.tied and len(set(self.scales)) == 1:
            rows = [("all blocks", *rows[0][1:])]
        steps = ", ".join(type(step).__name__.lower() for step in self.preparation)
        columns = ("block", *self.sources, "scale")
        return card("Recipe", {"preparation": steps}, columns=columns, rows=rows)

    @property
    def tied(self) -> bool:
        """True where all blocks share one row of weights."""
        return all(row == self.weights[0] for row in self.weights)

    def of(self, block: str) -> tuple[Mapping[str, float], float]:
        """One block's weights by source, and its scale.

        Raises:
            InputError: no such block.
        """
        ensure_known("block", block, self.blocks)
        b = self.blocks.index(block)
        return dict(zip(self.sources, self.weights[b], strict=True)), self.scales[b]

    def over(
        self, sources: Sequence[str], blocks: Sequence[str]
    ) -> tuple[tuple[tuple[float, ...], ...], tuple[float, ...]]:
        """Rows of weights and scales in the order of other sources and blocks; an absent source weighs 0."""
        parts = [self.of(block) for block in blocks]
        rows = tuple(tuple(weights.get(source, 0.0) for source in sources) for weights, _ in parts)
        return rows, tuple(scale for _, scale in parts)

    def canonical(self, identity: Mapping[str, str], partition: str) -> dict[str, Any]:
        """What of this recipe decides the merged network, as plain values in one fixed order.

        Sources that weigh nothing anywhere are dropped, the rest are named by fingerprint and sorted by
        it. Where all blocks agree and no scale differs from 1, blocks do not matter and are left out, so
        that an equal-weight merge has one key under every partition.

        Args:
            identity: source name -> fingerprint.
            partition: the fingerprint of the block partition.
        """
        # Adding a source with weight 0 is the same network: it shall not be evaluated again.
        used = [e for e in range(len(self.sources)) if any(row[e] != 0.0 for row in self.weights)]
        # By content: neither names nor the order of pool.toml change a key.
        order = sorted(used, key=lambda e: identity[self.sources[e]])
        sources = [identity[self.sources[e]] for e in order]
        rows = [[row[e] for e in order] for row in self.weights]
        # The base, whatever scales there are.
        if not sources:
            return {"sources": []}
        # Where all blocks are alike the partition decides nothing.
        if self.tied and all(scale == 1.0 for scale in self.scales):
            return {"sources": sources, "weights": rows[0]}
        return {"sources": sources, "weights": rows, "scales": list(self.scales), "partition": partition}

    def as_dict(self) -> dict[str, Any]:
        """Plain values: ``weights[block][source]`` and ``scales[block]``."""
        prepared = {"preparation": as_dicts(self.preparation)} if self.preparation else {}
        return {
            "format": PREPARED if self.preparation else FORMAT,
            **prepared,
            "sources": list(self.sources),
            "blocks": list(self.blocks),
            "weights": {
                block: dict(zip(self.sources, row, strict=True))
                for block, row in zip(self.blocks, self.weights, strict=True)
            },
            "scales": dict(zip(self.blocks, self.scales, strict=True)),
        }

    def to_json(self) -> str:
        """The recipe as JSON text; :meth:`from_json` reads it back exactly."""
        return json.dumps(self.document(), indent=2)

    def document(self) -> dict[str, Any]:
        """:meth:`as_dict`, and under ``networks`` the fingerprints it is bound to."""
        return self.as_dict() | ({} if self.merged_from is None else {"networks": dict(self.merged_from)})

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], *, where: str = "recipe") -> Recipe:
        """Read what :meth:`as_dict` or :meth:`document` wrote.

        Raises:
            InputError: a key is missing, or is not of the recipe's form; ``where`` names the file.
        """
        if values.get("format") not in (FORMAT, PREPARED):
            raise InputError(
                f"{where}: found format {values.get('format')!r}, expected {FORMAT!r} or {PREPARED!r}"
            )
        steps = from_dicts(values.get("preparation"), where) if values["format"] == PREPARED else ()
        table(values, where, _KEYS if values["format"] == PREPARED else _KEYS - {"preparation"})
        sources, blocks = (
            _names(_entry(values, key, where), f"{where}: {key}") for key in ("sources", "blocks")
        )
        rows = table(_entry(values, "weights", where), f"{where}: weights", blocks)
        of_block = table(_entry(values, "scales", where), f"{where}: scales", blocks)
        weights = tuple(_numbers(_entry(rows, b, where), sources, f"{where}: weights.{b}") for b in blocks)
        scales = _numbers(of_block, blocks, f"{where}: scales")
        try:
            return cls(sources, blocks, weights, scales, steps, _networks(values.get("networks"), where))
        except InputError as error:
            raise InputError(f"{where}: {str(error).removeprefix('recipe: ')}") from error

    @classmethod
    def from_json(cls, text: str, *, where: str = "recipe") -> Recipe:
        """Read what :meth:`to_json` wrote.

        Raises:
            InputError: the text is no JSON object, or no recipe.
        """
        values = parse_json(text, where, "expected what Recipe.to_json writes")
        if not isinstance(values, dict):
            kind = type(values).__name__
            raise InputError(f"{where}: found a JSON {kind}, expected the object that Recipe.to_json writes")
        return cls.from_dict(values, where=where)


def _networks(values: Any, where: str) -> dict[str, str] | None:
    if values is None:
        return None
    held = table(values, f"{where}: networks")
    return {name: read_text_value(held[name], f"{where}: networks.{name}") for name in held}


def _entry(values: Mapping[str, Any], key: str, where: str) -> Any:
    if key not in values:
        raise InputError(f"{where}: the entry {key!r} is missing from the recipe")
    return values[key]


def _names(values: Any, where: str) -> tuple[str, ...]:
    if not isinstance(values, list):
        raise InputError(f"{where} is {values!r}, expected a list of names")
    return tuple(read_text_value(name, where) for name in values)


def _numbers(values: Any, names: Sequence[str], where: str) -> tuple[float, ...]:
    """The numbers of a table that has one under each name and nothing else."""
    held = table(values, where, names)
    return tuple(number(_entry(held, name, where), f"{where}.{name}", least=0.0) for name in names)


def routed(
    sources: Sequence[str],
    blocks: Sequence[str],
    weights: Sequence[Sequence[float]],
    scales: Sequence[float] | None = None,
) -> Recipe:
    """A routed recipe, each row of weights a point on the simplex over the sources.

    Raises:
        InputError: a row does not sum to 1 (within 1e-6).
    """
    for block, row in zip(blocks, weights, strict=True):
        # Up to rounding: weights that went through a file or a softmax.
        if abs(math.fsum(row) - 1.0) > 1e-6:
            raise InputError(
                f"recipe: block {block!r} has weights that sum to {math.fsum(row):g}, expected 1: "
                "divide the row by its sum, or use Recipe.weighted for another sum"
            )
    rows = tuple(tuple(float(w) for w in row) for row in weights)
    return Recipe(tuple(sources), tuple(blocks), rows, tuple(scales) if scales else (1.0,) * len(blocks))
