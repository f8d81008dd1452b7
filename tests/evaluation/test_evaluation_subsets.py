"""Every subset of the real sources, scored by sfkit and by plain torch code that shares AnyNet alone."""

from __future__ import annotations

import json
from itertools import combinations
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
import torch.nn.functional as F
from numpy.typing import NDArray

from sfkit.architectures.anynet import AnyNet, Route
from sfkit.cli import main

POOL = Path(__file__).parents[1] / "pools" / "anynet_real.toml"
FILES = {
    "kitti2012": "ft_kitti2012_official.tar",
    "kitti2015": "ft_kitti2015_official.tar",
    "hamza": "ft_kitti2015_hamza.tar",
    "hamza_new": "ft_kitti2015_hamza_new.tar",
}
State = dict[str, torch.Tensor]


def read_state(path: Path) -> State:
    """The floating-point tensors of a training script's file, without DataParallel's prefix."""
    state = torch.load(path, map_location="cpu", weights_only=True)["state_dict"]
    return {
        key.removeprefix("module."): tensor for key, tensor in state.items() if tensor.is_floating_point()
    }


def average(states: list[State]) -> State:
    """Eq. 4: base + mean of (source - base) is the mean of the sources."""
    return {key: torch.stack([state[key].double() for state in states]).mean(0).float() for key in states[0]}


def image(path: Path) -> torch.Tensor:
    """(1, 3, H, W), normalised as ImageNet is, then edge-padded below and on the right to multiples of 16."""
    rgb = cv2.cvtColor(cv2.imread(str(path), cv2.IMREAD_COLOR), cv2.COLOR_BGR2RGB)
    scaled = (rgb / 255.0 - [0.485, 0.456, 0.406]) / [0.229, 0.224, 0.225]
    planes = torch.tensor(scaled.transpose(2, 0, 1)[None], dtype=torch.float32)
    return F.pad(planes, (0, -planes.shape[3] % 16, 0, -planes.shape[2] % 16), mode="replicate")


def ground_truth(path: Path) -> NDArray[np.float32]:
    """A little-endian PFM, whose rows begin at the bottom."""
    with path.open("rb") as file:
        assert file.readline().strip() == b"Pf"
        width, height = map(int, file.readline().split())
        assert float(file.readline()) < 0
        return np.frombuffer(file.read(), "<f4").reshape(height, width)[::-1]


@torch.inference_mode()
def plain_scores(data: Path) -> dict[str, float]:
    """bad-1.0 in percent where the truth is below 512 px, by the subset's names."""
    left, right = (image(data / f"two_view_training/playground/im{side}.png") for side in (0, 1))
    truth = ground_truth(data / "two_view_training_gt/playground/disp0GT.pfm")
    height, width = truth.shape
    valid = np.isfinite(truth) & (truth > 0) & (truth < 512)
    states = {name: read_state(data.parent / "anynet" / file) for name, file in FILES.items()}
    network = AnyNet().eval()
    network.use_route(Route.PLAIN)
    found = {}
    for size in (2, 3, 4):
        for names in combinations(FILES, size):
            network.load_state_dict(average([states[n] for n in names]), strict=True)
            disparity = network(left, right)[0, :height, :width].numpy()
            off = np.abs(disparity[valid].astype(np.float64) - truth[valid]) > 1.0
            found["+".join(names)] = 100.0 * float(off.mean())
    return found


def test_all_subsets_agree_with_an_independent_merge(
    real_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("SFKIT_REAL_DATA", str(real_data))
    monkeypatch.chdir(tmp_path)
    options = ["--benchmark", "eth3d", "--root", str(real_data / "eth3d"), "--protocol", "raft"]
    with pytest.raises(SystemExit, match=r"^0$"):
        main(["evaluate", str(POOL), "--all-subsets", *options, "--metric", "bad-1.0", "--json"])
    out, errors = capsys.readouterr()
    assert "warning" not in errors
    scores = {row["network"]: row["score"] for row in json.loads(out)["scores"]}

    plain = plain_scores(real_data / "eth3d")

    assert len(plain) == 11
    assert scores == pytest.approx(plain, abs=0.01, rel=0)
    assert max(plain.values()) - min(plain.values()) > 1, "the subsets differ by far more than the tolerance"
