"""Editing a routing by hand: every edit keeps the weights of each block on the simplex.

A draft is a frozen record; an edit returns a new one. What one weight gains, the weights that are free to
move lose in proportion to what they have, so that their ratios stay. Weights that are locked keep their
value, and sources that are taken out weigh nothing until they are brought back.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace

from sfkit.errors import InputError, ensure_known, nearest
from sfkit.merging.recipe import Recipe, routed

Cell = tuple[str, str]
Row = tuple[float, ...]

GAMMA = (0.25, 1.75)
LONGEST_HISTORY = 200


@dataclass(frozen=True)
class RoutingDraft:
    """A recipe that is being edited; make one with :meth:`equal` or :meth:`of`.

    Attributes:
        recipe: routing weights, each row on the simplex, and module scales within ``gamma``.
        tied: True where one row of weights holds for all blocks: edits and locks are for all of them.
        gamma: lowest and highest module scale.
        locked: (block, source) of the weights that other edits leave alone.
        gone: sources taken out -> what they weighed in each block before.
    """

    recipe: Recipe
    tied: bool = True
    gamma: tuple[float, float] = GAMMA
    locked: frozenset[Cell] = frozenset()
    gone: Mapping[str, Row] = field(default_factory=dict)

    @classmethod
    def equal(
        cls,
        sources: Iterable[str],
        blocks: Iterable[str],
        *,
        tied: bool = True,
        gamma: tuple[float, float] = GAMMA,
    ) -> RoutingDraft:
        """Start from the equal-weight merge that Stage 1 scores (StereoFactory, eq. 4).

        Raises:
            InputError: no source, or a range of scales that does not hold 1.
        """
        names = tuple(sources)
        if not names:
            raise InputError("sources: found none, expected at least one to route")
        if not 0 <= gamma[0] < 1 < gamma[1] < math.inf:
            raise InputError(f"gamma: found {gamma}, expected a range of scales around 1")
        return cls(Recipe.equal(names, blocks), tied, (float(gamma[0]), float(gamma[1])))

    @property
    def sources(self) -> tuple[str, ...]:
        """The sources, those taken out included."""
        return self.recipe.sources

    @property
    def blocks(self) -> tuple[str, ...]:
        """The blocks, in the partition's order."""
        return self.recipe.blocks

    def of(self, recipe: Recipe) -> RoutingDraft:
        """Take on another recipe over these sources or fewer; nothing is locked or taken out any more.

        The draft is tied where it was and the recipe is, too.

        Raises:
            InputError: other blocks, a source that is not among these, weights that do not sum to 1, or a
                scale out of the range.
        """
        for source in recipe.sources:
            if source not in self.sources:
                listed = ", ".join(self.sources)
                raise InputError(
                    f"recipe: holds the source {source!r}, expected some of: {listed}"
                    f"{nearest(source, self.sources)}; open an inspector for the recipe's own sources"
                )
        if set(recipe.blocks) != set(self.blocks):
            raise InputError(
                f"recipe: has the blocks {', '.join(recipe.blocks)}, expected {', '.join(self.blocks)}: "
                "use a recipe of the same partition"
            )
        rows, scales = recipe.over(self.sources, self.blocks)
        checked = list(map(self._in_range, self.blocks, scales))
        taken = routed(self.sources, self.blocks, rows, checked)
        return replace(self, recipe=taken, tied=self.tied and taken.tied, locked=frozenset(), gone={})

    def reset(self) -> RoutingDraft:
        """Back to equal weights and scales of 1, nothing locked, nothing taken out."""
        return replace(self, recipe=Recipe.equal(self.sources, self.blocks), locked=frozenset(), gone={})

    def weigh(self, block: str, source: str, weight: float) -> RoutingDraft:
        """Set one weight, as far as the locked ones leave room; the others of its row follow.

        Args:
            block: whose row; of a tied draft any, all follow.
            source: whose weight.
            weight: in [0, 1].

        Raises:
            InputError: an unknown name, a weight out of [0, 1], or one that cannot move: it is locked, its
                source is taken out, or all others are.
        """
        place, column = self._place(block), self._column(source)
        if not 0.0 <= weight <= 1.0:
            raise InputError(f"weight of {source!r}: found {weight:g}, expected a number from 0 to 1")
        if source in self.gone:
            raise InputError(f"weight of {source!r}: the source is taken out, bring it back first")
        if (self.blocks[place], source) in self.locked:
            raise InputError(f"weight of {source!r} in {block!r}: is locked, unlock it first")
        if not self._free(place, besides=source):
            raise InputError(
                f"weight of {source!r} in {block!r}: all others are locked or taken out, unlock one of them"
            )
        return self._with_rows(lambda b, row: self._moved(b, row, column, weight), only=place)

    def scale(self, block: str, value: float) -> RoutingDraft:
        """Set one block's module scale.

        Raises:
            InputError: an unknown block, or a scale out of the range.
        """
        place = self._place(block)
        scales = list(self.recipe.scales)
        scales[place] = self._in_range(block, value)
        return replace(self, recipe=replace(self.recipe, scales=tuple(scales)))

    def lock(self, block: str, source: str, *, locked: bool = True) -> RoutingDraft:
        """Keep one weight as it is while others move, or let it go; of a tied draft in all blocks.

        Raises:
            InputError: an unknown name, or a source that is taken out.
        """
        place, _ = self._place(block), self._column(source)
        if source in self.gone:
            raise InputError(f"weight of {source!r}: the source is taken out, bring it back first")
        cells = {(name, source) for name in (self.blocks if self.tied else (self.blocks[place],))}
        return replace(self, locked=self.locked | cells if locked else self.locked - cells)

    def without(self, source: str) -> RoutingDraft:
        """What if this source were gone? Its weights go to the free ones, or to all where none is free.

        Raises:
            InputError: an unknown source, one already taken out, or the last one left.
        """
        column = self._column(source)
        if source in self.gone:
            raise InputError(f"source {source!r}: is taken out already")
        if len(self.gone) + 1 == len(self.sources):
            raise InputError(f"source {source!r}: is the last one left, bring another back first")
        # With its weights, so that it can come back as it was.
        gone = {**self.gone, source: tuple(row[column] for row in self.recipe.weights)}
        freed = replace(self, gone=gone, locked=frozenset(c for c in self.locked if c[1] != source))
        return freed._with_rows(lambda b, row: freed._moved(b, row, column, 0.0))

    def bring_back(self, source: str) -> RoutingDraft:
        """Undo :meth:`without` for one source: it weighs what it did, as far as the locked ones leave room.

        Raises:
            InputError: an unknown source, or one that is not taken out.
        """
        column = self._column(source)
        if source not in self.gone:
            raise InputError(f"source {source!r}: is not taken out")
        former = self.gone[source]
        back = replace(self, gone={name: row for name, row in self.gone.items() if name != source})
        return back._with_rows(lambda b, row: back._moved(b, row, column, former[b]))

    def tie(self, *, tied: bool) -> RoutingDraft:
        """One row of weights for all blocks (the mean of their rows), or a row for each; locks are lifted."""
        if not tied or self.recipe.tied:
            # A lock of one block says nothing of all blocks together.
            return replace(self, tied=tied, locked=frozenset())
        columns = zip(*self.recipe.weights, strict=True)
        row = tuple(math.fsum(column) / len(self.blocks) for column in columns)
        # What was taken out comes back with the mean of its rows.
        gone = {name: (math.fsum(rows) / len(rows),) * len(rows) for name, rows in self.gone.items()}
        recipe = replace(self.recipe, weights=(row,) * len(self.blocks))
        return replace(self, tied=True, locked=frozenset(), gone=gone, recipe=recipe)

    def _place(self, block: str) -> int:
        ensure_known("block", block, self.blocks)
        return self.blocks.index(block)

    def _column(self, source: str) -> int:
        ensure_known("source", source, self.sources)
        return self.sources.index(source)

    def _free(self, place: int, besides: str) -> list[int]:
        """Columns of a row that may move when ``besides`` does."""
        block = self.blocks[place]
        return [
            e
            for e, source in enumerate(self.sources)
            if source != besides and source not in self.gone and (block, source) not in self.locked
        ]

    def _moved(self, place: int, row: Row, column: int, weight: float) -> Row:
        """A row with one weight set, the rest of the simplex shared out among the free ones."""
        source = self.sources[column]
        free = self._free(place, besides=source)
        if not free and weight < row[column]:  # only where a source leaves: nothing else is free to take it
            free = [e for e, name in enumerate(self.sources) if e != column and name not in self.gone]
        kept = math.fsum(w for e, w in enumerate(row) if e != column and e not in free)
        # Locked weights may sum to more than 1 by a rounding: no room is not negative room.
        weight = min(weight, max(0.0, 1.0 - kept)) if free else row[column]
        rest, held = max(0.0, 1.0 - kept - weight), math.fsum(row[e] for e in free)
        moved = list(row)
        moved[column] = weight
        for e in free:
            # In proportion to what they have; alike where none has anything.
            moved[e] = rest * row[e] / held if held > 0.0 else rest / len(free)
        return tuple(moved)

    def _with_rows(self, change: Callable[[int, Row], Row], only: int | None = None) -> RoutingDraft:
        """Every row changed, or only one; of a tied draft one changed row holds for all blocks."""
        held = self.recipe.weights
        if self.tied:
            # One row, computed once: blocks of a tied draft cannot drift apart by rounding.
            rows = [change(only or 0, held[0])] * len(held)
        else:
            rows = [change(b, row) if only in (None, b) else row for b, row in enumerate(held)]
        return replace(self, recipe=replace(self.recipe, weights=tuple(rows)))

    def _in_range(self, block: str, value: float) -> float:
        low, high = self.gamma
        if not low <= value <= high:
            raise InputError(f"scale of {block!r}: found {value:g}, expected it from {low:g} to {high:g}")
        return float(value)


