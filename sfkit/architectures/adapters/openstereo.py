"""OpenStereo as it stands in the user's checkout: a network from its configuration, without its trainers.

``stereo.modeling`` imports every trainer, and with them packages that few machines have. Here its packages
are entered by their folders, so that a model's own module is imported and nothing else.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any, cast

from torch import nn

from sfkit.architectures.adapters.checkouts import Arguments, ensure_root, packages, without_downloads
from sfkit.architectures.code import import_from, tree_digest
from sfkit.architectures.inputs import InputConvention, PadSides
from sfkit.architectures.module_blocks import ByNetwork, top_level_blocks
from sfkit.architectures.registry import Blocks, Options, register_architecture
from sfkit.architectures.yaml_file import read_yaml
from sfkit.errors import InputError, ensure_known
from sfkit.files import home

PAGE = "XiandaGuo/OpenStereo"
PACKAGES = ("stereo", "stereo.modeling", "stereo.modeling.models")
# MODEL.NAME of a configuration -> its module below stereo.modeling.models, and the class there.
MODELS: dict[str, tuple[str, str]] = {
    "CasGwcNet": ("casnet.cas_gwc", "GwcNet"),
    "CasPSMNet": ("casnet.cas_psm", "PSMNet"),
    "CoExNet": ("coex.coex", "CoEx"),
    "FADNet": ("fadnet.fadnet", "FADNet"),
    "GwcNet": ("gwcnet.gwcnet", "GwcNet"),
    "IGEV": ("igev.igev_stereo", "IGEVStereo"),
    "IGEVPP": ("igevpp.igevpp_stereo", "IGEVPPStereo"),
    "IGEVRT": ("igev_rt.igev_rt_stereo", "IGEVRTtereo"),
    "LightStereo": ("lightstereo.lightstereo", "LightStereo"),
    "MSNet2D": ("msnet.MSNet2D", "MSNet2D"),
    "MSNet3D": ("msnet.MSNet3D", "MSNet3D"),
    "PSMNet": ("psmnet.psmnet", "PSMNet"),
    "StereoBaseGRU": ("stereobase.stereobase_gru", "StereoBase"),
}
# Seen not to run on a CPU, and so not offered; OpenStereo's FoundationStereo has a licence of its own.
NOT_OFFERED = ("AANet", "CFNet", "NMRF", "STTR", "IInet", "MonSter")
BLOCKS: dict[str, Blocks] = {
    "LightStereo": {
        "backbone": ["backbone.*"],
        "aggregation": ["cost_agg.*"],
        "head": ["refine_*", "stem_2.*"],
    },
    "IGEV": {
        "backbone": ["feature.*", "stem_*", "cnet.*", "context_zqr_convs.*"],
        "cost volume": ["conv.*", "desc.*", "corr_stem.*", "corr_feature_att.*"],
        "aggregation": ["cost_agg.*", "classifier.*"],
        "update": ["update_block.*", "spx*"],
    },
    "PSMNet": {
        "backbone": ["Backbone.*"],
        "cost volume": ["CostProcessor.aggregator.dres0.*", "CostProcessor.aggregator.dres1.*"],
        "aggregation": ["CostProcessor.aggregator.dres*"],
        "head": ["CostProcessor.aggregator.classif*", "DispProcessor.*"],
    },
}


def _configuration(options: Mapping[str, Any]) -> dict[str, Any]:
    root, cfg = ensure_root(options["root"], "openstereo", PAGE), options["cfg"]
    path = home(root) / "cfgs" / cfg
    if not cfg or not path.is_file():
        raise InputError(
            f"{path}: no such file, expected the option cfg to be a path below cfgs/ of the checkout, "
            "such as lightstereo/lightstereo_s_sceneflow.yaml"
        )
    values = read_yaml(path, "give the configuration of a model")
    model = values.get("MODEL")
    if not isinstance(model, dict) or "NAME" not in model:
        raise InputError(f"{path}: has no MODEL with a NAME, expected the configuration of a model")
    return values


def _name(options: Mapping[str, Any]) -> str:
    name = str(_configuration(options)["MODEL"]["NAME"])
    if name in NOT_OFFERED:
        raise InputError(f"OpenStereo's {name} is not offered: as it stands it does not run on a CPU")
    ensure_known("model of OpenStereo", name, MODELS)
    return name


def _blocks(network: nn.Module, options: Options) -> Blocks:
    name = _name(options)
    return BLOCKS[name] if name in BLOCKS else top_level_blocks(network)


def _inputs(options: Options) -> InputConvention:
    """Normalisation and padding as the configuration's evaluation transforms have them."""
    data = _configuration(options).get("DATA_CONFIG", {})
    transforms = data.get("DATA_TRANSFORM", {}).get("EVALUATING", [])
    found = {entry["NAME"]: entry for entry in transforms}
    scale, mean, std = 1.0, (0.0, 0.0, 0.0), (1.0, 1.0, 1.0)
    if "NormalizeImage" in found:  # it divides by 255 first
        scale, mean, std = 1.0 / 255.0, *(_three(found["NormalizeImage"][key]) for key in ("MEAN", "STD"))
    multiple = int(found.get("DivisiblePad", {}).get("BY", 32))
    sides = PadSides.CENTRE if found.get("DivisiblePad", {}).get("MODE") == "round" else PadSides.TOP_RIGHT
    return InputConvention(scale, mean, std, multiple, sides)


def _three(values: list[float]) -> tuple[float, float, float]:
    first, second, third = map(float, values)
    return first, second, third


@cache
def _model_class(root: str, name: str) -> Any:
    module, attribute = MODELS[name]
    with packages(Path(root), *PACKAGES), without_downloads():
        return import_from(root, f"stereo.modeling.models.{module}", attribute)


@register_architecture(
    "openstereo",
    blocks=ByNetwork(_blocks),
    inputs=_inputs,
    call="dictionary",
    output="key:disp_pred",
    checkout=lambda options: tree_digest(options["root"], "stereo/modeling") if options["root"] else "",
    places=("root",),
    version="1",
)
def openstereo(*, root: str = "", cfg: str = "") -> nn.Module:
    """A model of OpenStereo (Guo et al., 2023) by a configuration of the user's checkout."""
    options = {"root": root, "cfg": cfg}
    name = _name(options)
    # One class, whichever way the checkout is named.
    folder = str(home(root).resolve())
    with without_downloads():
        return cast(nn.Module, _model_class(folder, name)(Arguments(_configuration(options)["MODEL"])))
