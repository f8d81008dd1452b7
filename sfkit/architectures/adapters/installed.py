"""Networks of the PyPI package ``stereo_matching`` (MIT), family by family.

Importing that package imports all its families, one of them with a licence of its own. Here a family is
imported by itself, and FoundationStereo, which comes with sfkit, never.
"""

from __future__ import annotations

import importlib
import importlib.util
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, cast

from torch import nn

from sfkit.architectures.adapters import standalone
from sfkit.architectures.adapters.checkouts import packages, without_downloads
from sfkit.architectures.code import tree_digest
from sfkit.architectures.inputs import InputConvention, PadSides
from sfkit.architectures.module_blocks import ByNetwork, fitting_blocks
from sfkit.architectures.registry import Blocks, Options, register_architecture
from sfkit.errors import InputError, unknown_name

PACKAGE = "stereo_matching"
PREFIX = "net."  # before the keys of the network that a class of theirs wraps


@dataclass(frozen=True)
class NetworkFamily:
    """Networks of one kind.

    Attributes:
        module: below ``stereo_matching.models``.
        blocks: over the keys of the network that is wrapped.
    """

    module: str
    blocks: Blocks


# A variant ("raft-stereo-realtime") begins with its family's name.
FAMILIES = {
    "aanet": NetworkFamily("aanet", standalone.AANET_BLOCKS),
    "crestereo": NetworkFamily(
        "crestereo",
        {
            "features": ["fnet.*"],
            "attention": ["self_att_fn.*", "cross_att_fn.*", "conv_offset_*"],
            "update": ["update_block.*"],
        },
    ),
    "igev-plusplus": NetworkFamily(
        "igev_plusplus",
        {
            "backbone": ["feature.*", "stem_*", "cnet.*", "context_zqr_convs.*"],
            "cost volume": ["conv.*", "desc.*", "patch*", "selective_conv.*"],
            "aggregation": ["cost_agg*", "classifier.*", "disp_*"],
            "update": ["update_block.*", "spx*"],
        },
    ),
    "igev-stereo": NetworkFamily("igev_stereo", standalone.IGEV_BLOCKS),
    "raft-stereo": NetworkFamily("raft_stereo", standalone.RAFT_BLOCKS),
    "s2m2": NetworkFamily(
        "s2m2",
        {
            "backbone": ["cnn_backbone.*", "feat_pyramid.*"],
            "transformer": ["transformer.*"],
            "head": ["disp_init.*", "feat_fusion_layer.*", "global_refiner.*"],
            "refinement": ["refiner.*", "ctx_feat.*", "upsample_*"],
        },
    ),
    "unimatch": NetworkFamily("unimatch", standalone.GMSTEREO_BLOCKS),
}


def _folder() -> Path:
    spec = importlib.util.find_spec(PACKAGE)
    if spec is None or not spec.submodule_search_locations:
        raise InputError(
            f"the package {PACKAGE} is not installed, expected it for the architecture 'stereo-matching': "
            "pip install 'sfkit[stereo-matching]'"
        )
    return Path(spec.submodule_search_locations[0])


def _family(model: str) -> str:
    fitting = [family for family in FAMILIES if model == family or model.startswith(f"{family}-")]
    if not fitting:
        raise unknown_name("model of stereo_matching", model, FAMILIES)
    return fitting[0]


@cache
def _classes(folder: Path, family: str) -> tuple[Any, Any]:
    """Configuration and model of a family, from its registry; nothing else of the package is imported."""
    models = f"{PACKAGE}.models"
    try:
        with packages(folder.parent, PACKAGE, models), without_downloads():
            importlib.import_module(f"{models}.{FAMILIES[family].module}")
            registry = importlib.import_module(f"{PACKAGE}.registry").MODEL_REGISTRY
            return registry.get_config_cls(family), registry.get_model_cls(family)
    except ImportError as error:
        raise InputError(f"{PACKAGE}: its family {family!r} cannot be imported ({error})") from error


def _configuration(options: Mapping[str, Any]) -> Any:
    """Of a variant, with the number of updates chosen here."""
    model = options["model"]
    configuration, _ = _classes(_folder(), _family(model))
    try:
        found = configuration.from_variant(model)
    except ValueError as error:
        raise InputError(f"{PACKAGE}: {error}") from error
    found.num_iters = options["iterations"]
    return found


def _inputs(options: Options) -> InputConvention:
    """As its configuration normalises; a family that takes 0..255 undoes that by itself."""
    found = _configuration(options)
    mean, std = (tuple(map(float, values)) for values in (found.mean, found.std))
    return InputConvention(1.0 / 255.0, cast(Any, mean), cast(Any, std), 32, PadSides.CENTRE)


def _blocks(network: nn.Module, options: Options) -> Blocks:
    blocks = FAMILIES[_family(options["model"])].blocks
    prefixed = {name: [PREFIX + glob for glob in globs] for name, globs in blocks.items()}
    return fitting_blocks(network, prefixed)


def _named(keys: Iterable[str]) -> Mapping[str, str]:
    """Published checkpoints are those of the original repositories, without the wrapping class's prefix."""
    return {key: key if key.startswith(PREFIX) else PREFIX + key for key in keys}


@register_architecture(
    "stereo-matching",
    blocks=ByNetwork(_blocks),
    inputs=_inputs,
    rename=_named,
    checkout=lambda _options: tree_digest(_folder()),
    version="1",
)
def stereo_matching(*, model: str = "raft-stereo", iterations: int = 32) -> nn.Module:
    """A network of ``stereo_matching`` by the name of a variant, such as ``raft-stereo-realtime``."""
    configuration = _configuration({"model": model, "iterations": iterations})
    _, build = _classes(_folder(), _family(model))
    with without_downloads():
        return cast(nn.Module, build(configuration))
