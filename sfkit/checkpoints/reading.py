"""Reading checkpoints: safetensors, and torch files without pickled code.

One file is open at a time and its tensors are mapped where the format allows, so that the memory a
pool needs does not grow with its number of sources.
"""

from __future__ import annotations

import json
import pickle
import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open

from sfkit.checkpoints.layouts import OWN, Layout, common_prefix, unwrap
from sfkit.errors import InputError, nearest

TORCH_SUFFIXES = (".pth", ".pt", ".ckpt", ".tar")
SUFFIXES = (".safetensors", *TORCH_SUFFIXES)


@dataclass(frozen=True)
class CheckpointFile:
    """One checkpoint as read from disk.

    Attributes:
        path: the file.
        tensors: bare key (no ``module.``) -> CPU tensor, mapped from the file where possible; do not
            write to them.
        layout: how the file wraps its tensors.
        metadata: the text entries of a safetensors header (how sfkit made it, if it did).
        mapped: whether the tensors are pages of the file rather than copies in memory.
    """

    path: Path
    tensors: Mapping[str, torch.Tensor]
    layout: Layout
    metadata: Mapping[str, str] = field(default_factory=dict)
    mapped: bool = True


def read_checkpoint(path: str | Path) -> CheckpointFile:
    """Open one checkpoint.

    Raises:
        InputError: the file is missing, of another kind, truncated, holds no state dict, or needs
            pickled code to be read.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected a checkpoint{_nearest_file(path)}")
    if path.suffix == ".safetensors":
        return _read_safetensors(path)
    if path.suffix in TORCH_SUFFIXES:
        return _read_torch(path)
    raise InputError(f"{path}: found the ending {path.suffix!r}, expected one of {', '.join(SUFFIXES)}")


def _nearest_file(path: Path) -> str:
    if not path.parent.is_dir():
        return f" (its folder {path.parent} does not exist)"
    return nearest(path.name, (p.name for p in path.parent.iterdir() if p.suffix in SUFFIXES))


def _read_safetensors(path: Path) -> CheckpointFile:
    try:
        with safe_open(path, framework="pt", device="cpu") as file:
            metadata = dict(file.metadata() or {})
            found = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118 (no mapping)
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path}: cannot be read as safetensors ({error}), expected a whole file") from error
    if not found:
        raise InputError(f"{path}: holds no tensors, expected a network's weights")
    layout = Layout(metadata.get("sfkit.container") or None, common_prefix(found))
    tensors = {key[len(layout.prefix) :]: tensor for key, tensor in found.items()}
    return CheckpointFile(path, tensors, layout, metadata)


def _read_torch(path: Path) -> CheckpointFile:
    try:
        mapped = zipfile.is_zipfile(path)  # files from before torch 1.6 are no archives
        content = torch.load(path, map_location="cpu", weights_only=True, mmap=mapped)
    except pickle.UnpicklingError as error:
        raise InputError(_refusal(path, str(error))) from error
    except (
        RuntimeError,
        EOFError,
        OSError,
        ValueError,
        KeyError,
        IndexError,
        AttributeError,
        TypeError,
    ) as error:
        reason = _first_sentence(str(error)) or type(error).__name__
        raise InputError(f"{path}: cannot be read ({reason}), expected a whole torch file") from error
    tensors, layout = unwrap(content, path)
    return CheckpointFile(path, tensors, layout, _own_metadata(path, content), mapped)


def _own_metadata(path: Path, content: object) -> dict[str, str]:
    """What :mod:`sfkit.checkpoints.writing` put beside the weights of a torch file."""
    held = content.get(OWN) if isinstance(content, Mapping) else None
    if not isinstance(held, str):
        return {}
    try:
        values = json.loads(held)
    except json.JSONDecodeError as error:
        raise InputError(f"{path}: its sfkit entry is no JSON ({error}), was it edited?") from error
    return {str(k): str(v) for k, v in values.items()} if isinstance(values, dict) else {}


def _refusal(path: Path, message: str) -> str:
    code = re.search(r"(?:GLOBAL|global) `?([\w.]+)", message)
    if code is None and "Unsupported" not in message and "Weights only" not in message:
        return f"{path}: cannot be read ({_first_sentence(message)}), expected a whole torch file"
    needs = f" ({code.group(1)})" if code and "." in code.group(1) else ""
    return (
        f"{path}: reading it would run pickled code{needs}, which sfkit refuses: load it where you trust it "
        "and save the weights alone with torch.save(network.state_dict(), path)"
    )


def _first_sentence(text: str) -> str:
    """Torch's own messages go on with advice for its developers."""
    return re.split(r"[.!?]\s|\n", text.strip(), maxsplit=1)[0]
