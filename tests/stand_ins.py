"""Checkouts of other code bases for tests: packages with their shape and their way of being called."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from own_networks import NETWORK, write_pool, write_states

RAFT = """
from core.parts import MyNet

class RAFTStereo(MyNet):
    def __init__(self, args):
        super().__init__()
        assert args.hidden_dims == [128] * 3 and args["n_gru_layers"] == 3 and not args.mixed_precision

    def forward(self, image1, image2, iters=12, flow_init=None, test_mode=False):
        flow = -super().forward(image1 / 255, image2 / 255)[:, None]
        return (flow[..., ::4, ::4], flow) if test_mode else [flow] * iters
"""
IGEV = """
import timm_is_not_needed_here
from core.parts import MyNet

class IGEVStereo(MyNet):
    def __init__(self, args):
        super().__init__()

    def forward(self, image1, image2, iters=12, test_mode=False):
        return super().forward(image1 / 255, image2 / 255)[:, None]
"""
AANET = """
from .parts import MyNet

class AANet(MyNet):
    def __init__(self, max_disp, **options):
        super().__init__()

    def forward(self, left, right):
        disparity = super().forward(left, right)
        return [disparity[..., ::2, ::2] / 2, disparity]
"""
UNIMATCH = """
from .parts import MyNet

class UniMatch(MyNet):
    def __init__(self, num_scales, feature_channels, upsample_factor, reg_refine, task):
        super().__init__()

    def forward(self, img0, img1, attn_type, attn_splits_list, corr_radius_list, prop_radius_list,
                num_reg_refine, task):
        assert task == "stereo" and attn_splits_list == [2, 8]
        return {"flow_preds": [None, super().forward(img0, img1)]}
"""
LIGHT = """
from stereo.modeling.common.parts import MyNet

class LightStereo(MyNet):
    def __init__(self, cfgs):
        super().__init__(levels=cfgs.MAX_DISP // 48)

    def forward(self, data):
        result = {"disp_pred": super().forward(data["left"], data["right"])[:, None]}
        data["left"] = None  # some models write into what they are given
        return result
"""
CFG = """
DATA_CONFIG:
    DATA_TRANSFORM:
        EVALUATING:
            - { NAME: DivisiblePad, BY: 16 }
            - { NAME: NormalizeImage, MEAN: [ 0.5, 0.5, 0.5 ], STD: [ 0.25, 0.25, 0.25 ] }
MODEL: { NAME: LightStereo, MAX_DISP: 192 }
"""


def write(root: Path, files: dict[str, str]) -> Path:
    """A checkout of these files."""
    for name, text in files.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    return root


def openstereo(root: Path) -> Path:
    """OpenStereo's shape: packages whose ``__init__`` cannot be imported, a configuration, a model."""
    return write(
        root,
        {
            "stereo/__init__.py": "",
            "stereo/modeling/__init__.py": "raise ValueError('every trainer is imported here')",
            "stereo/modeling/models/__init__.py": "",
            "stereo/modeling/models/lightstereo/lightstereo.py": LIGHT,
            "stereo/modeling/common/__init__.py": "",
            "stereo/modeling/common/parts.py": NETWORK,
            "cfgs/lightstereo/s.yaml": CFG,
        },
    )


STAND_INS: dict[str, Callable[[Path], Path]] = {
    "raft-stereo": lambda root: write(root, {"core/raft_stereo.py": RAFT, "core/parts.py": NETWORK}),
    "igev-stereo": lambda root: write(
        root,
        {"core/igev_stereo.py": IGEV, "core/parts.py": NETWORK, "timm_is_not_needed_here.py": ""},
    ),
    "aanet": lambda root: write(
        root,
        {"nets/__init__.py": "from .aanet import AANet", "nets/aanet.py": AANET, "nets/parts.py": NETWORK},
    ),
    "gmstereo": lambda root: write(root, {"unimatch/unimatch.py": UNIMATCH, "unimatch/parts.py": NETWORK}),
    "openstereo": openstereo,
}
BLOCKS = '\n[blocks]\nfeatures = ["features.*"]\nhead = ["head.*"]\n'


def write_stand_in(name: str, folder: Path) -> Path:
    """The ``pool.toml`` of the stand-in's networks; its checkout is named from the folder of the pool."""
    STAND_INS[name](folder / "checkout")
    write_states(folder, prefix="module.")
    cfg = '\ncfg = "lightstereo/s.yaml"' if name == "openstereo" else ""
    path = write_pool(folder, f'architecture = "{name}"', f'root = "checkout"{cfg}')
    path.write_text(path.read_text() + BLOCKS)
    return path
