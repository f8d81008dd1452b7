"""A checkout of OpenStereo, named by ``SFKIT_OPENSTEREO``: three of its models from opening to a search."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parents[2] / "benchmarks"))
import openstereo


@pytest.mark.parametrize("name", openstereo.CASES)
def test_a_model_opens_merges_evaluates_and_searches(name: str, real_data: Path) -> None:
    found = openstereo.measure(name, Path(os.environ[openstereo.CHECKOUT]).expanduser(), real_data)
    assert len(found["blocks"]) in (3, 4)
    assert found["evaluations"] == 4
