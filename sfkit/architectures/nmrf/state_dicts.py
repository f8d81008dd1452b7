"""NMRF's state dicts: the block partition, what is constant, and the layouts found in the wild."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass

from sfkit.architectures.registry import Blocks, Options
from sfkit.errors import InputError

# Never merged: index tables, image statistics, and an empty tensor that only names a device.
CONSTANTS = (
    "*.relative_position_index",
    "image_encoder.mean",
    "image_encoder.std",
    "device_indicator_tensor",
)

# concatconv and gw make the features both inference and refinement match with; the proposals do not use them.
_SHARED: Mapping[str, tuple[str, ...]] = {
    "cost_volume": ("dpn.*",),
    "head": (
        "concatconv.*",
        "gw.*",
        "inference.*",
        "infer_head.*",
        "infer_score_head.*",
        "refinement.*",
        "refine_head.*",
    ),
}

SWIN_BLOCKS: Blocks = {
    "backbone": ("image_encoder.backbone.*",),
    "neck": ("image_encoder.neck.*",),
    **_SHARED,
}

# The residual encoder has no neck: the 1x1 projection at its end plays that part.
RESNET_BLOCKS: Blocks = {
    "backbone": ("backbone.conv1.*", "backbone.layer1.*", "backbone.layer2.*", "backbone.layer3.*"),
    "neck": ("backbone.conv2.*",),
    **_SHARED,
}


@dataclass(frozen=True)
class EncoderKeys:
    """How one variant's encoder names its keys.

    Attributes:
        architecture: the variant's name in the registry.
        encoder: what the encoder is, for messages.
        prefix: the encoder's prefix as the network names it.
        alias: the prefix the same tensors have when saved with the other COMPAT setting.
        children: the names right under the prefix; no other variant has one of them there.
    """

    architecture: str
    encoder: str
    prefix: str
    alias: str
    children: frozenset[str]

    def owns(self, key: str) -> bool:
        """Does this variant's encoder have ``key``, under either prefix?"""
        prefix, _, rest = key.partition(".")
        return prefix in (self.prefix, self.alias) and rest.partition(".")[0] in self.children


SWIN_KEYS = EncoderKeys(
    "nmrf-swint",
    "Swin-T",
    "image_encoder",
    "backbone",
    frozenset({"backbone", "neck", "mean", "std"}),
)
RESNET_KEYS = EncoderKeys(
    "nmrf-res",
    "residual",
    "backbone",
    "image_encoder",
    frozenset({"conv1", "layer1", "layer2", "layer3", "conv2"}),
)


def renamer(variant: EncoderKeys) -> Callable[[Iterable[str]], Mapping[str, str]]:
    """Keys as found -> keys as the network names them.

    The training code's COMPAT setting chooses between the prefixes ``backbone.`` and
    ``image_encoder.`` for the very same encoder.
    """

    def rename(keys: Iterable[str]) -> Mapping[str, str]:
        renamed = {}
        for key in keys:
            prefix, dot, rest = key.partition(".")
            foreign = variant.owns(key) and prefix != variant.prefix
            renamed[key] = variant.prefix + dot + rest if foreign else key
        return renamed

    return rename


def checker(
    variant: EncoderKeys, others: Iterable[EncoderKeys]
) -> Callable[[Mapping[str, tuple[int, ...]], Options], None]:
    """Refuse the other variant's state dict in one sentence.

    Most of NMRF has the same keys in both variants, and a checkpoint does not say which it is; the
    usual way to meet the mistake is a Swin-T checkpoint read with the default configuration.
    """

    def check(shapes: Mapping[str, tuple[int, ...]], _options: Options) -> None:
        for other in others:
            found = next((key for key in shapes if other.owns(key)), None)
            if found is not None:
                raise InputError(
                    f"the state dict has the key {found!r} of a {other.encoder} encoder, expected the "
                    f"{variant.encoder} encoder of architecture {variant.architecture!r}: "
                    f"open it as {other.architecture!r}"
                )

    return check