@dataclass(frozen=True)
class EditHistory:
    """Drafts one can go back to and forth again.

    Attributes:
        present: the draft as it is.
        past: earlier drafts, the latest last.
        future: drafts that were undone, the next one last.
        gesture: what made the present; further edits of the same gesture replace it.
    """

    present: RoutingDraft
    past: tuple[RoutingDraft, ...] = ()
    future: tuple[RoutingDraft, ...] = ()
    gesture: str | None = None

    def edit(self, draft: RoutingDraft, gesture: str | None = None) -> EditHistory:
        """Go on to ``draft``; one that changes nothing leaves no trace.

        Args:
            draft: the new present.
            gesture: names edits that belong together, such as those of one drag, and are undone as one.
        """
        if draft == self.present:
            return self
        # One drag of a slider is one step back.
        joined = gesture is not None and gesture == self.gesture
        past = self.past if joined else (*self.past, self.present)[-LONGEST_HISTORY:]
        return EditHistory(draft, past, (), gesture)

    def undo(self) -> EditHistory:
        """Back by one edit; unchanged where there is none."""
        if not self.past:
            return self
        return EditHistory(self.past[-1], self.past[:-1], (*self.future, self.present))

    def redo(self) -> EditHistory:
        """Forth by one edit that was undone; unchanged where there is none."""
        if not self.future:
            return self
        return EditHistory(self.future[-1], (*self.past, self.present), self.future[:-1])
