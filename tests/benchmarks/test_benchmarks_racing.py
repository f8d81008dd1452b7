"""Racing on a table of scores by pair: what is finished, what is told of the rest, and what it costs."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from benchmark_scripts import BENCHMARKS, imported

from sfkit.errors import InputError
from sfkit.merging.recipe import Recipe

NAMES = tuple("abcdef")


@pytest.fixture(scope="module")
def scripts() -> Iterator[tuple[ModuleType, ...]]:
    with imported("sections.racing", "exhaustive", "landscapes") as modules:
        yield modules


@pytest.fixture(scope="module")
def images() -> dict[int, np.ndarray]:
    """The better the nearer the members' mean is to 1, pairs harder or easier for all, and noise."""
    values, rng = np.array([0.0, 2.5, -3.0, 0.5, 4.0, -1.7]), np.random.default_rng(0)
    pairs = rng.uniform(0.0, 20.0, 20)
    found = {}
    for mask in range(1, 64):
        members = [value for n, value in enumerate(values) if mask >> n & 1]
        found[mask] = pairs + abs(float(np.mean(members)) - 1.0) + 0.05 * rng.standard_normal(20)
    return found


def landscape(scripts: tuple[ModuleType, ...], images: dict[int, np.ndarray]) -> object:
    scores = {mask: float(row.mean()) for mask, row in images.items()}
    return scripts[2].Landscape(scripts[1].SubsetScores(NAMES, scores, scores))


def recipe(names: str) -> Recipe:
    return Recipe.equal(tuple(names), ("all",))


def test_what_is_surely_behind_is_not_finished(
    scripts: tuple[ModuleType, ...], images: dict[int, np.ndarray]
) -> None:
    land = landscape(scripts, images)
    race = scripts[0].Race(land, images, 1.0)
    ab, bd, ce = (land.mask(names) for names in ("ab", "bd", "ce"))  # type: ignore[attr-defined]
    alone, first, better, worse = race([recipe(names) for names in ("c", "ab", "bd", "ce")])
    ahead = images[bd][:7].mean() < images[ab][:7].mean()
    assert first.score == land.scores[ab]  # type: ignore[attr-defined]
    if ahead:
        assert better.score == land.scores[bd]  # type: ignore[attr-defined]
    # Told by the best finished one and the paired difference on the first seven.
    best = min(race.finished, key=race.finished.__getitem__)
    for mask, told in ((ce, worse), (land.mask("c"), alone)):  # type: ignore[attr-defined]
        assert mask not in race.finished
        assert told.score == pytest.approx(images[best].mean() + (images[mask][:7] - images[best][:7]).mean())
    assert race.spent == pytest.approx(len(race.finished) + 7 / 20 * (4 - len(race.finished)))
    assert race.met == 3
    assert race.regret(0.9) == np.inf
    assert race.regret(1.0) == pytest.approx(land.scores[ab] - land.best)  # type: ignore[attr-defined]


def test_without_a_race_every_evaluation_is_whole(
    scripts: tuple[ModuleType, ...], images: dict[int, np.ndarray]
) -> None:
    land = landscape(scripts, images)
    race = scripts[0].raced(land, images, None, 0)
    assert race.regret(race.needed) == 0.0
    assert len(race.finished) == race.met == race.spent - len(NAMES)
    # The noise of paired differences is small here: few subsets are finished, the best one all the same.
    found = scripts[0].races(land, images, range(3))
    shares = found.groupby("bound")["finished"].mean()
    assert shares["no racing"] == 1.0
    assert shares["finished up to 1 standard errors behind"] < 0.6
    one = found.set_index("bound").loc["finished up to 2 standard errors behind"]
    assert (one["needed"] < np.inf).all()
    table = scripts[0].race_table(found)
    assert "| no racing | 3 |" in table
    assert "| 100 % |" in table


def test_a_kind_of_noise_is_measured_on_pairs_that_no_model_saw(
    scripts: tuple[ModuleType, ...], images: dict[int, np.ndarray]
) -> None:
    found = scripts[0].noises(NAMES, images, range(2))
    assert (found["correlation"] > 0.9).all()  # the noise is small beside what differs
    assert (found["regret"] < 0.2).all()
    text = scripts[0].noise_table(found)
    assert text.count("standard error") == 2
    assert text.splitlines()[-1].endswith("|  |")


def test_scores_by_pair_survive_their_file(scripts: tuple[ModuleType, ...], tmp_path: Path) -> None:
    exhaustive = scripts[1]
    path = tmp_path / "images-bank.csv"
    with pytest.raises(InputError, match="expected scores by pair, make them with"):
        exhaustive.image_scores(path)
    exhaustive.write_images({2: range(20), 1: [0.12344] * 20}, path)
    found = exhaustive.image_scores(path)
    assert list(found) == [1, 2]
    assert list(found[1]) == [0.1234] * 20
    assert list(found[2]) == list(range(20))


def test_the_tables_are_means_over_the_pairs(scripts: tuple[ModuleType, ...]) -> None:
    exhaustive = scripts[1]
    for path in BENCHMARKS.glob("images-*.csv"):
        images = exhaustive.image_scores(path)
        table = exhaustive.subset_scores(exhaustive.table_path(path.stem.removeprefix("images-")))
        assert path.stat().st_size < 400_000
        assert images.keys() == table.scores.keys()
        for mask, row in images.items():
            assert float(row.mean()) == pytest.approx(table.scores[mask], abs=0.02)
            assert float(row[:8].mean()) == pytest.approx(table.quick[mask], abs=0.02)
