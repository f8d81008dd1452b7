"""The picture of docs/how_to/predict.md: the overview that ``sfkit predict --check`` writes of a pair.

.venv/bin/python docs/predicted.py
"""

from __future__ import annotations

from pathlib import Path

import cv2

import sfkit
from sfkit.bank import worlds
from sfkit.bank.plan import MAIN
from sfkit.evaluation.prediction import of_right, overview_of
from sfkit.evaluation.self_check import self_check
from sfkit.merging.network import LoadedNetwork

OUT = Path(__file__).parent / "images" / "predicted.webp"


def main() -> None:
    """Predict the first pair of the bank's validation world by all its sources, mixed equally."""
    pool = sfkit.open_pool(MAIN.name)
    sample = sfkit.open_benchmark(str(worlds(MAIN.name, None)[0])).pairs[0].load()
    inputs = pool.architecture.inputs(pool.options)
    model = LoadedNetwork(pool.merge(pool.uniform()).network, inputs, pool.architecture.name)
    disparity = sfkit.StereoModel(model)(sample.left, sample.right)
    check = self_check(sample.left, sample.right, disparity, of_right(model, sample.left, sample.right))
    picture = overview_of(sample.left, disparity, check.confidence)[..., ::-1]
    if not cv2.imwrite(str(OUT), picture, [cv2.IMWRITE_WEBP_QUALITY, 90]):
        raise OSError(f"{OUT}: cannot be written")
    print(f"{OUT.name}: census {check.residual:.1f} %, {100 * check.consistent:.0f} % consistent")


if __name__ == "__main__":
    main()
