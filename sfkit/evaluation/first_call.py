"""The usual mistakes of a new network, told on its first pair and before any search.

A network that returns a flow, a list or a map of a quarter's size often runs through a whole search and
scores like noise. One pair with a known shift shows what is wrong, and which option mends it.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
import torch
from numpy.typing import NDArray
from torch import nn

from sfkit.architectures import InputConvention
from sfkit.errors import InputError
from sfkit.evaluation.engines.plan import module_of
from sfkit.evaluation.estimating import peak_memory
from sfkit.merging.pool import Pool

SHIFT = 8  # pixels that the pair's right view is moved by
SIZE = (75, 150)  # of the pair; no multiple of what networks like to divide by
LARGER = (270, 500)  # where that is too small: PSMNet pools over cells of 256 pixels, others shift by 192
MULTIPLES = (8, 16, 32, 48, 64)
SAME = 1e-4  # px that two calls of one network may differ by


@dataclass(frozen=True)
class Mistake:
    """One thing that is wrong with how a network is called or what it returns.

    Attributes:
        name: a word for it.
        sentence: what was found, and the option that mends it.
        fatal: whether no evaluation can come out right.
    """

    name: str
    sentence: str
    fatal: bool = True


@dataclass(frozen=True)
class FirstCall:
    """What one call of a pool's base showed.

    Attributes:
        mistakes: the first ones found; empty where all is well.
        seconds: of one forward pass, the second; 0 where there was none.
        memory: the process's highest memory so far, in bytes.
        size: height and width of the pair, in pixels.
    """

    mistakes: tuple[Mistake, ...]
    seconds: float
    memory: int
    size: tuple[int, int]


def shifted_pair(size: tuple[int, int] = SIZE, shift: int = SHIFT) -> tuple[NDArray[np.uint8], ...]:
    """A textured pair (H, W, 3) uint8 whose disparity is ``shift`` pixels everywhere."""
    # By a seed of its own, so that every network is shown the same pair.
    noise = np.random.default_rng(7).integers(0, 256, (size[0], size[1] + shift, 3), dtype=np.uint8)
    # A little soft, as photographs are: noise from pixel to pixel matches nothing in training.
    wide = cv2.GaussianBlur(noise, (5, 5), 1.2)
    return np.ascontiguousarray(wide[:, : size[1]]), np.ascontiguousarray(wide[:, shift:])


def first_call(pool: Pool) -> FirstCall:
    """Call the pool's base once or twice, and look hard at what comes back."""
    network, entry = pool.merge(pool.base_recipe()).network, pool.architecture
    inputs, size = entry.inputs(pool.options), SIZE
    mistakes = [*_importable(pool), *_mode(network)]
    seconds = 0.0
    try:
        output, fatal, size = _first(network, inputs)
        if fatal is None:
            # The second call is timed: the first one pays for what is made once.
            started = time.perf_counter()
            again = _called(network, inputs, size)
            seconds = time.perf_counter() - started
    except Exception as error:  # whatever a user's network raises is what is to be told
        text = str(error).partition("\n")[0]
        fatal = Mistake("call", f"the network failed ({type(error).__name__}: {text})")
    mistakes += [fatal] if fatal else list(_output(output, again, inputs.window(*size)[1]))
    return FirstCall(tuple(mistakes), seconds, peak_memory(), size)


def _importable(pool: Pool) -> Iterator[Mistake]:
    try:
        module_of(pool)
    except InputError as error:
        yield Mistake("import", str(error), fatal=False)


def _mode(network: nn.Module) -> Iterator[Mistake]:
    for name, module in network.named_modules():
        if isinstance(module, nn.modules.batchnorm._BatchNorm) and (
            module.training or not module.track_running_stats
        ):
            yield Mistake(
                "training mode",
                f"{name} normalises by the batch it sees although the network is in evaluation mode: let its "
                "train() pass the mode on to its modules, and keep running statistics",
            )
            return


