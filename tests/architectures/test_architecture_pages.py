"""The pages about architectures: their pool descriptions open, and their tables are the registry's."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

from sfkit.architectures import architecture
from sfkit.checkpoints import read_pool_spec

DOCS = Path(__file__).parents[2] / "docs"
PAGES = ("nmrf.md", "foundation_stereo.md")


@pytest.mark.parametrize("page", PAGES)
def test_the_pool_description_of_a_page_is_read_and_its_network_built(page: str, tmp_path: Path) -> None:
    (example,) = re.findall(r"```toml\n(.*?)```", (DOCS / page).read_text(encoding="utf-8"), re.DOTALL)
    (tmp_path / "pool.toml").write_text(example, encoding="utf-8")
    spec = read_pool_spec(tmp_path)
    entry = architecture(spec.architecture)
    entry.build(**entry.resolve(spec.options))
    assert len(spec.sources) == 2
    assert spec.base.licence


@pytest.mark.parametrize("page", sorted(path.name for path in (DOCS / "adapters").glob("[!i]*.md")))
def test_the_pool_description_of_an_adapter_names_it_and_its_options(page: str, tmp_path: Path) -> None:
    text = (DOCS / "adapters" / page).read_text(encoding="utf-8")
    (example,) = re.findall(r"```toml\n(.*?)```", text, re.DOTALL)
    (tmp_path / "pool.toml").write_text(example, encoding="utf-8")
    spec = read_pool_spec(tmp_path)
    entry = architecture(spec.architecture)
    assert entry.name == page.removesuffix(".md").replace("_", "-")
    assert set(entry.resolve(spec.options)) == set(entry.defaults)
    told = {
        cell
        for row in re.findall(r"^\| (`.*?) \|", text, re.MULTILINE)
        for cell in re.findall(r"`(\w+)`", row)
    }
    assert told <= set(entry.defaults)


@pytest.mark.parametrize(("name", "column"), [("nmrf-swint", 1), ("nmrf-res", 2)])
def test_the_table_of_blocks_is_the_registrys(name: str, column: int) -> None:
    text = (DOCS / "nmrf.md").read_text(encoding="utf-8")
    rows = [line.strip("|").split(" | ") for line in text.splitlines() if line.startswith("| `")]
    blocks = architecture(name).blocks({})
    assert [row[0].strip(" `") for row in rows] == list(blocks)
    for row, globs in zip(rows, blocks.values(), strict=True):
        cell = row[1] if row[column].strip() == "the same" else row[column]
        assert {f"{prefix}.*" for prefix in re.findall(r"`([\w.]+)`", cell)} == set(globs)
