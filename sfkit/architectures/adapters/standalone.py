"""Stand-alone repositories: RAFT-Stereo, IGEV-Stereo, AANet and GMStereo, from the user's checkout.

Each is called as its own evaluation script calls it; sizes are those of its published SceneFlow checkpoint.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, cast

from torch import nn

from sfkit.architectures.adapters.checkouts import Arguments, ensure_root, without_downloads
from sfkit.architectures.code import import_from, tree_digest
from sfkit.architectures.inputs import InputConvention, PadSides
from sfkit.architectures.module_blocks import ByNetwork
from sfkit.architectures.registry import Blocks, register_architecture
from sfkit.errors import InputError
from sfkit.files import home

RAW = InputConvention(1.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0), 32, PadSides.CENTRE)  # 0..255, as PNG holds them
RAFT_BLOCKS: Blocks = {
    "context": ["cnet.*", "context_zqr_convs.*"],
    "features": ["fnet.*", "conv2.*"],
    "update": ["update_block.*"],
}
IGEV_BLOCKS: Blocks = {
    "backbone": ["feature.*", "stem_*", "cnet.*", "context_zqr_convs.*"],
    "cost volume": ["conv.*", "desc.*", "corr_stem.*", "corr_feature_att.*"],
    "aggregation": ["cost_agg.*", "classifier.*"],
    "update": ["update_block.*", "spx*"],
}
AANET_BLOCKS: Blocks = {
    "backbone": ["feature_extractor.*", "fpn.*", "feature_pyramid.*"],
    "aggregation": ["aggregation.*"],
    "refinement": ["refinement.*"],
}
GMSTEREO_BLOCKS: Blocks = {
    "backbone": ["backbone.*"],
    "transformer": ["transformer.*"],
    "propagation": ["feature_flow_attn.*"],
    "refinement": ["refine*", "upsampler.*"],
}


def _checkout(options: Mapping[str, Any]) -> str:
    return tree_digest(options["root"]) if options["root"] else ""


@register_architecture(
    "raft-stereo",
    blocks=ByNetwork.fitting(RAFT_BLOCKS),
    inputs=RAW,
    keywords=lambda options: {"iters": options["iterations"], "test_mode": True},
    output=("last", "negated"),  # (low-resolution flow, full-resolution flow): right minus left
    checkout=_checkout,
    places=("root",),
    version="1",
)
def raft_stereo(
    *,
    root: str = "",
    iterations: int = 32,
    hidden_dims: tuple[int, ...] = (128, 128, 128),
    corr_implementation: str = "reg",
    corr_levels: int = 4,
    corr_radius: int = 4,
    n_downsample: int = 2,
    n_gru_layers: int = 3,
    context_norm: str = "batch",
    shared_backbone: bool = False,
    slow_fast_gru: bool = False,
) -> nn.Module:
    """RAFT-Stereo (Lipson, Teed and Deng, 3DV 2021), from princeton-vl/RAFT-Stereo."""
    ensure_root(root, "raft-stereo", "princeton-vl/RAFT-Stereo")
    build = import_from(root, "core.raft_stereo", "RAFTStereo")
    arguments = Arguments(
        {
            "hidden_dims": list(hidden_dims),
            "corr_implementation": corr_implementation,
            "corr_levels": corr_levels,
            "corr_radius": corr_radius,
            "n_downsample": n_downsample,
            "n_gru_layers": n_gru_layers,
            "context_norm": context_norm,
            "shared_backbone": shared_backbone,
            "slow_fast_gru": slow_fast_gru,
            "mixed_precision": False,
        }
    )
    return cast(nn.Module, build(arguments))


@register_architecture(
    "igev-stereo",
    blocks=ByNetwork.fitting(IGEV_BLOCKS),
    inputs=RAW,
    keywords=lambda options: {"iters": options["iterations"], "test_mode": True},
    checkout=_checkout,
    places=("root",),
    version="1",
)
def igev_stereo(
    *,
    root: str = "",
    iterations: int = 32,
    max_disp: int = 192,
    hidden_dims: tuple[int, ...] = (128, 128, 128),
    corr_levels: int = 2,
    corr_radius: int = 4,
    n_downsample: int = 2,
    n_gru_layers: int = 3,
    slow_fast_gru: bool = False,
) -> nn.Module:
    """IGEV-Stereo (Xu, Wang, Ding and Yang, CVPR 2023), from gangweiX/IGEV's folder IGEV-Stereo."""
    ensure_root(root, "igev-stereo", "gangweiX/IGEV (its folder IGEV-Stereo)")
    arguments = Arguments(
        {
            "hidden_dims": list(hidden_dims),
            "corr_implementation": "reg",
            "corr_levels": corr_levels,
            "corr_radius": corr_radius,
            "n_downsample": n_downsample,
            "n_gru_layers": n_gru_layers,
            "max_disp": max_disp,
            "shared_backbone": False,
            "slow_fast_gru": slow_fast_gru,
            "mixed_precision": False,
            "precision_dtype": "float32",
        }
    )
    # timm would fetch weights that the checkpoint replaces.
    with without_downloads():
        build = import_from(root, "core.igev_stereo", "IGEVStereo")
        return cast(nn.Module, build(arguments))


