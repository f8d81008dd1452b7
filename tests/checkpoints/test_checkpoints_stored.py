"""What is told of a checkpoint without torch is what torch tells of it, or nothing."""

from __future__ import annotations

from argparse import Namespace
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import save_file

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
