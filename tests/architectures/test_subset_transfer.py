"""The paper's reuse claim: a subset found on one architecture merges another's sources."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
import torch
from safetensors.torch import load_file, save_file
from tiny import fine_tune, write_pairs, write_pool

from sfkit.architectures import architecture
from sfkit.cli import main


@pytest.fixture(autouse=True)
def _own_cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SFKIT_CACHE", str(tmp_path / "cache"))


def run(capsys: pytest.CaptureFixture[str], *words: object) -> dict[str, Any]:
    """A command's JSON document."""
    with pytest.raises(SystemExit) as left:
        main([*map(str, words), "--json"])
    captured = capsys.readouterr()
    assert left.value.code == 0, captured.err
    document: dict[str, Any] = json.loads(captured.out)
    return document


def second_pool(folder: Path) -> Path:
    """Sources a, b, c again, of NMRF."""
    folder.mkdir()
    with torch.random.fork_rng():
        torch.manual_seed(0)
        base = architecture("nmrf-res").build().state_dict()
    lines = ['name = "second"', 'architecture = "nmrf-res"', "[base]", 'file = "base.safetensors"']
    save_file(base, folder / "base.safetensors")
    for number, name in enumerate("abc", 1):
        save_file(fine_tune(base, number), folder / f"{name}.safetensors")
        lines += [f"[sources.{name}]", f'file = "{name}.safetensors"']
    (folder / "pool.toml").write_text("\n".join(lines))
    return folder


def test_a_subset_found_on_one_pool_merges_the_sources_of_that_name_of_others(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = write_pool(tmp_path / "anynet")
    wider = tmp_path / "anynet" / "wider.toml"
    wider.write_text(first.read_text().replace("ranges = [4, 3, 3]", "ranges = [6, 2, 2]"))
    data = ("-b", "pairs", "-r", write_pairs(tmp_path / "pairs", 1), "--yes")
    stage1 = ("--largest", 2, "--population", 3, "--generations", 1, "--evaluations", 0)
    found = run(capsys, "search", first, *data, *stage1, "-o", tmp_path / "found")
    subset = found["subset"]
    assert len(subset) == 2

    merged = tmp_path / "found" / "merged.safetensors"
    stage2 = ("--evaluations", 4, "--subset-from", merged)
    reused = run(capsys, "search", wider, *data, *stage2, "-o", tmp_path / "reused")
    assert reused["subset"] == subset
    assert found["stage1"] is not None
    assert reused["stage1"] is None

    other, written = second_pool(tmp_path / "nmrf"), tmp_path / "second.safetensors"
    run(capsys, "merge", other, "--subset-from", tmp_path / "found" / "recipe.json", "-o", written)
    sources = [load_file(other / f"{name}.safetensors") for name in subset]
    for key, value in load_file(written).items():
        if key.endswith(".weight"):
            mean = (sources[0][key].double() + sources[1][key].double()) / 2
            assert torch.allclose(value.double(), mean, atol=1e-6), key
