"""Whatever bytes a file holds, its reader answers or says one sentence: only InputError comes out.

``SFKIT_FUZZ`` says how many examples each parser gets: 50, and 2,000 in ``make soak``.
"""

from __future__ import annotations

import contextlib
import json
import os
import struct
import tempfile
import warnings
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st
from safetensors.torch import save

from sfkit.checkpoints.reading import read_checkpoint
from sfkit.checkpoints.spec import read_pool_spec
from sfkit.checkpoints.stored import stored_file
from sfkit.datasets.calibration import read_calibration
from sfkit.datasets.formats import read_disparity
from sfkit.datasets.manifests import read_manifest
from sfkit.datasets.tables import find_in_table
from sfkit.errors import InputError
from sfkit.merging import Recipe
from sfkit.merging.origin import read_origin, read_recipe
from sfkit.outside import read_toml
from sfkit.search.runs import read_run

EXAMPLES = int(os.environ.get("SFKIT_FUZZ", "50"))
POOL = b"""name = "garage"
architecture = "anynet"
[options]
ranges = [12, 3, 3]
[base]
file = "base.tar"
[sources.a]
file = "a.tar"
[blocks]
all = ["*"]
"""
MANIFEST = b"""name = "mine"
title = "Mine"
family = "eth3d"
home = "x"
get = "x"
licence = "x"
citation = "x"
metric = "bad-1.0"
ids = {format = "{:06d}_10", count = 3}
[[layout]]
left = "{id}/im0.png"
right = "{id}/im1.png"
disparity = "{id}/d.pfm"
coding = "pfm"
"""
PFM = b"Pf\n2 2\n-1.0\n" + struct.pack("<4f", 1, 2, 3, 4)
TIME = "2026-11-29T01:00:00"
JOURNAL = b"\n".join(
    json.dumps(record).encode()
    for record in (
        {"event": "start", "search": "subset", "time": TIME, "sources": ["a"], "blocks": ["x"]},
        {"event": "generation", "search": "subset", "time": TIME, "generation": 0, "best": None,
         "counts": {}, "candidates": [], "population": []},
        {"event": "end", "search": "subset", "time": TIME, "reason": "all"},
    )
)  # fmt: skip


def png() -> bytes:
    return bytes(cv2.imencode(".png", np.arange(12, dtype=np.uint16).reshape(3, 4))[1])


def torch_file(*, archive: bool = True) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        content = {"state_dict": {"w": torch.zeros(2)}, "step": 3}
        torch.save(content, Path(folder) / "x.pth", _use_new_zipfile_serialization=archive)
        return (Path(folder) / "x.pth").read_bytes()


def npy() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        np.save(Path(folder) / "x.npy", np.ones((3, 4), np.float32))
        return (Path(folder) / "x.npy").read_bytes()


def table(path: Path) -> object:
    return find_in_table(path, path.parent)


def header(path: Path) -> object:
    """As ``show`` reads it, without torch."""
    stored = stored_file(path)
    return stored and (stored.digests(), stored.arrays())


READERS: dict[str, tuple[str, bytes, Callable[[Path], object]]] = {
    "pool": ("pool.toml", POOL, read_pool_spec),
    "toml": ("x.toml", POOL, read_toml),
    "manifest": ("mine.toml", MANIFEST, read_manifest),
    "recipe": ("r.json", Recipe.equal(["a", "b"], ["x", "y"]).to_json().encode(), read_recipe),
    "journal": ("journal.jsonl", JOURNAL, lambda path: read_run(path.parent)),
    "csv": ("t.csv", b"left,right,disparity\na.png,b.png,c.pfm\n", table),
    "pfm": (
        "d.pfm",
        b"Pf\n2 2\n-1.0\n" + struct.pack("<4f", 1, 2, 3, 4),
        lambda path: read_disparity(path, "pfm"),
    ),
    "png16": ("d.png", png(), lambda path: read_disparity(path, "png16")),
    "npy": ("d.npy", npy(), lambda path: read_disparity(path, "npy")),
    "calibration": (
        "calib.txt",
        b"cam0=[7e2 0 0; 0 7e2 0; 0 0 1]\ndoffs=0\nbaseline=100\n",
        read_calibration,
    ),
    "kitti": (
        "calib.txt",
        b"S_rect_02: 1242 375\nP2: 7e2 0 6e2 4e1 0 7e2 1e2 0 0 0 1 0\nP3: 7e2 0 6e2 -3 0 7e2 1e2 0 0 0 1 0\n",
        read_calibration,
    ),
    "k": ("K.txt", b"7e2 0 3e2 0 7e2 2e2 0 0 1\n0.5\n", read_calibration),
    "safetensors": ("x.safetensors", save({"w": torch.zeros(2)}, {"sfkit.recipe": "{}"}), read_origin),
    "header": ("x.safetensors", save({"w": torch.zeros(2, 3)}), header),
    "torch": ("x.pth", torch_file(), read_checkpoint),
    "archive": ("x.pth", torch_file(), header),
    "row": ("x.tar", torch_file(archive=False), header),
    "index": ("x.safetensors.index.json", b'{"weight_map": {"w": "x.safetensors"}}', read_checkpoint),
}
WORDS = (
    *(b"[" * 3000, b"9" * 5000, b"\x00", b"\xff\xfe", b"\xef\xbb\xbf", b"-1.0.0", b"NaN", b"1e999"),
    *(b"..", b"{", b"\n", b"true", b"-", b"null", b'"'),
)


@st.composite
def damaged(draw: st.DrawFn, whole: bytes) -> bytes:
    """A sound file with a few bytes cut out, put in or changed; or nothing of it at all."""
    if draw(st.integers(0, 9)) == 0:
        return draw(st.binary(max_size=200))
    content = bytearray(whole)
    for _ in range(draw(st.integers(1, 4))):
        start = draw(st.integers(0, len(content)))
        stop = draw(st.integers(start, min(len(content), start + 40)))
        content[start:stop] = draw(st.one_of(st.binary(max_size=12), st.sampled_from(WORDS)))
    return bytes(content)


DAMAGED = {name: damaged(whole) for name, (_, whole, _) in READERS.items()}


@pytest.mark.parametrize("reader", READERS)
@settings(max_examples=EXAMPLES, database=None)
@given(data=st.data())
def test_only_sentences_come_out(
    reader: str, data: st.DataObject, tmp_path_factory: pytest.TempPathFactory
) -> None:
    name, _, read = READERS[reader]
    folder = tmp_path_factory.getbasetemp() / reader  # one for all examples: making one takes longer
    folder.mkdir(exist_ok=True)
    (folder / name).write_bytes(data.draw(DAMAGED[reader]))
    with warnings.catch_warnings(), contextlib.suppress(InputError):
        warnings.simplefilter("ignore")
        read(folder / name)


@pytest.mark.parametrize(
    "reader", [name for name in READERS if name not in ("pool", "index", "csv", "safetensors")]
)
def test_the_whole_file_is_read(reader: str, tmp_path: Path) -> None:
    """The sound file of each, those left out that name other files."""
    name, whole, read = READERS[reader]
    (tmp_path / name).write_bytes(whole)
    read(tmp_path / name)
