"""Searches on the table of all subsets, and what the section says of finished ones."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
import pytest
from benchmark_scripts import imported
from scipy.integrate import quad
from scipy.stats import norm

from sfkit.search.gaussian_process import Array, fit


@pytest.fixture(scope="module")
def scripts() -> Iterator[tuple[ModuleType, ...]]:
    with imported("bayesian", "optimum", "landscapes", "exhaustive") as modules:
        yield modules


@pytest.fixture
def land(scripts: tuple[ModuleType, ...]) -> object:
    """Six sources, the better the nearer the members' mean is to 1; the best subset is a, b and d."""
    values = dict(zip("abcdef", (0.0, 2.5, -3.0, 0.5, 4.0, -1.7), strict=True))
    scores = {}
    for mask in range(1, 64):
        members = [value for n, value in enumerate(values.values()) if mask >> n & 1]
        scores[mask] = abs(float(np.mean(members)) - 1.0)
    return scripts[2].Landscape(scripts[3].SubsetScores(tuple(values), scores, scores))


def test_a_batch_counts_evaluations_rounds_and_time(scripts: tuple[ModuleType, ...], land: object) -> None:
    one, four = (scripts[0].in_batches(land, batch, range(3)) for batch in (1, 4))
    assert (four["needed"] <= 62).all()
    rounds = np.ceil((one["needed"] - 14).clip(lower=0)) + 1  # 6 alone, 8 before there is a model
    assert list(one["rounds"]) == list(rounds)
    evaluated = 14 + rounds - 1  # one worker waits for nobody: time is what was evaluated, but for the spread
    assert list(one["wall"]) == pytest.approx(list(evaluated), rel=0.1)
    assert (one["busy"] > 0.999).all()
    assert (four["wall"] < one["wall"]).all()


def test_draws_spread_as_the_posterior_does(scripts: tuple[ModuleType, ...]) -> None:
    rng = np.random.default_rng(0)
    learned, new = rng.random((12, 2)), rng.random((5, 2))
    process = fit((learned,), np.sin(4.0 * learned[:, 0]) + learned[:, 1])
    # A point twice, and one it learned from.
    points = (np.concatenate([new, new[:1], learned[:1]]),)
    draws = scripts[0].drawn(process, points, 4000, rng)
    mean, sd = process.predict(points)
    assert draws.mean(axis=0) == pytest.approx(mean, abs=4.0 * float(sd.max()) / 4000**0.5 + 1e-3)
    floor = 1e-3 * process.variance**0.5  # what keeps the covariance from being singular
    assert draws.std(axis=0) == pytest.approx(np.sqrt(sd**2 + floor**2), rel=0.06)
    assert np.abs(draws[:, 0] - draws[:, 5]).max() <= 8.0 * floor


def test_thompson_proposes_what_is_new_and_each_once(scripts: tuple[ModuleType, ...], land: object) -> None:
    search = scripts[0].search_of(land, 3, 8, scripts[0].CHOOSERS["Thompson"])
    search.run()
    assert search.reason == "all 57 subsets are scored"
    assert search.counts.distinct == len(search.candidates) == 63
    found = scripts[0].in_batches(land, 8, range(3), scripts[0].CHOOSERS["Thompson"])
    assert (found["needed"] <= 62).all()


def test_an_expected_improvement_is_the_mean_of_what_is_gained(scripts: tuple[ModuleType, ...]) -> None:
    mean, sd = np.array([2.0, 0.5, 1.0, 9.0]), np.array([0.7, 0.2, 1e-3, 2.0])

    def gained(value: float, centre: float, spread: float) -> float:
        return float((1.2 - value) * norm.pdf(value, centre, spread))

    expected = [
        quad(gained, centre - 12.0 * spread, min(1.2, centre + 12.0 * spread), (centre, spread))[0]
        for centre, spread in zip(mean, sd, strict=True)
    ]
    assert scripts[0].improvement(1.2, mean, sd) == pytest.approx(expected, rel=1e-6)


def test_expected_improvement_proposes_what_is_new_and_promises_most(
    scripts: tuple[ModuleType, ...], land: object
) -> None:
    search = scripts[0].search_of(land, 3, chooser=scripts[0].ExpectedImprovementSubsetSearch)
    search.step()
    model, met = search._model(), {candidate.subset for candidate in search.candidates}
    lowest = min(candidate.score for candidate in search.candidates if len(candidate.subset) > 1)
    promised = {}
    for mask in range(1, 64):
        genes = [n for n in range(6) if mask >> n & 1]
        if len(genes) > 1 and tuple("abcdef"[n] for n in genes) not in met:
            weights = np.zeros((1, 6))
            weights[0, genes] = 1.0 / len(genes)
            mean, sd = (float(value[0]) for value in model.predict(search._points(weights)))
            promised[tuple("abcdef"[n] for n in genes)] = float(
                norm.expect(lambda y: max(lowest - y, 0.0), loc=mean, scale=sd, ub=lowest)
            )
    search.step()
    (proposed,) = search.candidates[-1:]
    assert promised[proposed.subset] == pytest.approx(max(promised.values()), rel=1e-3)
    assert -proposed.prediction.acquisition == pytest.approx(promised[proposed.subset], rel=1e-3)
    met = scripts[0].run(land, 0, scripts[0].ExpectedImprovementSubsetSearch)
    assert 0.0 in land.regrets(met)  # type: ignore[attr-defined]


