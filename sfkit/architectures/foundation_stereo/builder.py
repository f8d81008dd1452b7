"""FoundationStereo as an entry of the registry: its options, its blocks, how it reads images."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from sfkit.architectures.foundation_stereo.disparity_transformer import DisparityAttention
from sfkit.architectures.foundation_stereo.network import MULTIPLE, FoundationStereo
from sfkit.architectures.foundation_stereo.options import check_options, options_from_config
from sfkit.architectures.foundation_stereo.sizes import SIZES
from sfkit.architectures.inputs import InputConvention, PadSides
from sfkit.architectures.registry import register_architecture
from sfkit.errors import InputError

MONOCULAR = "feature.dino."

BLOCKS: Mapping[str, tuple[str, ...]] = {
    "backbone": (f"{MONOCULAR}*", "feature.stem.*", "feature.stages.*"),
    "neck": ("feature.deconv*", "feature.conv4.*", "proj_cmb.*", "stem_2.*", "stem_4.*"),
    "cost_volume": ("corr_stem.*", "corr_feature_att.*", "cost_agg.*", "classifier.*"),
    "head": (
        "cnet.*",
        "context_zqr_convs.*",
        "update_block.*",
        "sam.*",
        "cam.*",
        "spx_2_gru.*",
        "spx_gru.*",
    ),
}

# In published files, but without influence on any output.
DEAD = (
    "context_zqr_convs.*",
    "stem_4.*",
    "cnet.down.*",
    "cnet.norm.*",
    f"{MONOCULAR}depth_anything.pretrained.mask_token",
    f"{MONOCULAR}depth_anything.depth_head.scratch.refinenet4.resConfUnit1.*",
    f"{MONOCULAR}depth_anything.depth_head.scratch.output_conv2.*",
)

# The network normalises by itself, so images reach it as they are.
INPUTS = InputConvention(
    scale=1.0, mean=(0.0, 0.0, 0.0), std=(1.0, 1.0, 1.0), multiple=MULTIPLE, sides=PadSides.CENTRE
)

_CLASS_TOKEN = f"{MONOCULAR}depth_anything.pretrained.cls_token"


def check_shapes(shapes: Mapping[str, tuple[int, ...]], options: Mapping[str, Any]) -> None:
    """Refuse a checkpoint of another ViT size with a sentence that names the right option.

    Raises:
        InputError: the file's class token has the width of another size than ``vit_size``.
    """
    found = shapes.get(_CLASS_TOKEN)
    chosen = options["vit_size"]
    # The class token is as wide as the ViT.
    sizes = [name for name, size in SIZES.items() if found is not None and found[-1] == size.width]
    if sizes and sizes != [chosen]:
        raise InputError(
            f"key {_CLASS_TOKEN} has shape {tuple(found or ())}, which is that of vit_size {sizes[0]!r}, "
            f"expected that of {chosen!r}: set the option vit_size to {sizes[0]!r}"
        )


def options_beside(checkpoint: Path) -> dict[str, Any]:
    """The options of the ``cfg.yaml`` in a checkpoint's folder; none where there is no such file."""
    config = checkpoint.parent / "cfg.yaml"
    return options_from_config(config) if config.is_file() else {}


@register_architecture(
    "foundation-stereo",
    blocks=BLOCKS,
    inputs=INPUTS,
    dead=DEAD,
    frozen=(f"{MONOCULAR}*",),
    check=check_shapes,
    beside=options_beside,
    version="1",
)
def foundation_stereo(
    *,
    vit_size: str = "vitl",
    max_disp: int = 416,
    iterations: int = 32,
    disparity_attention: str = "disparity",
    mixed_precision: bool = False,
    low_memory: bool = False,
) -> FoundationStereo:
    """Build FoundationStereo with random weights, in evaluation mode; nothing is downloaded.

    **Which attention.** Two versions of this network's disparity transformer are in circulation. The
    original release attends along disparity, as the paper says. A later revision of the authors'
    repository exchanged the attention routine, and since then the four heads of each disparity attend
    to one another and nothing passes between disparities; open pull requests there call it an error.
    Keys and weights are the same, the disparities are not: they lie tens of pixels apart on random
    weights. The default is ``"disparity"``, after the paper and the original release; which of the two
    the published weights were trained with cannot be proved from what is public. Choose ``"heads"`` to
    reproduce the later revision, and where you have ground truth, evaluate both once.

    Args:
        vit_size: ``"vits"``, ``"vitb"`` or ``"vitl"``; must be that of the checkpoint.
        max_disp: disparities from 0 up to this many pixels enter the cost volume; a multiple of 32.
            Time and memory grow with it; no weight depends on it.
        iterations: recurrent updates, at least 1.
        disparity_attention: ``"disparity"`` or ``"heads"``, see above.
        mixed_precision: on CUDA, half precision where the authors use it; no effect on other devices.
        low_memory: do not store the correlation of all pixel pairs of a row but compute it again at
            each iteration; same disparities.

    Raises:
        InputError: a value outside these ranges.
    """
    check_options(
        {
            "vit_size": vit_size,
            "max_disp": max_disp,
            "iterations": iterations,
            "disparity_attention": disparity_attention,
            "mixed_precision": mixed_precision,
            "low_memory": low_memory,
        }
    )
    network = FoundationStereo(
        SIZES[vit_size],
        max_disp,
        iterations,
        DisparityAttention(disparity_attention),
        mixed_precision,
        low_memory,
    )
    return network.eval()
