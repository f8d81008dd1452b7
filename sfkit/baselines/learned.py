"""Methods that look at gradients: Fisher merging and AdaMerging."""

from __future__ import annotations

import torch

from sfkit.baselines.registry import Choice, baseline
from sfkit.baselines.trials import Trials
from sfkit.checkpoints.checks import Kind
from sfkit.errors import InputError
from sfkit.evaluation.combining import evaluators_of
from sfkit.evaluation.gradients import GradientModel, fisher_information, matching_entropy
from sfkit.merging.blocks import OUTSIDE
from sfkit.merging.pool import Pool
from sfkit.merging.prepare import measured, prepare
from sfkit.merging.recipe import Recipe
from sfkit.merging.steps import FisherMean

START, RATE = 0.3, 1e-3


@baseline("fisher", label="Fisher", paper="Matena and Raffel, NeurIPS 2022", tuned_on_validation=False)
def fisher(trials: Trials, *, floor: float = 1e-6) -> Choice:
    """The mean of all sources, each parameter weighted by its Fisher information on the validation pairs.

    Args:
        trials: the run.
        floor: information below it counts as this much.

    Raises:
        InputError: pairs without ground truth, or a source's loss or gradient is not finite.
    """
    parts = evaluators_of(trials.validation)
    if bare := [part.benchmark.name for part in parts if not part.benchmark.labelled]:
        raise InputError(
            f"fisher: {', '.join(bare)} has no ground truth, expected some to take the loss on: leave it "
            "out, or tune on labelled pairs"
        )
    prepared = [part.prepared for part in parts]
    on = "+".join(part.benchmark.name for part in parts)
    with trials.timed():
        information = {
            name: fisher_information(trials.pool, trials.pool.equal(name), prepared, device=parts[0].device)
            for name in trials.pool.names
        }
        trials.passed(len(information) * sum(len(part) for part in prepared))
        step = FisherMean(measured(information), on=on, floor=floor)
        pool = prepare(trials.pool, step, importances=information)
    # The prepared pool has one vector: its equal merge is the Fisher mean itself.
    trials.score([pool.uniform()], [{"floor": floor}], pool=pool)
    return Choice(pool.uniform(), pool, {"floor": floor}, note=f"information measured on {on}, with labels")


@baseline(
    "adamerging", label="AdaMerging (per source)", paper="Yang et al., ICLR 2024", tuned_on_validation=False
)
def adamerging(trials: Trials, *, steps: int = 100, start: float = START, rate: float = RATE) -> Choice:
    """One weight a source, learned by gradient descent on the entropy of the network's matching.

    Args:
        trials: the run.
        steps: of Adam, each on one validation pair in turn; labels are not looked at.
        start: of every weight; the paper's 0.3 makes a sum of 0.3 E, far from the mean for many sources.
        rate: Adam's step size, the paper's 1e-3.

    Raises:
        InputError: the architecture offers no matching distribution, or a setting is out of its range.
    """
    return _adapted(trials, steps, start, rate, by_block=False)


@baseline(
    "adamerging_blocks",
    label="AdaMerging (per block)",
    paper="Yang et al., ICLR 2024",
    tuned_on_validation=False,
)
def adamerging_blocks(
    trials: Trials, *, steps: int = 100, start: float = START, rate: float = RATE
) -> Choice:
    """The same with one weight a source and block; the arguments are those of :func:`adamerging`."""
    return _adapted(trials, steps, start, rate, by_block=True)


def _adapted(trials: Trials, steps: int, start: float, rate: float, *, by_block: bool) -> Choice:
    if steps < 0 or not (0.0 <= start <= 1.0) or rate <= 0.0:
        raise InputError(
            f"adamerging: found steps {steps}, start {start} and rate {rate}, expected at least 0, "
            "a number from 0 to 1 and one above 0"
        )
    pool, losses = trials.pool, matching_entropy(trials.pool)
    weights = torch.full((len(pool.blocks) if by_block else 1, len(pool.names)), float(start))
    adam = _Adam(weights, rate)
    recipe = _recipe(pool, weights)
    with trials.timed():
        parts = evaluators_of(trials.validation)
        models = [GradientModel(pool, part.prepared, losses, device=part.device) for part in parts]
        turns = [(model, number) for model in models for number in range(len(model.benchmark))]
        for step in range(steps):
            # One pair a step: a pass over all of them for each step would cost as much as a search.
            model, number = turns[step % len(turns)]
            model.take(recipe)
            entropy, flat = model.gradient(number)
            # Blocks that share a weight add up their gradients: the chain rule.
            by_source = _by_block(pool, flat)
            adam.step(by_source if by_block else by_source.sum(dim=0, keepdim=True))
            weights.clamp_(0.0, 1.0)  # as the authors' code does
            recipe = _recipe(pool, weights)
            trials.noted({"step": step, "entropy": entropy, "mean weight": float(weights.mean())})
        trials.passed(steps)
    trials.score([recipe], [{"step": steps}])
    return Choice(recipe, settings={"steps": steps}, note="learned on validation images, without labels")


class _Adam:
    """Adam (Kingma and Ba, ICLR 2015, algorithm 1); torch's own makes importing it take seconds."""

    def __init__(self, weights: torch.Tensor, rate: float) -> None:
        self.weights, self.rate, self.steps = weights, rate, 0
        self.first, self.second = torch.zeros_like(weights), torch.zeros_like(weights)

    def step(self, gradient: torch.Tensor) -> None:
        self.steps += 1
        self.first.lerp_(gradient, 0.1)
        self.second.lerp_(gradient.square(), 0.001)
        # Running means that begin at 0 are corrected for it (Kingma and Ba, ICLR 2015).
        first, second = self.first / (1 - 0.9**self.steps), self.second / (1 - 0.999**self.steps)
        self.weights.sub_(self.rate * first / (second.sqrt() + 1e-8))


def _recipe(pool: Pool, weights: torch.Tensor) -> Recipe:
    rows = [tuple(row) for row in weights.tolist()]
    rows = rows * len(pool.blocks) if len(rows) == 1 else rows
    return Recipe(pool.names, pool.blocks, tuple(rows), (1.0,) * len(pool.blocks))


def _by_block(pool: Pool, flat: torch.Tensor) -> torch.Tensor:
    """The gradient's products with the task vectors, (B, E): how a weight changes the loss (chain rule).

    Running statistics have no gradient; parameters outside every block follow the first one.
    """
    found = torch.zeros(len(pool.blocks), len(pool.names))
    for segment in pool.layout.segments:
        # The loss has no gradient by running statistics.
        if segment.kind is Kind.STATISTIC:
            continue
        part = slice(segment.start, segment.stop)
        row = found[0 if segment.block == OUTSIDE else segment.block]
        row += torch.stack([torch.dot(flat[part], pool.vectors[name][part]) for name in pool.names])
    return found
