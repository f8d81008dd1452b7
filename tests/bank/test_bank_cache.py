"""Rendered pairs on disk: kept whole, and rendered again where a file is torn."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from sfkit.bank import rendered
from sfkit.bank.rendered import RenderedPair
from sfkit.datasets.pairs import Sample


def fresh(pair: RenderedPair) -> Sample:
    rendered._render.cache_clear()
    return pair.load()


def test_a_pair_comes_back_bit_for_bit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SFKIT_CACHE", str(tmp_path))
    pair = RenderedPair("courtyard", 3)
    first = fresh(pair)
    monkeypatch.setattr(rendered, "synthetic_pair", None)
    again = fresh(pair)
    for name in ("left", "right", "disparity", "nonoccluded"):
        one, other = getattr(first, name), getattr(again, name)
        assert one.dtype == other.dtype
        assert np.array_equal(one, other, equal_nan=one.dtype.kind == "f")
    assert again.id == "courtyard-03"


def test_a_torn_file_is_rendered_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SFKIT_CACHE", str(tmp_path))
    pair = RenderedPair("courtyard", 3)
    first = fresh(pair)
    (kept,) = tmp_path.glob("rendered/*.npz")
    data = kept.read_bytes()
    for damaged in (data[: len(data) // 2], b"", b"no archive"):
        kept.write_bytes(damaged)
        assert np.array_equal(fresh(pair).left, first.left)
        assert kept.read_bytes() == data
