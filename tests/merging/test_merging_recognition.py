"""``pool.toml`` as ``sfkit init`` writes it: whatever files and pools are called, it opens."""

from __future__ import annotations

import os
import tomllib
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from tiny import write_pool

from sfkit.merging import open_pool
from sfkit.merging.recognition import CheckpointFamily, family, pool_toml
from sfkit.outside import is_text, toml_value

NAMES = {
    "a": 'a"]\n[evil]\nx="',
    "b": "base\x7f\\uniform",
    "base": "'''base",
}


def test_hostile_names_make_a_pool_that_opens(tmp_path: Path) -> None:
    write_pool(tmp_path, sources=2).unlink()
    for old, new in NAMES.items():
        (tmp_path / f"{old}.safetensors").rename(tmp_path / f"{new}.safetensors")
    (tmp_path / os.fsdecode(b"caf\xe9.safetensors")).write_bytes(b"")
    (tmp_path / "x\ny.safetensors").write_bytes(b"")
    found = family(tmp_path, "'''base.safetensors")

    text = pool_toml(found, 'pool"\n[sources.x]\n')
    options = "[options]\nspn = false\nranges = [4, 3, 3]\n"  # the tiny networks have no such stage
    (tmp_path / "pool.toml").write_text(text.replace("[base]", f"{options}[base]"), encoding="utf-8")
    pool = open_pool(tmp_path)
    assert pool.name == 'pool"\n[sources.x]\n'
    assert {source.path.name for source in pool.sources} == {
        f"{NAMES[key]}.safetensors" for key in ("a", "b")
    }
    assert len(found.skipped) == 2
    assert all("# left out: " in line for line in text.splitlines() if "caf" in line or "fits no" in line)


@given(st.text(), st.lists(st.text(), max_size=3))
def test_values_are_read_back(text: str, texts: list[str]) -> None:
    """As TOML, by Python's own reader."""
    if all(map(is_text, (text, *texts))):
        found = tomllib.loads(f"a = {toml_value(text)}\nb = {toml_value(texts)}")
        assert found == {"a": text, "b": texts}
    else:
        with pytest.raises(UnicodeEncodeError):
            toml_value([text, *texts])


def test_a_reason_of_several_lines_stays_a_comment(tmp_path: Path) -> None:
    base, source = tmp_path / "base.pth", tmp_path / "a.pth"
    found = CheckpointFamily(
        "anynet", base, (source,), {base: 0.1}, {source: 0.9}, {tmp_path: "no\n[evil]\x00\x7f"}
    )
    assert "evil" not in tomllib.loads(pool_toml(replace(found), "x"))