def _first(network: nn.Module, inputs: InputConvention) -> tuple[Any, Mistake | None, tuple[int, int]]:
    """The output on the first pair that the network takes and its (height, width), or why it takes none.

    Raises:
        Exception: whatever the network raises where neither gradients nor another multiple would help.
    """
    for size in (SIZE, LARGER):
        try:
            return _called(network, inputs, size), None, size
        except Exception:  # a small pair is too small for some; what fails on both is looked into
            continue
    left, right = shifted_pair(LARGER)
    if _runs(network, inputs, left, right, gradients=True):
        sentence = (
            "the network runs only where gradients are recorded: take autograd and in-place changes of "
            "parameters out of its forward, which evaluations call without gradients"
        )
        return None, Mistake("gradients", sentence), LARGER
    for multiple in MULTIPLES:
        other = replace(inputs, multiple=multiple)
        # Only multiples of what the convention asks for keep to it.
        if multiple % inputs.multiple == 0 and _runs(network, other, left, right, gradients=False):
            sentence = (
                f"the network fails on {left.shape[1]}x{left.shape[0]} pixels and runs where both are "
                f"multiples of {multiple}: say inputs=InputConvention(multiple={multiple})"
            )
            return None, Mistake("size", sentence), LARGER
    return _called(network, inputs, LARGER), None, LARGER


def _called(network: nn.Module, inputs: InputConvention, size: tuple[int, int]) -> Any:
    pair = inputs.prepare(*shifted_pair(size))
    with torch.inference_mode():
        return network(pair.left, pair.right)


def _runs(
    network: nn.Module,
    inputs: InputConvention,
    left: NDArray[np.uint8],
    right: NDArray[np.uint8],
    *,
    gradients: bool,
) -> bool:
    pair = inputs.prepare(left, right)
    try:
        with torch.inference_mode(not gradients), torch.set_grad_enabled(gradients):
            network(pair.left, pair.right)
    except Exception:  # any failure answers the question
        return False
    return True


def _output(output: Any, again: Any, size: tuple[int, int]) -> Iterator[Mistake]:
    """What is wrong with the output of a (height, width) input; the first thing where it hides the next."""
    height, width = size
    if isinstance(output, dict):
        keys = ", ".join(map(str, output))
        yield Mistake(
            "dictionary", f'it returns a dictionary with {keys}: say output="key:{next(iter(output))}"'
        )
        return
    if isinstance(output, (list, tuple)):
        kind = type(output).__name__
        yield Mistake(kind, f'it returns a {kind} of {len(output)}: say output="last" (or "first")')
        return
    if not isinstance(output, torch.Tensor):
        kind = type(output).__name__
        yield Mistake("type", f"it returns a {kind}: return a torch tensor (B, H, W) of float32")
        return
    if output.dtype in (torch.float16, torch.bfloat16):
        yield Mistake(
            "half", f"it returns {output.dtype}, which rounds disparities: return output.float()", fatal=False
        )
    if output.ndim == 4 and output.shape[1] == 2:
        yield Mistake("channels", 'it returns two channels, which looks like a flow: say output="negated"')
        return
    found = tuple(output.shape[-2:])
    if found != (height, width):
        share = round(width / found[1]) if found[1] else 0
        # Strided layers round up.
        whole = share > 1 and found == (-(-height // share), -(-width // share))
        mend = f"say resolution={share}" if whole else "return the input's size"
        yield Mistake("resolution", f"it returns {found[1]}x{found[0]} for {width}x{height}: {mend}")
        return
    yield from _values(output.float(), again.float())


def _values(output: torch.Tensor, again: torch.Tensor) -> Iterator[Mistake]:
    if not bool(torch.isfinite(output).all()):
        yield Mistake("finite", "it returns values that are not finite: is its input as in training?")
        return
    apart = float((output - again).abs().max())
    if apart > SAME:
        yield Mistake(
            "random",
            f"two calls on one pair differ by {apart:.3g} px: draw nothing at random in evaluation mode "
            "(dropout, samples), or no score can be repeated",
        )
    middle = float(output.median())
    if middle < 0:
        yield Mistake("sign", f'its disparities are negative (median {middle:.2f} px): say output="negated"')
    elif float(output.max()) <= 1.0:
        yield Mistake(
            "fraction",
            f"its values stay below 1 (median {middle:.3f}) on a pair shifted by {SHIFT} px, which looks "
            f'like a share of the width: say output="fraction"',
        )
