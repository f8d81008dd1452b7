"""How a network in training does on validation pairs: the benchmark's metric, mean over images."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import torch
from torch import nn

from sfkit.architectures import InputConvention
from sfkit.datasets.benchmark_record import Benchmark
from sfkit.datasets.metric import Metric
from sfkit.evaluation.metrics import count_errors, thresholds_for
from sfkit.evaluation.regions import regions_of
from sfkit.training.loop import Score


def scorer_of(benchmark: Benchmark, inputs: InputConvention, device: torch.device) -> Score:
    """A function from a network in evaluation mode to its score.

    Raises:
        InputError: a pair lacks what the protocol asks for.
    """
    benchmark.ensure_scorable()

    rule, metric = benchmark.rule, Metric.parse(benchmark.metric)
    limits = thresholds_for(metric)

    @torch.no_grad()
    def score(network: nn.Module) -> Sequence[float]:
        errors = []
        for sample in benchmark.samples():
            pair = inputs.prepare(sample.left, sample.right)
            output = pair.window.crop(network(pair.left.to(device), pair.right.to(device)))
            # Some networks keep an axis of one channel.
            map_ = output.reshape(output.shape[-2:]).float().cpu().numpy()
            valid = rule.valid_mask(sample) if metric.needs_truth else np.zeros(sample.size, dtype=np.bool_)
            found = count_errors(map_, regions_of(sample, valid, rule), thresholds=limits)
            count = metric.counter(sample, valid, "cpu")
            errors.append(found if count is None else replace(found, own={metric.name: count(map_)}))
        return [rule.aggregate(errors, metric)]

    return score
