"""What is said of noise over images, and of racing, is what their tables say."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
import pytest
from benchmark_scripts import imported

from sfkit.search.gaussian_process import fit


@pytest.fixture(scope="module")
def scripts() -> Iterator[tuple[ModuleType, ...]]:
    with imported("noise") as modules:
        yield modules


def test_a_noisy_score_pulls_the_mean_less(scripts: tuple[ModuleType, ...]) -> None:
    points = (np.linspace(0.0, 1.0, 9)[:, None],)
    values = np.append(np.linspace(3.0, 2.0, 8), 6.0)
    process = fit(points, values)
    noisy = np.append(np.full(8, 0.05), 8.0)
    equal, by_merge = (
        scripts[0].posterior_mean(process, points, values, shares) for shares in (np.ones(9), noisy)
    )
    assert by_merge[-1] < equal[-1]
    assert by_merge[:-1] == pytest.approx(values[:-1], abs=0.3)


def test_what_a_mean_tells_is_its_rank_correlation_and_regret(scripts: tuple[ModuleType, ...]) -> None:
    unseen = np.array([1.0, 2.0, 3.0, 4.0])
    assert scripts[0].told(10.0 * unseen, unseen) == pytest.approx((1.0, 0.0))
    assert scripts[0].told(-unseen, unseen) == pytest.approx((-1.0, 3.0))


def test_the_section_is_what_finished_runs_say(
    scripts: tuple[ModuleType, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (noise,) = scripts
    monkeypatch.setattr(noise, "kept", replace(noise.kept, folder=tmp_path))
    with pytest.raises(SystemExit, match="nothing is finished yet"):
        noise.section()
    raced = {"seed": [0, 1, 0, 1], "passes": 24, "finished": [0, 0, 4, 4], "regret": [0.0, 0.4, 0.5, 0.1]}
    pd.DataFrame(raced).to_csv(tmp_path / "racing-00.csv", index=False)
    told = {"seed": 0, "window": [0, 1], "noise": "equal", "correlation": [0.5, 0.7], "regret": [1.0, 2.0]}
    pd.DataFrame(told).to_csv(tmp_path / "images-00.csv", index=False)
    written = noise.section()
    assert "| no racing | 0.200 (1 of 2) |" in written
    assert "| best 4 finished | 0.300 (0 of 2) |" in written
    assert "| equal | 0.600 | 1.50 |" in written
