"""What is told of a checkpoint without torch is what torch tells of it, or nothing."""

from __future__ import annotations

import tracemalloc
import zipfile
from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

from sfkit.checkpoints.archives import torch_content
from sfkit.checkpoints.fingerprints import tensor_digest
from sfkit.checkpoints.reading import read_checkpoint
from sfkit.checkpoints.stored import stored_file

TYPES = (torch.float32, torch.float64, torch.bfloat16, torch.float16, torch.int64, torch.uint8, torch.bool)


def assert_as_torch_has_it(path: Path) -> None:
    stored, read = stored_file(path), read_checkpoint(path)
    assert stored is not None
    assert list(stored.places) == list(read.tensors)
    assert stored.layout == read.layout
    assert stored.metadata == read.metadata
    for key, tensor in read.tensors.items():
        assert (stored.places[key].dtype, stored.places[key].shape) == (
            str(tensor.dtype),
            tuple(tensor.shape),
        )
    assert stored.digests() == {key: tensor_digest(tensor) for key, tensor in read.tensors.items()}
    arrays = stored.arrays()
    if arrays is not None:
        assert all(np.array_equal(arrays[key], tensor.numpy()) for key, tensor in read.tensors.items())


@pytest.mark.parametrize("dtype", TYPES)
@pytest.mark.parametrize("kind", ["safetensors", "archive", "row"])
def test_every_type_and_shape(kind: str, dtype: torch.dtype, tmp_path: Path) -> None:
    tensors = {"a": torch.arange(6).reshape(2, 3).to(dtype), "b": torch.zeros((0, 2), dtype=dtype)}
    tensors["c"] = torch.tensor(1).to(dtype)
    path = tmp_path / ("x.safetensors" if kind == "safetensors" else "x.pth")
    if kind == "safetensors":
        save_file(tensors, path)
    else:
        torch.save(tensors, path, _use_new_zipfile_serialization=kind == "archive")
    assert_as_torch_has_it(path)


CONTENTS: dict[str, Callable[[], Any]] = {
    "a state dict of a module": lambda: torch.nn.Linear(3, 2).state_dict(),
    "parameters": lambda: dict(torch.nn.Linear(3, 2).named_parameters()),
    "a container with prefixes, and what lies beside it": lambda: {
        "epoch": 3,
        "name": "x",
        "state_dict": {"module.a": torch.ones(2)},
        "optimizer": {
            "state": {0: {"exp_avg": torch.ones(2)}},
            "param_groups": [{"lr": 1e-4, "betas": (1, 2)}],
        },
    },
    "parts of one storage": lambda: {"a": (whole := torch.arange(12.0))[:4], "b": whole[4:].reshape(2, 4)},
    "what sfkit wrote": lambda: {"sfkit": '{"sfkit.pool": "p"}', "state_dict": {"a": torch.ones(2)}},
    "a long whole number": lambda: {"seed": 2**70, "state_dict": {"a": torch.ones(2)}},
}


@pytest.mark.parametrize("archive", [True, False])
@pytest.mark.parametrize("name", CONTENTS)
def test_what_training_scripts_save(name: str, tmp_path: Path, *, archive: bool) -> None:
    torch.save(CONTENTS[name](), tmp_path / "x.pth", _use_new_zipfile_serialization=archive)
    assert_as_torch_has_it(tmp_path / "x.pth")


class Opaque:
    """Something whose reading would run code."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return (print, ("code ran",))


UNUSUAL: dict[str, Callable[[], Any]] = {
    "an object": lambda: {"args": Namespace(lr=1), "state_dict": {"a": torch.ones(2)}},
    "code": lambda: {"args": Opaque(), "state_dict": {"a": torch.ones(2)}},
    "a type": lambda: {"kind": torch.float32, "state_dict": {"a": torch.ones(2)}},
    "columns in place of rows": lambda: {"a": torch.ones(2, 3).T},
    "a sparse tensor": lambda: {"a": torch.eye(3).to_sparse()},
    "no state dict": lambda: {"epoch": 3},
    "a list": lambda: [torch.ones(2)],
    "a tensor": lambda: torch.ones(2),
}


@pytest.mark.parametrize("archive", [True, False])
@pytest.mark.parametrize("name", UNUSUAL)
def test_what_is_unusual_is_left_to_torch(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], *, archive: bool
) -> None:
    torch.save(UNUSUAL[name](), tmp_path / "x.pth", _use_new_zipfile_serialization=archive)
    assert stored_file(tmp_path / "x.pth") is None
    assert "code ran" not in capsys.readouterr().out


@pytest.mark.parametrize("archive", [True, False])
def test_so_is_a_file_that_is_cut_anywhere(tmp_path: Path, *, archive: bool) -> None:
    path = tmp_path / "x.pth"
    torch.save({"a": torch.arange(6.0)}, path, _use_new_zipfile_serialization=archive)
    whole = path.read_bytes()
    for length in range(0, len(whole), 7):
        path.write_bytes(whole[:length])
        assert stored_file(path) is None


@pytest.mark.parametrize("file", ["base_sceneflow", "ft_own_zakariya", "ft_kitti2015_half_kasatkin"])
def test_real_files_of_both_kinds(file: str, real_data: Path) -> None:
    assert_as_torch_has_it(real_data / "anynet" / f"{file}.tar")


def archive_of(path: Path, pickled: bytes, **entries: bytes) -> Path:
    """An archive as torch's, with these instructions and other content."""
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("x/data.pkl", pickled)
        for name, content in entries.items():
            archive.writestr(f"x/{name.replace('_', '/')}", content)
    return path


