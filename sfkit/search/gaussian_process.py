"""Gaussian-process regression for a few hundred points (Rasmussen and Williams 2006, chapters 2, 4 and 5).

NumPy and LAPACK in double precision; no random number is drawn. Hyper-parameters come from a grid and ties
go to its earlier entry, so that the same points and values give the same model on one machine with one number
of BLAS threads. Another BLAS may round differently; where two proposals are as good as equal it can then
choose the other one.

A page of our own rather than scikit-learn's or BoTorch's: in its place scikit-learn's model needs about as
many evaluations for some ten times the computing, and BoTorch's computes several hundred times as long
(``benchmarks/optimum.py``). What either would add to an installation and to a start, and whether it finds the
same again, is measured by ``benchmarks/sections/models.py``.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack

Array = NDArray[np.float64]
Points = tuple[Array, ...]
"""Features in groups, (n, d_g) each; every group has a length scale of its own."""

LENGTHS: tuple[float, ...] = tuple(float(v) for v in np.geomspace(0.1, 3.2, 11))
"""Length scales that are tried, in units of the features."""
NOISES: tuple[float, ...] = (1e-6, 1e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1)
"""Variances of the noise that are tried, as shares of the signal's variance."""
# The middle of LENGTHS, where every climb begins.
_CENTRE = 5
Place = tuple[int, ...]
"""Indices on a grid of hyper-parameters."""
_SMALLEST = 1e-12


@dataclass(frozen=True)
class GaussianProcess:
    """A posterior: constant mean, Matern kernel with nu = 5/2, Gaussian noise.

    Attributes:
        points: what it learned from, n rows in each group.
        lengths: one length scale a group.
        noise: variance of the noise as a share of the signal's.
        mean: the constant mean, in the values' unit.
        variance: of the signal, in the unit's square.
        inverse: inverse of the lower Cholesky factor of kernel + noise, (n, n).
        weights: (kernel + noise)^-1 (values - mean), (n,).
    """

    points: Points
    lengths: tuple[float, ...]
    noise: float
    mean: float
    variance: float
    inverse: Array
    weights: Array

    def predict(self, points: Points) -> tuple[Array, Array]:
        """Mean and standard deviation of the noiseless value at m points: (m,) each (eqs. 2.25 and 2.26)."""
        across = matern(distances(points, self.points), self.lengths)
        mean = self.mean + across @ self.weights
        # k^T K^-1 k as a sum of squares of L^-1 k, which is never negative.
        explained = np.sum((across @ self.inverse.T) ** 2, axis=1)
        # At a point it learned from, rounding can leave less than no variance.
        return mean, np.sqrt(self.variance * np.maximum(1.0 - explained, _SMALLEST))

    def believing(self, points: Points) -> GaussianProcess:
        """The same after hearing its own mean at further points: only what it is unsure of changes.

        The kriging believer of Ginsbourger et al. 2010; proposals of one batch keep apart by it.
        """
        mean, _ = self.predict(points)
        old, _ = self.predict(self.points)
        return _posterior(
            tuple(np.concatenate(pair) for pair in zip(self.points, points, strict=True)),
            # The values it learned from are not kept: they are its means there and what it took for noise.
            np.concatenate([old + self.noise * self.weights, mean]),
            self.lengths,
            self.noise,
            fixed=(self.mean, self.variance),
        )


def fit(
    points: Points, values: Array, noises: Sequence[float] = NOISES, *, like: GaussianProcess | None = None
) -> GaussianProcess:
    """The model of highest evidence on the grid of length scales and noises.

    Length scales climb from the middle of the grid, one group at a time, while the evidence rises; for each
    of them the noise climbs from where it ended for those before.

    Args:
        points: at least two rows in each group.
        values: (n,), finite.
        noises: which to try, ascending.
        like: a model whose length scales and noise are taken as they are.
    """
    if like is not None:
        return _posterior(points, values, like.lengths, like.noise)
    apart = distances(points, points)
    seen: dict[Place, tuple[float, int]] = {}
    last = len(noises) // 2

    def evidence(where: Place) -> float:
        nonlocal last
        if where not in seen:
            kernel = matern(apart, [LENGTHS[i] for i in where])
            # The climb over noises begins where that of the neighbour ended.
            seen[where] = _best_noise(kernel, values, noises, last)
            last = seen[where][1]
        return seen[where][0]

    where = _climb((_CENTRE,) * len(points), len(LENGTHS), evidence)
    return _posterior(points, values, tuple(LENGTHS[i] for i in where), noises[seen[where][1]])


