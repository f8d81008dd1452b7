"""The data sources were fine-tuned on: the bank's domains, or benchmarks of one's own by source."""

from __future__ import annotations

from pathlib import Path

import pytest
from tiny import write_pairs

import sfkit
from sfkit.errors import InputError


def test_the_bank_gives_held_out_pairs_of_every_sources_domain() -> None:
    data = sfkit.open_source_data("bank", pairs=2)
    assert tuple(data) == sfkit.open_pool("bank").names
    assert [len(each) for each in data.values()] == [2] * 11
    assert data["haze"].ids == ("haze-00", "haze-01")


def test_ones_own_data_are_named_by_source(tmp_path: Path) -> None:
    root = write_pairs(tmp_path / "own", 3)
    data = sfkit.open_source_data({"a": {"name": "pairs", "root": str(root)}, "b": "bank:courtyard"}, pairs=2)
    assert [(source, each.name, len(each)) for source, each in data.items()] == [
        ("a", "own", 2),
        ("b", "courtyard", 2),
    ]
    with pytest.raises(InputError, match="found 'banks', expected 'bank' or 'bank-slim'"):
        sfkit.open_source_data("banks")
