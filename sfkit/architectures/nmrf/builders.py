"""The two NMRF networks, their sizes in one table, and their entries in the registry."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum

from torch import nn

from sfkit.architectures.inputs import InputConvention
from sfkit.architectures.nmrf.encoders import ResidualEncoder, SwinEncoder
from sfkit.architectures.nmrf.network import CANDIDATES, NMRF
from sfkit.architectures.nmrf.proposals import STRIDE
from sfkit.architectures.nmrf.state_dicts import (
    CONSTANTS,
    RESNET_BLOCKS,
    RESNET_KEYS,
    SWIN_BLOCKS,
    SWIN_KEYS,
    EncoderKeys,
    checker,
    renamer,
)
from sfkit.architectures.registry import Options, register_architecture
from sfkit.errors import InputError, ensure_known

SWIN_DROP_PATH = 0.4


class Normalisation(StrEnum):
    """Who normalises the images; a checkpoint does not say, its training code does."""

    NETWORK = "network"  # the original code: images of 0..255 go in
    CALLER = "caller"  # OpenStereo: ImageNet-normalised images go in, the encoder leaves them as they are


@dataclass(frozen=True)
class Size:
    """What distinguishes the variants.

    Attributes:
        features: channels F of the encoder's output at 1/4 resolution.
        multiple: what image height and width must be divisible by.
        keys: the encoder's names in the state dict.
        encoder: (features, normalise) -> encoder.
    """

    features: int
    multiple: int
    keys: EncoderKeys
    encoder: Callable[[int, bool], nn.Module]


def _swin_encoder(features: int, normalise: bool) -> nn.Module:
    return SwinEncoder(features, normalise, SWIN_DROP_PATH)


SWIN = Size(features=128, multiple=32, keys=SWIN_KEYS, encoder=_swin_encoder)
RESNET = Size(features=256, multiple=8, keys=RESNET_KEYS, encoder=ResidualEncoder)

DEFAULT_MAX_DISP = 320


def build(size: Size, max_disp: int, normalisation: str) -> NMRF:
    """A network of this size, with PyTorch's initial weights, in training mode as PyTorch has it.

    Raises:
        InputError: ``max_disp`` is no multiple of 8 that leaves every pixel its four seeds, or the
            normalisation is unknown.
    """
    if max_disp % STRIDE or max_disp < CANDIDATES * STRIDE:
        raise InputError(
            f"max_disp is {max_disp}, expected a multiple of {STRIDE} of at least {CANDIDATES * STRIDE}: "
            f"{DEFAULT_MAX_DISP} is the training code's value, 312 that of its zero-shot evaluation"
        )
    encoder = size.encoder(size.features, _normalisation(normalisation) is Normalisation.NETWORK)
    return NMRF(encoder, size.keys.prefix, size.features, size.multiple, max_disp)


def convention(size: Size) -> Callable[[Options], InputConvention]:
    """How images become this variant's input: options -> convention.

    The original code pads before it normalises; padding here comes second, which is the same, since
    it repeats pixels and normalisation acts on each alone.
    """

    def inputs(options: Options) -> InputConvention:
        if _normalisation(options.get("normalisation", Normalisation.NETWORK)) is Normalisation.CALLER:
            return InputConvention(multiple=size.multiple)
        return InputConvention(scale=1.0, mean=(0.0, 0.0, 0.0), std=(1.0, 1.0, 1.0), multiple=size.multiple)

    return inputs


def _normalisation(name: str) -> Normalisation:
    names = [n.value for n in Normalisation]
    ensure_known("normalisation", name, names)
    return Normalisation(name)


@register_architecture(
    "nmrf-swint",
    blocks=SWIN_BLOCKS,
    inputs=convention(SWIN),
    constants=CONSTANTS,
    rename=renamer(SWIN_KEYS),
    check=checker(SWIN_KEYS, [RESNET_KEYS]),
    version="2",
)
def nmrf_swint(*, max_disp: int = DEFAULT_MAX_DISP, normalisation: str = Normalisation.NETWORK.value) -> NMRF:
    """NMRF with Swin-T and deformable neck: 32.5 M parameters, images in multiples of 32."""
    return build(SWIN, max_disp, normalisation)


@register_architecture(
    "nmrf-res",
    blocks=RESNET_BLOCKS,
    inputs=convention(RESNET),
    constants=CONSTANTS,
    rename=renamer(RESNET_KEYS),
    check=checker(RESNET_KEYS, [SWIN_KEYS]),
    version="2",
)
def nmrf_res(*, max_disp: int = DEFAULT_MAX_DISP, normalisation: str = Normalisation.NETWORK.value) -> NMRF:
    """NMRF with the residual encoder: 6.1 M parameters, images in multiples of 8."""
    return build(RESNET, max_disp, normalisation)
