"""Reading checkpoints: every layout in use, and a sentence for everything that is none."""

from __future__ import annotations

import pickle
import re
from pathlib import Path

import pytest
import torch
from safetensors.torch import save_file

from sfkit.checkpoints.layouts import Layout
from sfkit.checkpoints.reading import read_checkpoint
from sfkit.checkpoints.spec import read_pool_spec
from sfkit.errors import InputError

STATE = {"a.weight": torch.arange(6.0).reshape(2, 3), "a.num_batches_tracked": torch.tensor(3)}
PREFIXED = {f"module.{key}": tensor for key, tensor in STATE.items()}


class Opaque:
    """Something whose reading would run code."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (print, ("code ran",))


@pytest.mark.parametrize("container", ["state_dict", "model_state", "model_state_dict", "model", None])
@pytest.mark.parametrize("prefix", ["", "module."])
@pytest.mark.parametrize("suffix", [".pth", ".pt", ".ckpt", ".tar"])
@pytest.mark.parametrize("archive", [True, False])
def test_layouts(tmp_path: Path, container: str | None, prefix: str, suffix: str, archive: bool) -> None:
    state = {prefix + key: tensor for key, tensor in STATE.items()}
    content = {container: state, "epoch": 1, "optimizer": {"state": {}}} if container else state
    path = tmp_path / f"x{suffix}"
    torch.save(content, path, _use_new_zipfile_serialization=archive)
    file = read_checkpoint(path)
    assert file.layout == Layout(container, prefix, beside={"epoch": 1} if container else {})
    assert file.mapped is archive
    assert file.tensors.keys() == STATE.keys()
    assert all(torch.equal(file.tensors[key], STATE[key]) for key in STATE)


def test_safetensors(tmp_path: Path) -> None:
    save_file(PREFIXED, tmp_path / "x.safetensors", metadata={"made": "here"})
    file = read_checkpoint(tmp_path / "x.safetensors")
    assert file.layout.prefix == "module."
    assert file.metadata["made"] == "here"
    assert torch.equal(file.tensors["a.weight"], STATE["a.weight"])


def test_code_beside_the_weights_does_not_run(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    torch.save({"state_dict": STATE, "args": Opaque()}, tmp_path / "x.pth")
    assert read_checkpoint(tmp_path / "x.pth").tensors.keys() == STATE.keys()
    assert "code ran" not in capsys.readouterr().out


def test_a_plain_pickle_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x.pth").write_bytes(pickle.dumps(Opaque(), protocol=2))
    with pytest.raises(InputError, match=r"x\.pth"):
        read_checkpoint(tmp_path / "x.pth")


@pytest.mark.parametrize("share", [0.0, 0.02, 0.3, 0.7, 0.999])
@pytest.mark.parametrize("suffix", [".pth", ".tar", ".safetensors"])
def test_truncated_files(tmp_path: Path, share: float, suffix: str) -> None:
    path = tmp_path / f"x{suffix}"
    big = {"a.weight": torch.randn(400, 50)}
    if suffix == ".safetensors":
        save_file(big, path)
    else:
        torch.save(big, path, _use_new_zipfile_serialization=suffix == ".pth")
    data = path.read_bytes()
    path.write_bytes(data[: int(len(data) * share)])
    with pytest.raises(InputError, match=re.escape(str(path))):
        read_checkpoint(path)


def test_whatever_a_torch_file_begins_with_is_refused_in_a_sentence(tmp_path: Path) -> None:
    """Found by the soak: the letter X alone is a text whose length is missing, a struct.error of torch's."""
    path = tmp_path / "x.pth"
    for first in range(256):
        path.write_bytes(bytes([first]))
        with pytest.raises(InputError, match=re.escape(str(path))):
            read_checkpoint(path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ({"epoch": 3, "loss": 0.5}, "found a dictionary with epoch, loss, expected a state dict"),
        ([1, 2], "found a list, expected a state dict"),
        ({}, "found an empty dictionary, expected a state dict"),
    ],
)
def test_no_state_dict(tmp_path: Path, content: object, message: str) -> None:
    torch.save(content, tmp_path / "x.pth")
    with pytest.raises(InputError, match=message):
        read_checkpoint(tmp_path / "x.pth")


def test_a_missing_file_suggests_its_neighbour(tmp_path: Path) -> None:
    torch.save(STATE, tmp_path / "kitti.pth")
    with pytest.raises(InputError, match=r"did you mean 'kitti\.pth'"):
        read_checkpoint(tmp_path / "kiti.pth")


POOL = """
name = "p"
architecture = "anynet"
[base]
file = "base.pth"
[sources.a]
file = "a.pth"
"""


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("name = ", "not TOML"),
        (POOL.replace('name = "p"', ""), "the key name is missing"),
        (POOL.replace('"p"', "3"), "name is 3, expected text"),
        (POOL.replace("architecture", "architectur"), "unknown key of .*did you mean 'architecture'"),
        (POOL.replace("[sources.a]", "[sources.a]\nlicense = 'x'"), "did you mean 'licence'"),
        (POOL.replace('"a.pth"', '"../../a.pth"'), "leaves the root"),
        (POOL.replace('"a.pth"', '"/etc/passwd"'), "leaves the root"),
        (POOL.replace("[base]", 'root = "gone"\n[base]'), "is no folder"),
        (POOL.replace("[base]", 'root = "${SFKIT_NOT_SET}"\n[base]'), "SFKIT_NOT_SET, which is not set"),
        (POOL.replace('[sources.a]\nfile = "a.pth"', ""), r"the table \[sources\] is missing"),
        (POOL.replace("[sources.a]", '[sources."a b"]'), "source name 'a b'"),
        (POOL + "[blocks]\nhead = 3\n", "blocks.head is 3"),
        (POOL.replace("[sources.a]\nfile", "[sources]\na"), "expected a table with file and licence"),
    ],
)
def test_pool_descriptions_are_checked(tmp_path: Path, text: str, message: str) -> None:
    (tmp_path / "pool.toml").write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_pool_spec(tmp_path / "pool.toml")
    assert str(tmp_path / "pool.toml") in str(caught.value)


def test_a_link_that_lies_under_the_root_is_followed(tmp_path: Path) -> None:
    (tmp_path / "pool").mkdir()
    torch.save(STATE, tmp_path / "a.pth")
    (tmp_path / "pool" / "a.pth").symlink_to(tmp_path / "a.pth")
    (tmp_path / "pool" / "pool.toml").write_text(POOL)
    spec = read_pool_spec(tmp_path / "pool")
    assert tmp_path / "pool" / "a.pth" in [member.path for member in (spec.base, *spec.sources)]
