"""A factory of a network of the user's: its code is asked for, and the pool that is made names it."""

from __future__ import annotations

from pathlib import Path

import pytest
from factory_files import write
from own_networks import NETWORK, REGISTER, write_states

import sfkit
from sfkit.architectures import code
from sfkit.architectures.registry import _REGISTRY
from sfkit.checkpoints.spec import read_pool_spec
from sfkit.errors import InputError
from sfkit.factory import read_factory
from sfkit.factory.running import pool_toml

WAYS = {
    "module": ('"my-net"\nmodule = "nets/net.py"', "nets/net.py", NETWORK + REGISTER),
    "class": ('"factory_net:MyNet"', "factory_net.py", NETWORK),
}


@pytest.mark.parametrize("way", WAYS)
def test_the_pool_that_a_factory_makes_names_the_code(
    way: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv(code.TRUST, "")
    monkeypatch.setenv(code.CONFIG, str(tmp_path / "config"))
    architecture, file, text = WAYS[way]
    path = write(tmp_path, "haze")
    options = "ranges = [4, 3, 3]\nspn = false"
    told = path.read_text().replace(options, "levels = 4").replace('"anynet"', architecture)
    path.write_text(told.replace("joint = false\n", 'joint = false\nout = "made"\n'))
    (tmp_path / file).parent.mkdir(exist_ok=True)
    (tmp_path / file).write_text(f"{text}# {tmp_path}\n")
    with pytest.raises(InputError, match=r"net\.py: .*would run that code.*--trust-code"):
        read_factory(path)
    sfkit.trust_code(tmp_path / file)
    factory = read_factory(path)

    write_states(tmp_path)
    made = tmp_path / "made" / "pool.toml"
    made.parent.mkdir()
    made.write_text(pool_toml(factory))
    source = read_pool_spec(made).sources[0].path
    source.parent.mkdir(parents=True)
    source.write_bytes((tmp_path / "a.safetensors").read_bytes())
    _REGISTRY.pop(factory.architecture)  # as in another process
    pool = sfkit.open_pool(made)
    assert pool.names == ("haze",)
    assert pool.architecture.code is not None
    assert pool.architecture.code.path == tmp_path / file
