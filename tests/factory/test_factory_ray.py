"""A factory over a Ray cluster: its trainings end in the same files, wherever they ran."""

from __future__ import annotations

from pathlib import Path

import pytest
from clusters import LEAVES_TO_THE_COLLECTOR, two_nodes
from factory_files import write

import sfkit
from sfkit.factory import read_factory, status, train_missing
from sfkit.factory.standing import DONE, MISSING

pytestmark = [pytest.mark.slow, *LEAVES_TO_THE_COLLECTOR]


def test_sources_are_spread_over_a_cluster(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """One training fails on its machine; the other is kept, and its file is that of one process."""
    monkeypatch.setenv("OMP_NUM_THREADS", "1")
    (tmp_path / "here").mkdir()
    (tmp_path / "there").mkdir()
    here = read_factory(write(tmp_path / "here", "haze"))
    there = read_factory(write(tmp_path / "there", "haze", "far-scene"))
    train_missing(here)
    far = status(there)[1].file
    far.parent.mkdir(parents=True)
    far.with_name(f"{far.stem}.training").write_text("in the way")
    lines: list[str] = []
    with two_nodes() as cluster:
        import ray

        ray.init(address=cluster.address)
        try:
            with pytest.raises(sfkit.SfkitError, match=r"^1 trainings failed: far-scene: "):
                train_missing(there, ray=True, say=lines.append)
        finally:
            ray.shutdown()
    assert lines == ["haze: missing, 2 steps", "far-scene: missing, 2 steps", "haze: done"]
    assert [item.state for item in status(there)] == [DONE, MISSING]
    assert status(there)[0].file.read_bytes() == status(here)[0].file.read_bytes()