def test_a_run_ends_at_the_optimum(scripts: tuple[ModuleType, ...], land: object) -> None:
    met = scripts[0].run(land, 0)
    assert 0.0 in land.regrets(met)  # type: ignore[attr-defined]
    assert met[:6] == [1, 2, 4, 8, 16, 32]


def test_another_librarys_model_searches_as_ours_does(scripts: tuple[ModuleType, ...], land: object) -> None:
    with imported("peers_models") as (peers,):

        def same(points: Array, values: Array, new: Array) -> tuple[Array, Array]:
            return fit((points,), values).predict((new,))

        assert peers.searched_by(same)(land, 1) == scripts[0].run(land, 1)


def test_what_a_newcomer_costs_leaves_out_what_was_stored(
    scripts: tuple[ModuleType, ...], land: object
) -> None:
    assert scripts[0].newcomers(land) == ("a", "b", "d")
    found = dict(scripts[0].grown(land, "d", 0))
    assert list(found) == list(scripts[0].GROWN)
    assert found["model, knows the evaluations before"] < found["model, nothing known"]
    assert found["paper's, with the store"] <= found["paper's, nothing known"]
    assert all(1 <= needed <= 31 for way, needed in found.items() if "store" in way)  # subsets with d


def test_first_seeds_come_first_and_runs_can_be_asked_for_by_name(
    scripts: tuple[ModuleType, ...], tmp_path: Path
) -> None:
    optimum = scripts[1]
    names = list(optimum.jobs())
    seeds = [int(name.rpartition("-")[2]) for name in names if not name.startswith("grown")]
    assert seeds == sorted(seeds)
    paper = {"search-20-sfkit__a_model_of_the_score-190", "batch-08-64-030", "grown-20-002"}
    assert paper <= set(names)
    kept = replace(optimum.kept, folder=tmp_path)
    kept.main(["search-20-greedy"])
    (row,) = kept.results("search-20").to_dict("records")
    assert (row["search"], row["seed"]) == ("greedy soup", 0)


def test_the_section_is_what_finished_searches_say(
    scripts: tuple[ModuleType, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    optimum = scripts[1]
    monkeypatch.setattr(optimum, "kept", replace(optimum.kept, folder=tmp_path))
    with pytest.raises(SystemExit, match="nothing is finished yet"):
        optimum.section()
    infinite = float("inf")
    searched = pd.DataFrame(
        {"search": "GA", "pairs": 20, "seed": range(4), "needed": [50, 70, infinite, 100]}
    )
    searched.assign(seconds=0.002).to_csv(tmp_path / "search-20-ga-000.csv", index=False)
    for batch, needed, wall in ((1, 30, 30.0), (4, 40, 12.0)):
        row = {"seed": [0], "needed": needed, "rounds": 6, "wall": wall, "busy": 0.9, "seconds": 0.005}
        frame = pd.DataFrame(row).assign(batch=batch, pairs=20)
        frame.to_csv(tmp_path / f"batch-20-{batch:02d}-000.csv", index=False)
    written = optimum.section()
    assert "| GA | 4 | 75 % | 85 | never | 25 % | 50 % | 2.0 |" in written
    assert "| 4 | 1 | 100 % | 40 | 40 | 100 % | 100 % | 10 | 6 | 12.0 | 2.5 | 62 % | 90 % | 5.0 |" in written
    assert "gains a source" not in written


def test_what_knows_nothing_counts_once_a_seed(
    scripts: tuple[ModuleType, ...], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    optimum = scripts[1]
    monkeypatch.setattr(optimum, "kept", replace(optimum.kept, folder=tmp_path))
    needed = {"model, nothing known": 30.0, "model, knows the evaluations before": 5.0}
    rows = [
        (20, seed, newcomer, way, count + seed)
        for seed in (0, 1)
        for newcomer in "abd"
        for way, count in needed.items()
    ]
    frame = pd.DataFrame(rows, columns=["pairs", "seed", "newcomer", "way", "needed"])
    monkeypatch.setattr(type(optimum.kept), "results", lambda *_: frame)
    written = optimum.growth_table(20)
    assert "| model, nothing known | 2 | 100 % | 30 | 31 |" in written
    assert "| model, knows the evaluations before | 6 | 100 % | 6 | 6 |" in written


SHARES = {1.0: "100 %", 0.0: "0 %", 199 / 200: "99.5 %", 1 / 200: "0.5 %", 0.995001: "99.5 %"}
SHARES |= {0.994: "99 %", 0.375: "38 %", 0.9999: "99.99 %", 1e-5: "0.001 %"}


@pytest.mark.parametrize(("share", "text"), SHARES.items())
def test_a_share_that_is_neither_none_nor_all_never_reads_so(
    scripts: tuple[ModuleType, ...], share: float, text: str
) -> None:
    with imported("tabulated") as (tabulated,):
        assert tabulated.percent(share) == text
