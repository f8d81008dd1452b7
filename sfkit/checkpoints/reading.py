"""Reading checkpoints: safetensors, whole or in parts, and torch files without pickled code.

One file is open at a time and its tensors are mapped where the format allows, so that the memory a
pool needs does not grow with its number of sources.
"""

from __future__ import annotations

import pickle
import re
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import torch
from safetensors import SafetensorError, safe_open

from sfkit.checkpoints.fingerprints import fingerprint, tensor_digest
from sfkit.checkpoints.headers import INDEX, SAFETENSORS, ensure_checkpoint
from sfkit.checkpoints.inert import load_inert
from sfkit.checkpoints.layouts import Layout, Wrapping, common_prefix, own_texts, unwrap
from sfkit.errors import InputError
from sfkit.files import Signature, is_file, signature
from sfkit.outside import read_json

MAX_INDEX_BYTES = 64 * 2**20


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
        signatures: what each file it was read from looked like then (:func:`sfkit.files.signature`).
    """

    path: Path
    tensors: Mapping[str, torch.Tensor]
    layout: Layout
    metadata: Mapping[str, str] = field(default_factory=dict)
    mapped: bool = True
    signatures: Mapping[Path, Signature] = field(default_factory=dict)


def read_checkpoint(path: str | Path, wrapping: Wrapping | None = None) -> CheckpointFile:
    """Open one checkpoint: a safetensors file or the index of several, or a torch file.

    Objects of unknown classes beside the weights are left out, and none of their code runs.

    Args:
        path: the file.
        wrapping: the container to read; recognised unless given.

    Raises:
        InputError: the file is missing, of another kind, truncated, or holds no state dict.
    """
    path, wrapping = Path(path), wrapping or Wrapping()
    ensure_checkpoint(path)
    looks = {path: signature(path)}  # before it is read: whatever is written meanwhile shows later
    if path.name.endswith(INDEX):
        return _read_shards(path, looks)
    if path.suffix.lower() == SAFETENSORS:
        return replace(_read_safetensors(path), signatures=looks)
    return replace(_read_torch(path, wrapping), signatures=looks)


def _read_safetensors(path: Path) -> CheckpointFile:
    found, metadata = _safe_tensors(path)
    layout = Layout(metadata.get("sfkit.container") or None, common_prefix(found))
    tensors = {key[len(layout.prefix) :]: tensor for key, tensor in found.items()}
    return CheckpointFile(path, tensors, layout, metadata)


def _safe_tensors(path: Path) -> tuple[dict[str, torch.Tensor], dict[str, str]]:
    try:
        with safe_open(path, framework="pt", device="cpu") as file:
            metadata = dict(file.metadata() or {})
            found = {key: file.get_tensor(key) for key in file.keys()}  # noqa: SIM118 (no mapping)
    except (SafetensorError, OSError) as error:
        raise InputError(f"{path}: cannot be read as safetensors ({error}), expected a whole file") from error
    if not found:
        raise InputError(f"{path}: holds no tensors, expected a network's weights")
    return found, metadata


def _read_shards(path: Path, looks: dict[Path, Signature]) -> CheckpointFile:
    """The tensors of all files an index names, which lie beside it."""
    places = _index(path)
    found: dict[str, torch.Tensor] = {}
    for name in sorted(set(places.values())):
        # A path could lead anywhere on the disk.
        if Path(name).name != name:
            raise InputError(f"{path}: names the file {name!r}, expected files of its own folder")
        shard = path.with_name(name)
        if not is_file(shard):
            raise InputError(f"{path}: names {name}, which is not there, expected every part of the network")
        looks[shard] = signature(shard)
        tensors, _ = _safe_tensors(shard)
        twice = next((key for key in tensors if key in found), None)
        if twice is not None:
            raise InputError(f"{shard}: holds {twice!r}, which another part of {path.name} holds as well")
        found |= tensors
    lost = next((key for key in places if key not in found), None)
    if lost is not None:
        raise InputError(
            f"{path}: places {lost!r} in {places[lost]}, where it is not: are the parts of one set?"
        )
    prefix = common_prefix(found)
    tensors = {key[len(prefix) :]: tensor for key, tensor in found.items()}
    return CheckpointFile(path, tensors, Layout(None, prefix), signatures=looks)


def _index(path: Path) -> dict[str, str]:
    if path.stat().st_size > MAX_INDEX_BYTES:
        raise InputError(f"{path}: is {path.stat().st_size} bytes long, expected an index of tensors")
    content = read_json(path, "expected an index of safetensors files")
    places = content.get("weight_map") if isinstance(content, dict) else None
    if not isinstance(places, dict) or not places or not all(isinstance(v, str) for v in places.values()):
        raise InputError(
            f"{path}: has no weight_map of tensor -> file, expected an index of safetensors files"
        )
    return places


def _read_torch(path: Path, wrapping: Wrapping) -> CheckpointFile:
    try:
        mapped = zipfile.is_zipfile(path)  # files from before torch 1.6 are no archives
        content = load_inert(path, mapped=mapped)
    except pickle.UnpicklingError as error:
        raise InputError(_refusal(path, str(error))) from error
    except Exception as error:  # torch interprets the bytes one by one, and raises what that comes to
        reason = _first_sentence(str(error)) or type(error).__name__
        raise InputError(f"{path}: cannot be read ({reason}), expected a whole torch file") from error
    tensors, layout = unwrap(content, path, wrapping.container)
    return CheckpointFile(path, tensors, layout, own_texts(path, content), mapped)


def _refusal(path: Path, message: str) -> str:
    # In torch's own words, which name the code it would run.
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


def content_of(tensors: Mapping[str, torch.Tensor]) -> str:
    """The fingerprint of a file's tensors, whatever wrappers put before their keys."""
    prefix = common_prefix(tensors)
    return fingerprint({key[len(prefix) :]: tensor_digest(tensor) for key, tensor in tensors.items()})
