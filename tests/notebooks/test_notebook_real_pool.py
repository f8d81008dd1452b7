"""The notebooks with widgets open on the real AnyNet pool as well, with the quickstart's parameters."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import nbformat
import pytest

from sfkit.reports import report

ROOT = Path(__file__).parents[2]
POOL = ROOT / "tests" / "pools" / "anynet_real.toml"
STATE = "application/vnd.jupyter.widget-state+json"
BUDGETS = {"population": 4, "generations": 1, "evaluations": 4, "report_on": []}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "taken", "trait"),
    [
        ("02_watch_a_search", ("population", "generations", "evaluations"), "evolution"),
        ("03_routing_inspector", ("evaluations", "report_on"), "weights"),
        ("04_compare_disparities", (), "scene"),
    ],
)
def test_it_opens_on_real_checkpoints(
    name: str, taken: tuple[str, ...], trait: str, real_data: Path, tmp_path: Path
) -> None:
    parameters: dict[str, Any] = {
        "pool": POOL,
        "benchmark": "eth3d",
        "benchmark_root": real_data / "eth3d",
        "protocol": "raft",
        "out": tmp_path,
        **{budget: BUDGETS[budget] for budget in taken},
    }
    report(ROOT / "notebooks" / f"{name}.ipynb", parameters, tmp_path / "report.html")
    executed = nbformat.read(tmp_path / "report.ipynb", as_version=4)
    states = executed.metadata["widgets"][STATE]["state"].values()
    assert [1 for widget in states if widget["state"].get(trait)]
    assert all(not widget["state"].get("error") for widget in states)
