"""Writing a merged network so that it loads in the code the user trained with, and says how it was made."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

import torch
from safetensors import SafetensorError
from safetensors.torch import save_file

from sfkit.checkpoints.layouts import OWN, Layout
from sfkit.checkpoints.targets import FileForm, check_target
from sfkit.errors import InputError, member_of
from sfkit.files import writing


def write_checkpoint(
    path: str | Path,
    state: Mapping[str, torch.Tensor],
    *,
    layout: Layout,
    metadata: Mapping[str, str],
    form: FileForm | str = FileForm.SAFETENSORS,
    overwrite: bool = False,
) -> Path:
    """Write tensors under the original checkpoint's key names, with metadata, in one atomic step.

    Args:
        path: ``.safetensors``, or a torch ending for ``FileForm.ORIGINAL``.
        state: the network's key -> tensor; tensors may share storage.
        layout: the base file's; its names and prefix are put back, and for ``ORIGINAL`` its container with
            the numbers and texts beside it.
        metadata: text entries; the header of a safetensors file, the entry ``sfkit`` of a torch file.
        form: which kind of file.
        overwrite: whether an existing file may be replaced.

    Raises:
        InputError: the file exists and ``overwrite`` is False, its ending does not suit its form, or
            its folder cannot be made.
    """
    path, form = check_target(path, form, overwrite=overwrite), member_of(FileForm, "form", form)
    # safetensors refuses views with gaps.
    tensors = {key: tensor.detach().cpu().contiguous() for key, tensor in state.items()}
    if form is FileForm.SAFETENSORS:
        header = {**metadata, "format": "pt", "sfkit.container": layout.container or ""}
        named = layout.name(_separate(tensors))
        with _full_disk_refused(path), writing(path) as target:
            _save_safetensors(named, target, header)
    else:
        content = layout.wrap({key: _alone(tensor) for key, tensor in tensors.items()})
        if layout.container:  # a bare state dict holds tensors alone: strict loaders refuse a text entry
            content[OWN] = json.dumps(dict(metadata))
        with _full_disk_refused(path), writing(path) as target:
            _save_torch(content, target)
    return path


@contextmanager
def _full_disk_refused(path: Path) -> Iterator[None]:
    """What safetensors and torch say of a disk that is full, in words of their own, as what it is."""
    try:
        yield
    # Both say a full disk in errors of their own.
    except (SafetensorError, RuntimeError) as error:
        reason, free = str(error).partition("\n")[0], shutil.disk_usage(path.parent).free
        raise InputError(
            f"{path}: cannot be written ({reason}; {free / 2**20:.0f} MiB are free): make room, or "
            "name a place on another disk"
        ) from error


def _save_safetensors(tensors: dict[str, torch.Tensor], target: Path, header: dict[str, str]) -> None:
    """One network is one file to the last byte: safetensors writes the text entries in random order."""
    save_file(tensors, target, metadata=header)
    with target.open("r+b") as file:
        length = int.from_bytes(file.read(8), "little")
        entries = json.loads(file.read(length))
        entries["__metadata__"] = dict(sorted(entries["__metadata__"].items()))
        text = json.dumps(entries, separators=(",", ":"), ensure_ascii=False).encode()
        if len(text) <= length:  # the same entries in another order, so that only padding can follow
            file.seek(8)
            file.write(text.ljust(length))


def _save_torch(content: Mapping[str, object], target: Path) -> None:
    """Given a name, torch would write it, which is that of a temporary file, into the archive."""
    with target.open("wb") as file:
        torch.save(content, file)


def _separate(tensors: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
    """For safetensors, which refuses overlapping tensors: a second name of one gets a copy of its own."""
    seen: set[int] = set()
    separate = {}
    for key, tensor in tensors.items():
        # What begins at one address shares its memory.
        place = tensor.data_ptr()
        separate[key] = tensor.clone() if place in seen else tensor
        seen.add(place)
    return separate


def _alone(tensor: torch.Tensor) -> torch.Tensor:
    """For torch, which writes the whole storage a tensor lies in: a part of one gets a storage of its own."""
    return tensor if tensor.untyped_storage().nbytes() == tensor.nbytes else tensor.clone()