def log_evidence(process: GaussianProcess, values: Array) -> float:
    """How well a model explains the values it learned from, to be compared with others of the same values.

    Args:
        process: the model.
        values: (n,), those it was fitted to.

    Returns:
        Log marginal likelihood (eq. 5.8), the mean integrated out and the variance at its best, up to a
        constant.
    """
    noisy = matern(distances(process.points, process.points), process.lengths)
    noisy[np.diag_indices(len(values))] += process.noise
    return _evidence(noisy, np.column_stack([values, np.ones_like(values)]))


def distances(one: Points, other: Points) -> tuple[Array, ...]:
    """Squared Euclidean distances in each group, (n, m)."""
    found = []
    for a, b in zip(one, other, strict=True):
        square = np.sum(a**2, axis=1)[:, None] + np.sum(b**2, axis=1)[None, :] - 2.0 * (a @ b.T)
        # The square written out is slightly negative for equal points, and its root would be NaN.
        found.append(np.maximum(square, 0.0))
    return tuple(found)


def matern(apart: Sequence[Array], lengths: Sequence[float]) -> Array:
    """Matern kernel with nu = 5/2 of distances in units of the length scales (eq. 4.17)."""
    first, *others = (square / length**2 for square, length in zip(apart, lengths, strict=True))
    r = np.asarray(sum(others, first))
    np.sqrt(np.multiply(r, 5.0, out=r), out=r)
    # Written out in place: most of a proposal's time goes into these lines.
    kernel = r * r
    kernel /= 3.0
    kernel += r
    kernel += 1.0
    kernel *= np.exp(np.negative(r, out=r), out=r)
    return kernel


def _climb(start: Place, size: int, height: Callable[[Place], float]) -> Place:
    """The end of a steepest climb on a grid of ``size`` entries an axis; a tie is no step."""
    here = start
    while True:
        around = [
            (*here[:g], here[g] + step, *here[g + 1 :])
            for g in range(len(here))
            for step in (-1, 1)
            if 0 <= here[g] + step < size
        ]
        best = max(around, key=height, default=here)
        # Not on a plateau, where it would walk for ever.
        if height(best) <= height(here):
            return here
        here = best


def _best_noise(kernel: Array, values: Array, noises: Sequence[float], start: int) -> tuple[float, int]:
    """Highest evidence and which noise has it, by a climb from one of them."""
    # Values and ones are solved for in one pass through the factor.
    sides, diagonal = np.column_stack([values, np.ones_like(values)]), np.arange(len(values))
    seen: dict[Place, float] = {}

    def evidence(where: Place) -> float:
        if where not in seen:
            # A copy: the factorisation writes over it.
            noisy = kernel.copy()
            noisy[diagonal, diagonal] += noises[where[0]]
            seen[where] = _evidence(noisy, sides)
        return seen[where]

    where = _climb((start,), len(noises), evidence)
    return seen[where], where[0]


def _evidence(noisy: Array, sides: Array) -> float:
    """Log marginal likelihood (eq. 5.8), the mean integrated out and the variance at its best (2.44).

    Args:
        noisy: kernel + noise, (n, n); overwritten.
        sides: the values, and ones, (n, 2).
    """
    # LAPACK itself: its wrappers check and copy for longer than a small matrix takes.
    # LAPACK reads columns first: the transpose of a symmetric matrix is itself, without a copy.
    factor, failed = lapack.dpotrf(noisy.T, lower=1, overwrite_a=1, clean=0)
    if failed:
        return -math.inf
    along, ones = lapack.dtrtrs(factor, sides, lower=1)[0].T
    # The constant mean by generalised least squares (eq. 2.44), then taken off.
    weight = float(ones @ ones)
    rest = along - (along @ ones) / weight * ones
    # Values that are all equal leave nothing, which has no logarithm.
    fitted = max(float(rest @ rest) / len(rest), _SMALLEST)
    # log det K from its factor.
    spread = 2.0 * float(np.sum(np.log(factor.diagonal())))
    return -0.5 * (len(rest) * math.log(fitted) + spread + math.log(weight))


def _posterior(
    points: Points,
    values: Array,
    lengths: tuple[float, ...],
    noise: float,
    fixed: tuple[float, float] | None = None,
) -> GaussianProcess:
    kernel = matern(distances(points, points), lengths)
    # Two points can be one, as believed ones may: without any noise there is no factor.
    factor = np.linalg.cholesky(kernel + max(noise, 1e-8) * np.eye(len(values)))
    # Kept: each later prediction is then one product.
    inverse = np.linalg.inv(factor)
    ones, along = inverse.sum(axis=1), inverse @ values
    mean, variance = fixed or (float(ones @ along / (ones @ ones)), 0.0)
    rest = along - mean * ones
    if fixed is None:
        variance = max(float(rest @ rest) / len(values), _SMALLEST)
    return GaussianProcess(points, lengths, noise, mean, variance, inverse, np.asarray(inverse.T @ rest))
