"""Adapters against stand-ins: packages with the shape of a checkout and its way of being called."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest
import torch
from own_networks import NETWORK, write_pool, write_states
from tiny import write_pairs
from torch import nn

import sfkit
from sfkit.architectures import architecture
from sfkit.architectures.calling import Calling
from sfkit.architectures.code import tree_digest
from sfkit.errors import InputError

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
            "cfgs/sttr.yaml": "MODEL: { NAME: STTR }",
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


def pool_of(name: str, folder: Path) -> sfkit.Pool:
    """A pool of the stand-in's networks; its checkout is named from the folder of the pool."""
    STAND_INS[name](folder / "checkout")
    write_states(folder, prefix="module.")
    cfg = '\ncfg = "lightstereo/s.yaml"' if name == "openstereo" else ""
    path = write_pool(folder, f'architecture = "{name}"', f'root = "checkout"{cfg}')
    path.write_text(path.read_text() + BLOCKS)
    return sfkit.open_pool(path)


@pytest.mark.parametrize("name", STAND_INS)
def test_each_gives_the_disparity_of_the_network_it_wraps(name: str, tmp_path: Path) -> None:
    pool = pool_of(name, tmp_path)
    namespace: dict[str, type[nn.Module]] = {}
    exec(NETWORK, namespace)  # noqa: S102 (the network itself, called plainly)
    plain = namespace["MyNet"]()
    plain.load_state_dict(pool.state_dict(pool.base_recipe()))
    left, right = torch.rand(2, 1, 3, 96, 192, generator=torch.Generator().manual_seed(1)) * 255
    raw = name in ("raft-stereo", "igev-stereo")
    expected = plain(*(image / 255 if raw else image for image in (left, right)))
    found = pool.merge(pool.base_recipe()).disparity(left, right)
    torch.testing.assert_close(found, expected[0].detach())


@pytest.mark.parametrize("name", ["raft-stereo", "openstereo"])
def test_evaluations_in_processes_equal_those_of_one(name: str, tmp_path: Path) -> None:
    pool = pool_of(name, tmp_path)
    benchmark = sfkit.open_benchmark("pairs", write_pairs(tmp_path / "pairs"))
    recipes = [pool.base_recipe(), pool.uniform()]
    one = [outcome.score for outcome in sfkit.Evaluator(pool, benchmark)(recipes)]
    with sfkit.Evaluator(pool, benchmark, engine="processes", workers=2) as evaluator:
        assert [outcome.score for outcome in evaluator(recipes)] == one


def test_a_changed_checkout_is_another_version_and_its_place_is_none(tmp_path: Path) -> None:
    described = [pool_of("raft-stereo", tmp_path / place).describe() for place in ("here", "there")]
    assert described[0] == described[1]
    (tmp_path / "here" / "checkout" / "core" / "parts.py").write_text(NETWORK + "# changed\n")
    entry = architecture("raft-stereo")
    options = entry.resolve({"root": str(tmp_path / "here" / "checkout")})
    assert entry.version_of(options) != described[0]["version"]


def test_the_configuration_says_how_images_become_input(tmp_path: Path) -> None:
    inputs = architecture("openstereo").inputs(
        {"root": str(openstereo(tmp_path)), "cfg": "lightstereo/s.yaml"}
    )
    assert inputs == sfkit.InputConvention(1 / 255, (0.5,) * 3, (0.25,) * 3, 16, sfkit.PadSides.TOP_RIGHT)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "the option root is missing, expected your checkout of XiandaGuo/OpenStereo"),
        ({"root": "{root}", "cfg": "gone.yaml"}, r"gone\.yaml: no such file"),
        ({"root": "{root}", "cfg": "sttr.yaml"}, "OpenStereo's STTR is not offered"),
    ],
)
def test_openstereo_refusals(options: dict[str, str], message: str, tmp_path: Path) -> None:
    root = str(openstereo(tmp_path))
    filled = {key: value.format(root=root) for key, value in options.items()}
    entry = architecture("openstereo")
    with pytest.raises(InputError, match=message):
        entry.build(**entry.resolve(filled))


@pytest.mark.parametrize(
    ("calling", "output"),
    [
        (Calling(output="last"), lambda d: [d * 0, d]),
        (Calling(output="first"), lambda d: (d, None)),
        (Calling(output="key:disp"), lambda d: {"disp": d[:, None]}),
        (Calling(output=("last", "negated")), lambda d: [torch.stack([-d, d * 0], 1)]),
        (Calling(output="fraction"), lambda d: d / 32),
        (Calling(resolution=4), lambda d: d[:, ::4, ::4] / 4),
    ],
)
def test_outputs(calling: Calling, output: Callable[[torch.Tensor], object]) -> None:
    disparity = torch.full((1, 16, 32), 5.0)
    images = torch.zeros(1, 3, 16, 32)
    torch.testing.assert_close(calling.call(lambda *_: output(disparity), images, images), disparity)


def test_unknown_words_are_refused() -> None:
    with pytest.raises(InputError, match=r"unknown step of a network's output 'negative'.*'negated'"):
        Calling(output="negative")
    with pytest.raises(InputError, match="unknown form of a network's input"):
        Calling(form="dict")
    with pytest.raises(InputError, match="resolution is 0"):
        Calling(resolution=0)


def test_digests_leave_hidden_folders_out(tmp_path: Path) -> None:
    write(tmp_path, {"a.py": "1", ".venv/b.py": "2"})
    before = tree_digest(tmp_path)
    write(tmp_path, {".venv/b.py": "3"})
    assert tree_digest(tmp_path) == before
