"""How a network of another code base is called, and what it returns, told in a few words.

Most stereo networks differ in little more than this: one takes ``(left, right, iters=32, test_mode=True)``
and returns a list of negative horizontal flows, another takes a dictionary and fills in ``disp_pred``.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import torch
import torch.nn.functional as F
from torch import nn

from sfkit.errors import InputError, ensure_known, unknown_name

STEPS = ("tensor", "first", "last", "key:NAME", "negated", "fraction")
FORMS = ("pair", "dictionary")


@dataclass(frozen=True)
class Calling:
    """What stands between two images and a disparity in pixels.

    Attributes:
        form: ``"pair"`` for ``forward(left, right)``, ``"dictionary"`` for ``forward({"left":, "right":})``.
        keywords: further arguments of every call, such as ``{"iters": 32, "test_mode": True}``.
        output: what is done with what comes back, in order: ``"last"`` (or ``"first"``) of a list or tuple,
            ``"key:NAME"`` of a dictionary, ``"negated"`` (a horizontal flow; of two channels the first), and
            ``"fraction"`` of the width; ``"tensor"`` where nothing is.
        resolution: the output has one ``resolution``-th of the input's height and width, its values are in
            pixels of that size; it is brought to full size bilinearly.

    Raises:
        InputError: another word than these.
    """

    form: str = "pair"
    keywords: Mapping[str, Any] = field(default_factory=dict)
    output: Sequence[str] = ("tensor",)
    resolution: int = 1

    def __post_init__(self) -> None:
        ensure_known("form of a network's input", self.form, FORMS)
        steps = (self.output,) if isinstance(self.output, str) else tuple(self.output)
        object.__setattr__(self, "output", steps)
        for step in steps:
            if step not in STEPS and not step.startswith("key:"):
                raise unknown_name("step of a network's output", step, STEPS)
        if self.resolution < 1:
            raise InputError(
                f"resolution is {self.resolution}, expected 4 where the output has a quarter's size"
            )

    def call(self, forward: Any, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        """The disparity (B, H, W) in pixels of a call of ``forward``.

        Args:
            forward: the network's own.
            left: (B, 3, H, W), prepared.
            right: the same of the right image.
        """
        if self.form == "dictionary":
            output = forward({"left": left, "right": right}, **self.keywords)
        else:
            output = forward(left, right, **self.keywords)
        for step in self.output:
            output = _step(step, output, left.shape[-1])
        if output.ndim == 4:
            output = output[:, 0]
        if self.resolution != 1:
            scaled = F.interpolate(output[:, None], left.shape[-2:], mode="bilinear", align_corners=False)
            # Disparities are as much smaller as the map is.
            output = scaled[:, 0] * self.resolution
        return output  # type: ignore[no-any-return]

    def adapt(self, network: nn.Module) -> nn.Module:
        """The same network, its keys untouched, called in sfkit's way: ``forward(left, right)``."""
        calling, kind = self, type(network)

        def forward(self: nn.Module, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
            return calling.call(functools.partial(kind.forward, self), left, right)

        # By class: a function on the instance would follow it into copies, still bound to the first.
        network.__class__ = type(kind.__name__, (kind,), {"forward": forward, "__module__": kind.__module__})
        return network


PLAIN = Calling()


def _step(step: str, output: Any, width: int) -> Any:
    match step.partition(":"):
        case (("first" | "last"), _, _):
            return output[0 if step == "first" else -1]
        case "key", _, name:
            return output[name]
        case "negated", _, _:
            return -(output[:, 0] if output.ndim == 4 else output)
        case "fraction", _, _:
            return output * width
        case _:
            return output
