"""What is said of what a search should return is what its runs say."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import pandas as pd
import pytest
from benchmark_scripts import imported


@pytest.fixture(scope="module")
def returned() -> Iterator[ModuleType]:
    with imported("returned") as (module,):
        yield module


def test_ten_runs_are_asked_for_at_every_number_of_pairs(
    returned: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SFKIT_REAL_DATA", "anywhere")
    groups = pd.Series([name.rpartition("-")[0] for name in returned.jobs()]).value_counts()
    assert len(groups) == 2 * (2 * 4 + 2)
    assert (groups == 10).all()


def test_the_section_sets_both_ways_beside_stage_1_of_the_same_run(
    returned: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(returned, "kept", replace(returned.kept, folder=tmp_path))
    with pytest.raises(SystemExit, match="nothing is finished yet"):
        returned.section()
    networks = [returned.STAGE1, returned.BEST, returned.AVERAGED]
    runs = {
        (2, 0): ([9.0, 7.0, 8.0], [20.0, 21.0, 19.0]),
        (2, 1): ([9.0, 8.0, 8.0], [20.0, 18.0, 19.0]),
        (5, 0): ([9.0, 8.0, 8.0], [20.0, 19.0, 19.0]),
    }
    for (pairs, seed), (validation, unseen) in runs.items():
        about = {"place": "bank", "method": "paper", "pairs": pairs, "seed": seed}
        frame = pd.DataFrame({**about, "network": networks, "validation": validation, "unseen": unseen})
        frame.to_csv(tmp_path / f"bank-paper-{pairs:02d}-{seed:02d}.csv", index=False)
    written = returned.section()
    named = "| the paper's, M = 12, T = 3 and 40 evaluations of Stage 2"
    assert (
        f"{named} | 2 | 2 | -1.50 | -0.50 | +1.00 | -1.00 | -1.00 | -1.00 | -0.50 ± 1.50 | 1 of 2 |"
        in written
    )
    assert f"{named} | 5 | 1 | -1.00 | -1.00 | -1.00 |" in written
    assert f"{named} | all | 3 |" in written
    assert "Over all 3 runs the average is at -0.33 ± 0.88 points beside the best" in written
    assert "better in 1 of 2; the worst run of the best is at +1.00 against Stage 1, that of" in written
