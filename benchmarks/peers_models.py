"""Other libraries' Gaussian processes in our search's place: scikit-learn's and BoTorch's, on subsets.

Only the model is exchanged. Each search begins with the candidates ours begins with, sees weights, and scores
what has the smallest bound at our ``beta`` among all subsets nobody has scored.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import numpy as np
from bayesian import search_of
from landscapes import Landscape

from sfkit.search.acquisition import equal_weights, listed
from sfkit.search.gaussian_process import Array

MOST = 100
"""Evaluations of one search."""

Model = Callable[[Array, Array, Array], tuple[Array, Array]]
"""Weights (n, N), scores (n,) and further weights (m, N) -> mean and deviation of scores without noise."""


def searched_by(model: Model) -> Callable[[Landscape, int], list[int]]:
    """A search by a library's model; it ends at the optimum, which no model knows."""

    def run(land: Landscape, seed: int) -> list[int]:
        ours = search_of(land, seed)
        ours.step()
        count = len(land.names)
        met = [tuple(sorted(land.names.index(name) for name in c.subset)) for c in ours.candidates]
        scores = [c.score for c in ours.candidates]
        while len(met) < MOST and not any(
            s == land.best and len(g) > 1 for g, s in zip(met, scores, strict=True)
        ):
            fresh = [genes for genes in listed(ours.space) if genes not in met]
            mean, sd = model(equal_weights(met, count), np.array(scores), equal_weights(fresh, count))
            met.append(fresh[int(np.argmin(mean - ours.settings.beta * sd))])
            scores.append(land.scores[sum(1 << gene for gene in met[-1])])
        return [sum(1 << gene for gene in genes) for genes in met]

    return run


def scikit_learn(points: Array, values: Array, new: Array) -> tuple[Array, Array]:
    """``GaussianProcessRegressor``'s mean and deviation."""
    process = scikit_learn_fitted(points, values)
    mean, sd = process.predict(new, return_std=True)
    # Its deviation has the noise in it.
    noise = process.kernel_.k2.noise_level * np.var(values)
    return mean, np.sqrt(np.maximum(sd**2 - noise, 1e-12))


def scikit_learn_fitted(points: Array, values: Array) -> Any:
    """``GaussianProcessRegressor``: one length scale and noise by L-BFGS, values standardised."""
    from sklearn.exceptions import ConvergenceWarning
    from sklearn.gaussian_process import GaussianProcessRegressor
    from sklearn.gaussian_process.kernels import ConstantKernel, Matern, WhiteKernel

    kernel = ConstantKernel() * Matern(nu=2.5) + WhiteKernel(1e-2)
    process = GaussianProcessRegressor(kernel, normalize_y=True)
    with warnings.catch_warnings():  # of hyper-parameters at their bounds
        warnings.simplefilter("ignore", ConvergenceWarning)
        return process.fit(points, values)


def botorch(points: Array, values: Array, new: Array) -> tuple[Array, Array]:
    """``SingleTaskGP``'s mean and deviation."""
    import torch

    model = botorch_fitted(points, values)
    with torch.no_grad():
        told = model.posterior(torch.from_numpy(new))
    return told.mean[:, 0].numpy(), told.variance[:, 0].sqrt().numpy()


def botorch_fitted(points: Array, values: Array) -> Any:
    """``SingleTaskGP`` as BoTorch ships it: a length scale a source and their priors, by L-BFGS."""
    import torch
    from botorch.fit import fit_gpytorch_mll
    from botorch.models import SingleTaskGP
    from botorch.models.transforms import Standardize
    from gpytorch.mlls import ExactMarginalLogLikelihood

    model = SingleTaskGP(
        torch.from_numpy(points), torch.from_numpy(values)[:, None], outcome_transform=Standardize(1)
    )
    with warnings.catch_warnings():  # of fits that did not converge
        warnings.simplefilter("ignore")
        return fit_gpytorch_mll(ExactMarginalLogLikelihood(model.likelihood, model)).model
