"""The vector CMA-ES moves, and the recipe it stands for (StereoFactory, eqs. 9, 10, 11 and 13).

Between the paper's tied and block-specific routing lies low-rank routing, which is ours: the logits are
W = 1 u^T + sum_r a_r b_r^T, one row u that all blocks share and R directions b_r over the sources, which each
block follows as far as its entry of a_r says.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from sfkit.errors import InputError
from sfkit.merging.recipe import Recipe, routed
from sfkit.search.checks import check_gamma, check_rank, require_known
from sfkit.search.constraints import Constraints
from sfkit.search.routing_records import RoutingSettings

Vector = NDArray[np.float64]

_SUM_TOLERANCE = 1e-6


@dataclass(frozen=True)
class Encoding:
    """x = [vec(W), s]: routing logits, row by row, then one scale variable a scaled block (eq. 9).

    Tied routing has one row of E logits for all blocks, block-specific routing one for each block that is
    not frozen. With B blocks, none frozen, x has E + B or B * E + B entries. Low-rank routing has u, then a_r
    (B entries) and b_r (E entries) for each r: E + R (B + E) + B entries.

    Attributes:
        sources: E names, at least two.
        blocks: B names, in the partition's order.
        gamma: bounds of the module scales, around 1, so that x = 0 is the equal-weight merge.
        tied: True where all blocks share one row of weights.
        rank: R of low-rank routing, at least 1, for ``tied=False``; None for block-specific routing.
        scaled: False fixes every module scale at 1.
        frozen: blocks with a scale of 1 and, unless tied, equal weights.

    Raises:
        InputError: fewer than two sources, bounds not around 1, an unknown block, or nothing left to move.
    """

    sources: tuple[str, ...]
    blocks: tuple[str, ...]
    gamma: tuple[float, float] = (0.25, 1.75)
    tied: bool = True
    scaled: bool = True
    frozen: tuple[str, ...] = ()
    rank: int | None = None

    def __post_init__(self) -> None:
        check_rank(self.rank, self.tied)
        if len(self.sources) < 2:
            raise InputError(
                f"sources: found {list(self.sources)}, expected at least two: one source leaves no routing"
            )
        require_known("frozen_blocks", self.frozen, self.blocks, "block")
        check_gamma("gamma", self.gamma)
        if self.dimension == 0:
            raise InputError("frozen_blocks: found every block, expected at least one that is free to move")

    @property
    def free(self) -> tuple[str, ...]:
        """Blocks that are not frozen."""
        return tuple(block for block in self.blocks if block not in self.frozen)

    @property
    def rows(self) -> int:
        """Rows of logits that x stands for."""
        return 1 if self.tied else len(self.free)

    @property
    def _cut(self) -> int:
        """Entries of x that are for the logits; those for the scales follow."""
        sources = len(self.sources)
        if self.rank is None:
            return self.rows * sources
        return sources + self.rank * (self.rows + sources)

    @property
    def dimension(self) -> int:
        """Entries of x."""
        return self._cut + (len(self.free) if self.scaled else 0)

    def logits(self, x: Vector) -> Vector:
        """W, (rows, E): one row for all blocks where tied, else one for each block that is not frozen.

        Several vectors, (..., dimension), have as many: (..., rows, E).
        """
        sources, many = len(self.sources), x.shape[:-1]
        if self.rank is None:
            return x[..., : self._cut].reshape(*many, self.rows, sources)
        # Entry r is a_r, then b_r: one reshape parts them for any number of vectors.
        factors = x[..., sources : self._cut].reshape(*many, self.rank, self.rows + sources)
        a, b = factors[..., : self.rows], factors[..., self.rows :]
        # u for every block, and the sum over r of a_r b_r^T.
        return np.asarray(x[..., None, :sources] + np.swapaxes(a, -1, -2) @ b)

    def decode(self, x: Vector) -> Recipe:
        """The recipe x stands for; zeros give exactly ``Recipe.equal``.

        Args:
            x: ``dimension`` finite numbers.
        """
        weights = [softmax(row) for row in self.logits(x)]
        scales = [scale_of(s, self.gamma) for s in x[self._cut :]]
        # What x does not move stays as Stage 1 scored it: equal weights, and below a scale of 1.
        equal = (1.0 / len(self.sources),) * len(self.sources)
        row_of = dict.fromkeys(self.blocks, weights[0] if self.tied else equal)
        if not self.tied:
            row_of |= dict(zip(self.free, weights, strict=True))
        scale_of_block = dict.fromkeys(self.blocks, 1.0)
        if self.scaled:
            scale_of_block |= dict(zip(self.free, scales, strict=True))
        return routed(
            self.sources,
            self.blocks,
            [row_of[block] for block in self.blocks],
            [scale_of_block[block] for block in self.blocks],
        )

    def distance(self, x: Vector) -> float:
        """Mean square of logits and scale variables, each row of logits less its mean.

        No recipe depends on a row's mean; a tied row counts once.
        """
        logits, scales = self.logits(x), x[self._cut :]
        # Logits that differ by a constant are the same weights.
        centred = logits - logits.mean(axis=1, keepdims=True)
        return float((np.sum(centred**2) + np.sum(scales**2)) / (logits.size + scales.size))

    def encode(self, recipe: Recipe, floor: float = 0.01) -> Vector:
        """A vector that decodes to the recipe, up to rounding, or near it where it lies on the boundary.

        A weight of 0 and a scale on its bound lie at infinity; ``floor`` brings them to where a search can
        still leave them: weights below it count as it, and scales keep that fraction of the range from
        either bound.

        Args:
            recipe: one that :meth:`admit` returned.
            floor: in (0, 0.5).

        Returns:
            ``dimension`` numbers; each row of logits has a mean of 0. Low-rank routing gets the nearest
            logits of its rank.
        """
        # Tied rows are all alike, so that the first stands for them.
        rows = (
            recipe.weights[:1] if self.tied else [recipe.weights[recipe.blocks.index(b)] for b in self.free]
        )
        # Softmax undoes the log of weights that sum to 1, whatever is added to a row.
        logits = np.log(np.maximum(np.asarray(rows, dtype=np.float64), floor))
        logits -= logits.mean(axis=1, keepdims=True)
        routing = logits.ravel() if self.rank is None else self._factors(logits)
        if not self.scaled:
            return routing
        half = (self.gamma[1] - self.gamma[0]) / 2.0
        # The inverse of scale_of: atanh is infinite on a bound, so that the clip comes first.
        scales = np.array([recipe.scales[recipe.blocks.index(block)] for block in self.free])
        bound = 1.0 - 2.0 * floor
        return np.concatenate([routing, 2.0 * np.arctanh(np.clip((scales - 1.0) / half, -bound, bound))])

    def _factors(self, logits: Vector) -> Vector:
        """u, then a_r and b_r, of the nearest W = 1 u^T + sum_r a_r b_r^T in the sum of squares."""
        u = logits.mean(axis=0)
        # The first factors of an SVD are the nearest matrix of their rank (Eckart and Young 1936).
        left, strengths, right = np.linalg.svd(logits - u, full_matrices=False)
        factors = np.zeros((self.rank or 0, self.rows + len(self.sources)))
        # Where R exceeds the matrix's rank, further factors stay 0.
        for r in range(min(len(factors), len(strengths))):
            # Each side takes the root of the strength: steps of CMA-ES, alike in all entries, then move both
            # alike.
            half = math.sqrt(float(strengths[r]))
            factors[r] = np.concatenate([left[:, r] * half, right[r] * half])
        return np.concatenate([u, factors.ravel()])

    def admit(self, recipe: Recipe, argument: str = "start") -> Recipe:
        """The recipe over all sources and blocks of this encoding, in its order; absent sources weigh 0.

        Raises:
            InputError: another set of blocks, an unknown source, weights that do not sum to 1, or a recipe
                this encoding cannot express (block-specific weights when tied, frozen blocks that differ,
                a scale out of bounds).
        """
        require_known(argument, recipe.sources, self.sources, "source")
        if set(recipe.blocks) != set(self.blocks):
            raise InputError(
                f"{argument}: found blocks {list(recipe.blocks)}, expected {list(self.blocks)}: "
                "use a recipe of the same partition"
            )
        admitted = Recipe(self.sources, self.blocks, *recipe.over(self.sources, self.blocks))
        self._check(admitted, argument)
        return admitted

    def _check(self, recipe: Recipe, argument: str) -> None:
        if self.tied and not recipe.tied:
            raise InputError(
                f"{argument}: found weights that differ between blocks, expected one row for all: "
                "set tied=False to search them"
            )
        equal = 1.0 / len(self.sources)
        for block, row, scale in zip(recipe.blocks, recipe.weights, recipe.scales, strict=True):
            where = f"{argument}: block {block!r}"
            if abs(math.fsum(row) - 1.0) > _SUM_TOLERANCE:
                raise InputError(f"{where} has weights that sum to {math.fsum(row):g}, expected 1")
            fixed = block in self.frozen or not self.scaled
            low, high = (1.0, 1.0) if fixed else self.gamma
            if not low <= scale <= high:
                raise InputError(f"{where} has the scale {scale:g}, expected it in [{low:g}, {high:g}]")
            # With tolerance: weights that went through a file or a sum are equal up to rounding.
            unequal = any(abs(weight - equal) > _SUM_TOLERANCE for weight in row)
            if block in self.frozen and not self.tied and unequal:
                raise InputError(f"{where} is frozen but has weights {list(row)}, expected equal ones")


def encoding_of(
    subset: tuple[str, ...], blocks: tuple[str, ...], settings: RoutingSettings, constraints: Constraints
) -> Encoding:
    """What Stage 2 moves over these sources and blocks.

    Raises:
        InputError: fewer than two sources, an unknown name, a subset that breaks the constraints, or nothing
            left to move.
    """
    constraints.check_subset(subset, blocks)
    moved = (settings.gamma, settings.tied, settings.scaled, constraints.frozen_blocks, settings.rank)
    return Encoding(subset, blocks, *moved)


def softmax(logits: Vector) -> tuple[float, ...]:
    """Weights on the simplex (eq. 10); equal logits give exactly 1/E each."""
    # The largest power is 1, so that none overflows.
    powers = np.exp(logits - logits.max())
    return tuple(float(weight) for weight in powers / powers.sum())


def scale_of(s: float, gamma: tuple[float, float]) -> float:
    """Module scale of one variable (eq. 11), as 1 + half the range * tanh(s / 2).

    For bounds with midpoint 1 that is the scaled sigmoid, and unlike it cannot overflow and is exactly 1
    at s = 0 whatever the bounds.
    """
    low, high = gamma
    scale = 1.0 + (high - low) / 2.0 * math.tanh(s / 2.0)
    # Rounding can carry 1 + half the range past a bound.
    return min(max(scale, low), high)


def mean_entropy(recipe: Recipe) -> float:
    """(1/B) sum over blocks of H(pi_b), in nats, between 0 and ln E (eq. 13 without lambda)."""
    # w ln w goes to 0 with w, where the logarithm is refused.
    entropies = [-math.fsum(w * math.log(w) for w in row if w > 0.0) for row in recipe.weights]
    return math.fsum(entropies) / len(entropies)
