"""Networks of users' own for tests: files and packages written into a folder, and pools of them."""

from __future__ import annotations

from pathlib import Path

import torch
from safetensors.torch import save_file

# Disparity from 4 candidates by how alike the two views are under each; two blocks that matter.
NETWORK = """
import torch
from torch import nn

class MyNet(nn.Module):
    def __init__(self, levels=4):
        super().__init__()
        self.features = nn.Conv2d(3, 4, 3, padding=1)
        self.head = nn.Conv2d(levels, levels, 1)

    def forward(self, left, right):
        a, b = self.features(left), self.features(right)
        levels = self.head.weight.shape[0]
        costs = [(a - torch.roll(b, 2 * d, -1)).abs().mean(1) for d in range(levels)]
        shares = torch.softmax(-8 * self.head(torch.stack(costs, 1)), 1)
        steps = 2.0 * torch.arange(levels, dtype=shares.dtype)
        return (shares * steps[:, None, None]).sum(1)
"""
REGISTER = """
import sfkit
sfkit.register_architecture(
    "my-net", blocks={"features": ["features.*"], "head": ["head.*"]}
)(MyNet)
"""


def write_states(folder: Path, prefix: str = "") -> None:
    """base, a and b: random weights of the network, the sources moved a little from the base."""
    folder.mkdir(parents=True, exist_ok=True)
    generator = torch.Generator().manual_seed(3)
    base = {
        "features.weight": torch.randn(4, 3, 3, 3, generator=generator) * 0.3,
        "features.bias": torch.zeros(4),
        "head.weight": torch.eye(4)[..., None, None].contiguous(),
        "head.bias": torch.zeros(4),
    }
    for name in ("base", "a", "b"):
        moved = {
            prefix + key: value + 0.05 * torch.randn(value.shape, generator=generator) * (name != "base")
            for key, value in base.items()
        }
        save_file(moved, folder / f"{name}.safetensors")


def write_pool(folder: Path, head: str, options: str = "") -> Path:
    """A pool of these states whose ``pool.toml`` begins as given."""
    table = f"[options]\n{options}\n" if options else ""
    text = f'name = "own"\n{head}\n{table}[base]\nfile = "base.safetensors"\n'
    text += '[sources.a]\nfile = "a.safetensors"\n[sources.b]\nfile = "b.safetensors"\n'
    (folder / "pool.toml").write_text(text, encoding="utf-8")
    return folder / "pool.toml"


def decorated(folder: Path) -> Path:
    """A pool whose module registers the network."""
    (folder / "net.py").write_text(NETWORK + REGISTER)
    return write_pool(folder, 'architecture = "my-net"\nmodule = "net.py"')


def plain(folder: Path) -> Path:
    """A pool that names a class of a file beside it."""
    (folder / "plain_net.py").write_text(NETWORK)
    return write_pool(folder, 'architecture = "plain_net:MyNet"')


def package(folder: Path) -> Path:
    """A pool of a network that an installed package declares as an entry point."""
    site = folder / "site"
    info = site / "stereo_lab-1.0.dist-info"
    info.mkdir(parents=True)
    (site / "stereo_lab.py").write_text(NETWORK + REGISTER.replace("my-net", "lab-net"))
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: stereo-lab\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text("[sfkit.architectures]\nlab-net = stereo_lab\n")
    return write_pool(folder, 'architecture = "lab-net"')
