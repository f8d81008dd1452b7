"""A training of the bank that is stopped renders no pair twice."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfkit.bank import training
from sfkit.bank.training import training_pairs
from sfkit.datasets.synthetic import domains, synthetic_pair


def test_pairs_are_rendered_once_and_torn_ones_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    haze, rendered = domains()["haze"], []

    def counting(*arguments: object, **keywords: object) -> object:
        rendered.append(arguments[1])
        return synthetic_pair(*arguments, **keywords)  # type: ignore[arg-type]

    monkeypatch.setattr(training, "synthetic_pair", counting)
    first = training_pairs(haze, 1, tmp_path)
    again = training_pairs(haze, 2, tmp_path)
    assert rendered == [0, 1]
    for name in ("left", "right", "disparity", "nonoccluded"):
        np.testing.assert_array_equal(getattr(again[0], name), getattr(first[0], name))
    torn = next(tmp_path.glob("0001-*.npz"))
    torn.write_bytes(torn.read_bytes()[:1000])
    training_pairs(haze, 2, tmp_path)
    training_pairs(domains()["far-scene"], 1, tmp_path)
    assert rendered == [0, 1, 1, 0], "what is torn, and what is of another world"