@register_architecture(
    "aanet",
    blocks=ByNetwork.fitting(AANET_BLOCKS),
    inputs=InputConvention(multiple=48, sides=PadSides.TOP_RIGHT),
    output="last",  # a list of disparities, the finest last
    checkout=_checkout,
    places=("root",),
    version="1",
)
def aanet(
    *,
    root: str = "",
    max_disp: int = 192,
    feature_type: str = "aanet",
    feature_pyramid_network: bool = True,
    no_feature_mdconv: bool = False,
    no_intermediate_supervision: bool = False,
    refinement_type: str = "stereodrnet",
) -> nn.Module:
    """AANet (Xu and Zhang, CVPR 2020), from haofeixu/aanet; its deformable convolution needs a GPU."""
    ensure_root(root, "aanet", "haofeixu/aanet")
    extension = home(root) / "nets" / "deform_conv"
    if extension.is_dir() and not any(extension.glob("deform_conv_cuda*")):
        raise InputError(
            f"{extension}: its CUDA extension is not built, expected deform_conv_cuda: run build.sh there "
            "on a machine with a GPU; without one AANet does not run"
        )
    build = import_from(root, "nets", "AANet")
    return cast(
        nn.Module,
        build(
            max_disp,
            feature_type=feature_type,
            feature_pyramid_network=feature_pyramid_network,
            no_feature_mdconv=no_feature_mdconv,
            no_intermediate_supervision=no_intermediate_supervision,
            refinement_type=refinement_type,
        ),
    )


@register_architecture(
    "gmstereo",
    blocks=ByNetwork.fitting(GMSTEREO_BLOCKS),
    inputs=InputConvention(multiple=32, sides=PadSides.CENTRE),
    keywords=lambda options: {
        "attn_type": options["attn_type"],
        "attn_splits_list": list(options["attn_splits"]),
        "corr_radius_list": list(options["corr_radius"]),
        "prop_radius_list": list(options["prop_radius"]),
        "num_reg_refine": options["num_reg_refine"],
        "task": "stereo",
    },
    # A list of disparities, the finest last.
    output=("key:flow_preds", "last"),
    checkout=_checkout,
    places=("root",),
    version="1",
)
def gmstereo(
    *,
    root: str = "",
    num_scales: int = 2,
    upsample_factor: int = 4,
    feature_channels: int = 128,
    reg_refine: bool = True,
    num_reg_refine: int = 3,
    attn_type: str = "self_swin2d_cross_swin1d",
    attn_splits: tuple[int, ...] = (2, 8),
    corr_radius: tuple[int, ...] = (-1, 4),
    prop_radius: tuple[int, ...] = (-1, 1),
) -> nn.Module:
    """GMStereo (Xu et al., TPAMI 2023), from autonomousvision/unimatch."""
    ensure_root(root, "gmstereo", "autonomousvision/unimatch")
    build = import_from(root, "unimatch.unimatch", "UniMatch")
    return cast(
        nn.Module,
        build(
            num_scales=num_scales,
            feature_channels=feature_channels,
            upsample_factor=upsample_factor,
            reg_refine=reg_refine,
            task="stereo",
        ),
    )
