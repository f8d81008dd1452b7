"""A small factory.toml on the bank's domains, and the base it starts from."""

from __future__ import annotations

from pathlib import Path

from sfkit import bank

TEXT = """
name = "small"
base = "base.safetensors"
architecture = "anynet"
joint = {joint}

[options]
ranges = [4, 3, 3]
spn = false

[training]
epochs = 2
batch = 2
rate = 1e-4
save_every = 1
workers = 0
augmentation = {{ crop = [64, 128] }}

{sources}
[validation]
name = "bank:courtyard"
pairs = 1

[[tests]]
name = "bank:grey-workshop"
pairs = 1

[search]
population = 4
generations = 1
evaluations = 0
"""


def write(folder: Path, *names: str, joint: bool = False, rate: str = "") -> Path:
    (folder / "base.safetensors").write_bytes((bank.pool_path().parent / "base.safetensors").read_bytes())
    sources = "".join(
        f'[sources.{name}]\ndata = "bank:{name}"\npairs = 2\n{rate if name == "haze" else ""}\n'
        for name in names
    )
    path = folder / "factory.toml"
    path.write_text(TEXT.format(sources=sources, joint=str(joint).lower()))
    return path
