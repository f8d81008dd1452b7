"""How a network in training does on validation pairs: the benchmark's metric, mean over images."""

from __future__ import annotations

from collections.abc import Sequence

import torch
from torch import nn

from sfkit.architectures import InputConvention
from sfkit.datasets.benchmark_record import Benchmark
from sfkit.evaluation.metrics import count_errors, thresholds_for
from sfkit.evaluation.regions import regions_of
from sfkit.training.loop import Score


def scorer_of(benchmark: Benchmark, inputs: InputConvention, device: torch.device) -> Score:
    """A function from a network in evaluation mode to its score.

    Raises:
        InputError: a pair lacks what the protocol asks for.
    """
    benchmark.ensure_scorable()

    rule, metric = benchmark.rule, benchmark.metric
    limits = thresholds_for(metric)

    @torch.no_grad()
    def score(network: nn.Module) -> Sequence[float]:
        errors = []
        for sample in benchmark.samples():
            pair = inputs.prepare(sample.left, sample.right)
            output = pair.window.crop(network(pair.left.to(device), pair.right.to(device)))
            map_ = output.reshape(output.shape[-2:]).float().cpu().numpy()
            regions = regions_of(sample, rule.valid_mask(sample), rule)
            errors.append(count_errors(map_, regions, thresholds=limits))
        return [rule.aggregate(errors, metric)]

    return score