STORAGE = b"(X\x07\0\0\0storagectorch\nFloatStorage\nX\x01\0\0\x000X\x03\0\0\0cpuK\x02tQ"
TENSOR = b"ctorch._utils\n_rebuild_tensor_v2\n(" + STORAGE + b"K\0"
REST = b"\x89ccollections\nOrderedDict\n)Rt"  # no gradient, no hooks
SOUND = b"\x80\x02}X\x01\0\0\0a" + TENSOR + b"K\x02\x85K\x01\x85" + REST + b"Rs."
HOSTILE = {
    "a deep key": b"\x80\x02}(" + b")" + b"\x85" * 300_000 + b"K\x01u.",
    "a key that is hashed forever": b"\x80\x02}()" + b"q\0h\0\x86" * 40 + b"K\x01u.",
    "a shape of text": b"\x80\x02}X\x01\0\0\0a"
    + TENSOR
    + b"K\x01\x8a\x05\0\0\0\0\x02X\x0a\0\0\0xxxxxxxxxx\x87K\x01K\x01K\x01\x87"
    + REST
    + b"Rs.",
    "many dimensions": b"\x80\x02}X\x01\0\0\0a"
    + TENSOR
    + 2 * (b"(" + 20_000 * b"K\x02" + b"t")
    + REST
    + b"Rs.",
    "copies of copies": b"\x80\x02ccollections\nOrderedDict\n}(" + b"".join(
        b"J" + n.to_bytes(4, "little") + b"N" for n in range(50_000)
    ) + b"u\x85R." ,
    "a part beyond its storage": SOUND.replace(b"K\x02\x85", b"K\x03\x85"),
    "a place before its storage": SOUND.replace(b"tQK\0", b"tQJ\xff\xff\xff\xff"),
}  # fmt: skip


def test_instructions_are_followed(tmp_path: Path) -> None:
    path = archive_of(tmp_path / "x.pth", SOUND, data_0=np.array([1, 2], "<f4").tobytes())
    stored = stored_file(path)
    assert stored is not None
    arrays = stored.arrays()
    assert arrays is not None
    assert arrays["a"].tolist() == [1.0, 2.0]


@pytest.mark.parametrize("name", HOSTILE)
def test_hostile_instructions_take_neither_time_nor_memory(name: str, tmp_path: Path) -> None:
    assert torch_content(archive_of(tmp_path / "x.pth", HOSTILE[name], data_0=bytes(12))) is None


def test_nothing_is_inflated_and_nothing_read_beyond_the_end(tmp_path: Path) -> None:
    path = archive_of(tmp_path / "x.pth", SOUND, data_0=bytes(8))
    whole = path.read_bytes()
    assert torch_content(path) is not None
    with zipfile.ZipFile(tmp_path / "small.pth", "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("x/byteorder", bytes(1 << 27))
        archive.writestr("x/data.pkl", SOUND)
    tracemalloc.start()
    assert torch_content(tmp_path / "small.pth") is None
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 1 << 24
    at = whole.index(b"x/data/0") - 2  # the length of what stands between a header and its content
    path.write_bytes(whole[:at] + b"\xff\xff" + whole[at + 2 :])
    assert torch_content(path) is None
    size = whole.rindex(b"PK\x01\x02") + 20  # of data/0 in the directory, packed and whole
    path.write_bytes(whole[:size] + 2 * b"\xff\xff\x00\x00" + whole[size + 8 :])
    assert torch_content(path) is None
