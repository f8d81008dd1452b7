"""Settings of Stage 2 (StereoFactory, Algorithm 2): what the paper gives, and what it leaves open."""

from __future__ import annotations

from dataclasses import dataclass

from sfkit.evaluation.holdout import check_holdout
from sfkit.search.checks import require_between, require_positive, require_whole
from sfkit.search.cma_es import SMALLEST_POPULATION
from sfkit.search.encoding import check_gamma, check_rank


@dataclass(frozen=True)
class RoutingSettings:
    """Settings of Stage 2. The paper gives gamma, tied routing and lambda = 0; the rest is our choice.

    Attributes:
        evaluations: N_eval, at least 1. Every candidate counts, x = 0 and the start included, cached or
            not. A population that would cross it is cut to what is left: those candidates are scored and
            may win, and the search ends there.
        population: N_pop, at least 3; None takes pycma's 4 + floor(3 ln n) for n dimensions.
        sigma: initial step size sigma^(0), above 0. 0.5 makes a scale's standard deviation about 0.19 and
            a weight's up to half of itself.
        gamma: bounds of the module scales, with 1 in the middle.
        tied: True shares one row of weights between all blocks (E + B dimensions), False gives each
            block its own (B * E + B).
        rank: R >= 1, with ``tied=False``, makes routing low-rank: one row that all blocks share and R
            directions that each follows to a degree of its own (E + R (B + E) + B); None for neither.
        scaled: False fixes all module scales at 1.
        entropy: lambda, at least 0: the weight of the mean entropy added to the score (eq. 13), in the
            score's unit a nat.
        holdout: validation pairs held out from CMA-ES, by whose score the best is chosen: a share in
            (0, 1), or a whole number of folds of at least 2; 0, the paper's form, holds out none. Fewer than
            four pairs are not split, which a warning says. Evaluations and their keys are the same with it;
            folds use up the budget, whatever ``converge`` says.
        shrinkage: at least 0: what a recipe must gain, in shares of the score of x = 0, for each unit of
            its mean squared distance from x = 0, Stage 1's equal weights.
        converge: True ends the search as soon as one of pycma's stop conditions holds (tolfun, tolx,
            tolfunhist, tolstagnation, tolflatfitness, ...), False uses up the budget.
        tolfun: stop condition, range of recent fitness values, in the score's unit.
        tolx: stop condition, standard deviations of x.
        floor: where a ``start`` has a weight of 0 or a scale on its bound, the search begins this far
            inside, in (0, 0.5), since the boundary itself lies at infinity.
        seed: at least 0; the same seed and the same scores give the same search.

    Raises:
        InputError: a value out of its range.
    """

    evaluations: int = 300
    population: int | None = None
    sigma: float = 0.5
    gamma: tuple[float, float] = (0.25, 1.75)
    tied: bool = True
    scaled: bool = True
    rank: int | None = None
    entropy: float = 0.0
    holdout: float = 0.0
    shrinkage: float = 0.0
    converge: bool = True
    tolfun: float = 1e-11
    tolx: float = 1e-11
    floor: float = 0.01
    seed: int = 0

    def __post_init__(self) -> None:
        require_whole("evaluations", self.evaluations, 1)
        if self.population is not None:
            require_whole("population", self.population, SMALLEST_POPULATION)
        require_positive("sigma", self.sigma)
        check_gamma(self.gamma)
        require_between("entropy", self.entropy, 0.0)
        check_rank(self.rank, self.tied)
        check_holdout(self.holdout)
        require_between("shrinkage", self.shrinkage, 0.0)
        require_between("tolfun", self.tolfun, 0.0)
        require_between("tolx", self.tolx, 0.0)
        require_between("floor", self.floor, 1e-12, 0.499)
        require_whole("seed", self.seed, 0)
