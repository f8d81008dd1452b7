"""The adapter over ``stereo_matching``, against a package of its shape: a registry that families join."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import torch
from own_networks import NETWORK, write_pool, write_states
from safetensors.torch import load_file, save_file
from torch import nn

import sfkit
from sfkit.architectures import architecture
from sfkit.architectures.adapters import installed
from sfkit.errors import InputError

REGISTRY = """
class Registry:
    def __init__(self):
        self.configs, self.models = {}, {}

    def get_config_cls(self, name):
        return self.configs[name]

    def get_model_cls(self, name):
        return self.models[name]()

MODEL_REGISTRY = Registry()
"""
FAMILY = """
from ...registry import MODEL_REGISTRY

class Config:
    mean, std, num_iters = [0.5, 0.5, 0.5], [0.25, 0.25, 0.25], 32

    @classmethod
    def from_variant(cls, variant):
        if variant not in ("raft-stereo", "raft-stereo-realtime"):
            raise ValueError(f"Unknown variant '{variant}'")
        return cls()

def load():
    from .modeling_raft_stereo import RaftStereoModel
    return RaftStereoModel

MODEL_REGISTRY.configs["raft-stereo"], MODEL_REGISTRY.models["raft-stereo"] = Config, load
"""
MODEL = """
class RaftStereoModel(nn.Module):
    def __init__(self, config):
        super().__init__()
        assert config.num_iters == 7
        self.net = MyNet()

    def forward(self, left, right):
        return self.net(left, right)
"""
IMPORTED_WHOLE = "raise ValueError('every family is imported here')"
FILES = {
    "__init__.py": IMPORTED_WHOLE,
    "registry.py": REGISTRY,
    "models/__init__.py": IMPORTED_WHOLE,
    "models/raft_stereo/__init__.py": FAMILY,
    "models/raft_stereo/modeling_raft_stereo.py": NETWORK + MODEL,
    "models/foundation_stereo/__init__.py": IMPORTED_WHOLE,
}


@pytest.fixture
def package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The stand-in, importable, and forgotten after."""
    root = tmp_path / "site" / "stereo_matching"
    for name, text in FILES.items():
        (root / name).parent.mkdir(parents=True, exist_ok=True)
        (root / name).write_text(text)
    monkeypatch.syspath_prepend(str(root.parent))
    installed._classes.cache_clear()
    yield root
    installed._classes.cache_clear()
    for name in [name for name in sys.modules if name.partition(".")[0] == "stereo_matching"]:
        del sys.modules[name]


BLOCKS = '\n[blocks]\nfeatures = ["net.features.*"]\nhead = ["net.head.*"]\n'


def pool_of(folder: Path, prefix: str) -> sfkit.Pool:
    """A pool of the stand-in's networks, its checkpoints with a prefix before their keys."""
    write_states(folder, prefix)
    path = write_pool(
        folder, 'architecture = "stereo-matching"', 'model = "raft-stereo-realtime"\niterations = 7'
    )
    path.write_text(path.read_text() + BLOCKS)
    return sfkit.open_pool(path)


@pytest.mark.parametrize("prefix", ["net.", "", "module.", "module.net."])
def test_the_network_wrapped_is_merged_whatever_its_keys_are_called(
    package: Path, tmp_path: Path, prefix: str
) -> None:
    pool = pool_of(tmp_path, prefix)
    namespace: dict[str, type[nn.Module]] = {}
    exec(NETWORK, namespace)  # noqa: S102 (the network itself, called plainly)
    plain = namespace["MyNet"]()
    plain.load_state_dict({k[len(prefix) :]: t for k, t in load_file(tmp_path / "base.safetensors").items()})
    left, right = torch.rand(2, 1, 3, 64, 96, generator=torch.Generator().manual_seed(1))
    torch.testing.assert_close(
        pool.merge(pool.base_recipe()).disparity(left, right), plain(left, right)[0].detach()
    )
    assert pool.blocks == ("features", "head")


def test_its_configuration_says_the_normalisation_and_no_other_family_is_imported(
    package: Path, tmp_path: Path
) -> None:
    pool = pool_of(tmp_path, "net.")
    inputs = pool.architecture.inputs(pool.options)
    assert inputs == sfkit.InputConvention(1 / 255, (0.5,) * 3, (0.25,) * 3, 32, sfkit.PadSides.CENTRE)
    loaded = {name for name in sys.modules if name.startswith("stereo_matching")}
    assert loaded == {
        f"stereo_matching.{name}"
        for name in ("registry", "models.raft_stereo", "models.raft_stereo.modeling_raft_stereo")
    }


def test_a_changed_package_is_another_version_and_foundation_stereo_is_none_of_it(
    package: Path, tmp_path: Path
) -> None:
    entry = architecture("stereo-matching")
    options = entry.resolve({"iterations": 7})
    before = entry.version_of(options)
    (package / "models/foundation_stereo/__init__.py").write_text("changed")
    assert entry.version_of(options) == before
    (package / "registry.py").write_text(REGISTRY + "# changed\n")
    assert entry.version_of(options) != before


@pytest.mark.parametrize(
    ("model", "message"),
    [
        ("foundation-stereo", "unknown model of stereo_matching 'foundation-stereo', expected one of: aanet"),
        ("raft-stereo-tiny", "Unknown variant 'raft-stereo-tiny'"),
        ("crestereo", "its family 'crestereo' cannot be imported"),
    ],
)
def test_what_it_does_not_have_is_refused(package: Path, model: str, message: str) -> None:
    entry = architecture("stereo-matching")
    with pytest.raises(InputError, match=message):
        entry.build(**entry.resolve({"model": model}))


def test_where_it_is_not_installed_the_extra_is_named(tmp_path: Path) -> None:
    for name in ("base", "a"):
        save_file({"net.features.weight": torch.ones(2, 3)}, tmp_path / f"{name}.safetensors")
    text = 'name = "p"\narchitecture = "stereo-matching"\n'
    text += '[base]\nfile = "base.safetensors"\n[sources.a]\nfile = "a.safetensors"\n'
    (tmp_path / "pool.toml").write_text(text)
    with pytest.raises(InputError, match=r"not installed.*pip install 'sfkit\[stereo-matching\]'"):
        sfkit.open_pool(tmp_path)
