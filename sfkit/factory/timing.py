"""Time a factory's steps before the first of them: a few of a training, and a network on the guide."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

import torch

from sfkit.factory.file import Factory
from sfkit.factory.standing import status
from sfkit.merging.network import load_network
from sfkit.training.finetune import finetune
from sfkit.training.loop import Course
from sfkit.training.scoring import scorer_of

STEPS = 3
"""Of which the first is not counted: it allocates, and reads what others find read."""


def time_steps(factory: Factory, device: str = "cpu") -> dict[str, float]:
    """Seconds a step of each network whose cost nothing says yet, by taking three of its own.

    What is trained is thrown away. A network whose kind of step (batch, crop, precision) was just timed is
    told by that one.

    Raises:
        InputError: what :func:`~sfkit.training.finetune.finetune` refuses.
    """
    found: dict[str, float] = {}
    orders = {order.name: order for order in factory.networks}
    while True:
        name = next((i.name for i in status(factory, found) if i.left is None), None)
        if name is None:
            return found
        order = orders[name]
        ends: list[float] = []

        # Bound now: the loop goes on with another list.
        def listen(course: Course, ends: list[float] = ends) -> None:
            ends.append(course.seconds)

        with TemporaryDirectory(prefix="sfkit-") as folder:
            finetune(
                factory.base,
                order.data,
                Path(folder) / "timed.safetensors",
                name=factory.architecture,
                options=factory.options,
                settings=replace(order.settings, max_steps=STEPS),
                device=device,
                listen=listen,
            )
        # A training may be shorter than that.
        found[name] = (ends[-1] - ends[0]) / (len(ends) - 1) if len(ends) > 1 else ends[0]


def time_evaluation(factory: Factory, device: str = "cpu") -> float:
    """Seconds of the base on the pairs that guide the search: an evaluation without the merging."""
    loaded = load_network(factory.base, name=factory.architecture, options=factory.options)
    place = torch.device(device)
    network, seconds = loaded.network.to(place).eval(), 0.0
    for guide in factory.validation:
        score = scorer_of(guide, loaded.inputs, place)
        started = time.perf_counter()
        score(network)
        seconds += time.perf_counter() - started
    return seconds
