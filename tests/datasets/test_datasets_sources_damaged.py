"""Ground truth and cameras of training sets whose files are torn, or say less than they should."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import pytest

from sfkit.datasets import source_cameras
from sfkit.datasets.source_codings import read_source_disparity
from sfkit.errors import InputError


@pytest.mark.parametrize("name", ["header.npy", "group.dsp5", "torn.jgz", "short.jgz"])
def test_damaged_ground_truth_and_cameras_are_refused_in_a_sentence(name: str, tmp_path: Path) -> None:
    """Each raised what its reader's library raises, which was no sentence."""
    if name.endswith("jgz"):
        left = tmp_path / "train" / "s" / "0.png"
        file = tmp_path / "train" / "frame_annotations_train.jgz"
        file.parent.mkdir()
        entries = [
            {"sequence_name": "s", "camera_name": side, "frame_number": 0} for side in ("left", "right")
        ]
        whole = gzip.compress(json.dumps(entries).encode())
        file.write_bytes(whole[:12] + b"\xff" * 20 if name == "torn.jgz" else whole)
        message = "is no gzip file" if name == "torn.jgz" else "found no camera of it"
        with pytest.raises(InputError, match=message):
            source_cameras._dynamic_replica(tmp_path, left, {"split": "train", "sequence": "s", "frame": "0"})
        return
    if name == "group.dsp5":
        import h5py

        with h5py.File(tmp_path / name, "w") as file5:
            file5.create_group("disparity")
    else:
        header = b"{'descr': ((((\n"
        (tmp_path / name).write_bytes(b"\x93NUMPY\x01\x00" + len(header).to_bytes(2, "little") + header)
    with pytest.raises(InputError, match=rf"{name}: (cannot be read|found)"):
        read_source_disparity(tmp_path / name, "dsp5" if name == "group.dsp5" else "depth-npy:80")
