from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from flat_world import flat_pool
from safetensors.torch import save_file
from scipy.stats import spearmanr
from torch import nn

import sfkit
from sfkit.analysis.ranking import DRAWS, agreement, rank_correlations, yardstick_recipes
from sfkit.analysis.trust import KeptBack, Trust, is_collapsed, stability, trust, trust_of, trust_sentences
from sfkit.architectures import register_architecture
from sfkit.checkpoints.spec import Member, PoolSpec
from sfkit.datasets import MemoryPair, Sample, memory_benchmark
from sfkit.errors import InputError, SfkitWarning
from sfkit.evaluation import CombinedScorer, Evaluator
from sfkit.merging import Pool, open_pool
from sfkit.streams import Stream, generator

SOUND = Trust(None, 0.9, 0.8, 0.95, 0.0, 8)


def test_agreement_with_labels_by_hand() -> None:
    census, truth = [1, 2, 3, 4, 5, 6, 7, 8], [10, 30, 20, 40, 50, 60, 70, 80]
    found = agreement(census, truth, "bad-1.0 on here")
    assert found.correlation == pytest.approx(1 - 6 * 2 / (8 * 63))  # one swap: two squared differences of 1
    assert found.interval[0] < found.correlation <= found.interval[1]
    assert found.regret == 0.0
    assert agreement(census[::-1], truth, "x").regret == 70.0
    assert agreement(census, truth, "bad-1.0 on here") == found, "its draws come from the seed"
    with pytest.raises(InputError, match="expected as many of both, at least 8"):
        agreement(census[:7], truth[:7], "x")


def test_the_regrets_interval_by_hand() -> None:
    # The pick is 10 worse than any other. It is drawn in 1 - (7/8)^8 = 66 % of the draws and alone in none.
    found = agreement(range(8), [10.0] + 7 * [0.0], "x")
    assert (found.regret, found.regret_interval) == (10.0, (0.0, 10.0))
    agreed = agreement(range(8), range(8), "x")
    assert (agreed.regret, agreed.regret_interval) == (0.0, (0.0, 0.0)), "in every draw the pick is the best"
    # Each draw's regret, network by network; 2.5 and 97.5 % lie between two of the sorted ones.
    census, truth = np.random.default_rng(4).permuted(np.arange(24.0).reshape(2, 12), axis=1)
    lost = []
    for drawn in generator(5, Stream.TRUST).integers(12, size=(DRAWS, 12)).tolist():
        pick = min(drawn, key=lambda n: census[n])
        lost.append(truth[pick] - min(truth[n] for n in drawn))
    lost.sort()
    ends = [np.interp(share * (DRAWS - 1), range(DRAWS), lost) for share in (0.025, 0.975)]
    assert agreement(census, truth, "x", seed=5).regret_interval == pytest.approx(ends)
    assert ends[0] < ends[1]


@pytest.mark.filterwarnings("ignore:An input array is constant")
def test_rank_correlation_is_scipys() -> None:
    rng = np.random.default_rng(2)
    first, second = rng.integers(0, 6, (2, 40, 9)).astype(float)  # with ties
    first[7] = 3.0
    found = rank_correlations(first, second)
    theirs = [spearmanr(a, b).statistic for a, b in zip(first, second, strict=True)]
    assert found == pytest.approx(theirs, nan_ok=True)
    assert np.isnan(found[7])


def test_stability_over_halves_of_the_pairs() -> None:
    agreed = np.arange(6.0)[:, None] + np.zeros(4)
    assert stability(agreed) == pytest.approx(1.0)
    noise = np.random.default_rng(0).normal(size=(40, 6))
    assert abs(stability(noise)) < 0.35
    assert np.isnan(stability(agreed[:2]))
    assert np.isnan(stability(agreed[:, :1]))


def test_what_collapsed_means() -> None:
    ramp = np.linspace(0, 40, 600).reshape(20, 30)
    assert not is_collapsed(ramp)
    assert is_collapsed(np.full((20, 30), 12.0))
    assert is_collapsed(np.zeros((20, 30)))
    assert is_collapsed(ramp / 100)


def test_each_doubt_is_said() -> None:
    assert SOUND.trusted
    assert "Nothing speaks against the ranking without labels" in SOUND.sentence
    weak = agreement([1, 2, 3, 4, 5, 6, 7, 8], [3, 1, 4, 1, 5, 9, 2, 6], "bad-3.0 on hazy-road")
    said = Trust(weak, 0.3, 0.1, 0.5, 0.5, 2).sentence
    assert said.startswith(
        "Do not trust the ranking without labels yet: over 8 networks it ranks as bad-3.0 on hazy-road"
    )
    low, high = weak.interval
    assert low < 0.6
    for part in (
        f"({low:.2f} to {high:.2f}, its lower end expected at 0.6 or more), and its pick is 2.00 (",
        "2 pairs can be overfitted",
        "with a correlation of 0.30",
        "10 % of the pixels have texture",
        "under the best network 50 % of matches lie inside the image (expected 70 % or more)",
        "50 % of the maps of the best network are nearly constant",
    ):
        assert part in said
    assert "the pairs do not tell the networks apart" in Trust(None, float("nan"), 0.8, 0.95, 0.0, 8).sentence


def test_a_network_that_wins_by_collapsing_is_caught(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path, {"low": 4.0, "high": 12.0, "higher": 14.0})
    wall = [np.full((24, 60, 3), 90 + n, np.uint8) for n in range(5)]
    for n, image in enumerate(wall):
        image[n, n] = 200  # not one flat colour, and no texture to speak of
    pairs = [
        MemoryPair(
            f"wall{n}", Sample(f"wall{n}", image, np.roll(image, 1, 0), np.full((24, 60), 9, np.float32))
        )
        for n, image in enumerate(wall)
    ]
    scorer = Evaluator(pool, memory_benchmark("walls", pairs, metric="census"))
    with pytest.warns(SfkitWarning, match="nearly constant or zero"):
        found = trust_of(pool, [scorer])
    assert found is not None
    assert found.collapsed == 1.0
    assert found.texture < 0.3
    assert "may win where images have no texture" in found.sentence
    assert trust_sentences(scorer) == (found.sentence,), "for a page: no warning beside it"
    guides = [scorer, Evaluator(pool, memory_benchmark("labelled", pairs, metric="epe"))]
    (beside_labels,) = trust_sentences(CombinedScorer(guides))
    assert "as epe on labelled" in beside_labels
    assert trust_sentences(guides[1]) == ()
    with pytest.raises(InputError, match="found the metric epe, expected a scorer by census"):
        trust(Evaluator(pool, memory_benchmark("walls", pairs, metric="epe")), [pool.base_recipe()])


passes: list[float] = []
"""The slope of every forward pass so far."""


@register_architecture("sloped", blocks={"slope": ["slope"]}, version="1")
class Sloped(nn.Module):
    """Disparity rises over the image by twice the slope, around 9 px: without slope it is constant."""

    def __init__(self) -> None:
        super().__init__()
        self.slope = nn.Parameter(torch.zeros(1))

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        passes.append(float(self.slope.detach()))
        return 9 + passes[-1] * torch.linspace(-1, 1, left.shape[-1]).expand(1, *left.shape[-2:])


def _sloped_pool(folder: Path, slopes: Mapping[str, float]) -> Pool:
    for name, slope in {"base": 6.0, **slopes}.items():
        save_file({"slope": torch.tensor([slope])}, folder / f"{name}.safetensors")
    members = [Member(name, folder / f"{name}.safetensors") for name in ("base", *slopes)]
    return open_pool(PoolSpec("sloped", "sloped", members[0], tuple(members[1:])))


def test_a_merge_that_collapses_where_no_source_does_is_caught(tmp_path: Path) -> None:
    pool = _sloped_pool(tmp_path, {"up": 8.0, "down": -8.0, "steep": 9.0, "falling": -6.0})
    flat, usual = pool.equal("up", "down"), list(yardstick_recipes(pool).values())
    scorer = Evaluator(pool, memory_benchmark("plane", _textured(9, 5), metric="census"))
    (found,), others = scorer([flat]), scorer(usual)
    assert found.score < min(other.score for other in others) / 2, "the plane itself: it wins by far"
    assert trust(scorer, usual).collapsed == 0.0
    passes.clear()
    with pytest.warns(SfkitWarning, match="100 % of the maps of the network found are nearly constant"):
        said = trust_of(pool, [scorer], flat)
    assert said is not None
    assert (said.network, said.collapsed, said.trusted) == ("the network found", 1.0, False)
    assert passes == [0.0] * 5, "no other network is asked again"


def test_signs_are_those_of_the_worse_of_found_and_best(tmp_path: Path) -> None:
    pool = _sloped_pool(tmp_path, {"level": 0.0, "up": 8.0, "steep": 14.0})
    usual = list(yardstick_recipes(pool).values())
    on_plane, on_slope = (
        Evaluator(pool, memory_benchmark(name, pairs, metric="census"))
        for name, pairs in (("plane", _textured(9, 4)), ("slope", _sloping(8.0, 4)))
    )
    best = trust(on_plane, usual, found=pool.equal("steep"))
    assert (best.network, best.collapsed) == ("the best network", 1.0), "what was found is worse"
    found = trust(on_slope, usual, found=pool.equal("level"))
    assert (found.network, found.collapsed) == ("the network found", 1.0), "guided by labels as well"
    assert trust(on_slope, usual, found=pool.equal("up")).collapsed == 0.0


def test_what_was_found_may_be_of_another_pool(tmp_path: Path) -> None:
    (tmp_path / "other").mkdir()
    pool = _sloped_pool(tmp_path, {"up": 8.0, "steep": 9.0})
    other = _sloped_pool(tmp_path / "other", {"level": 0.0})
    guide, further = (
        Evaluator(pool, memory_benchmark(name, _textured(9, pairs), metric="census"))
        for name, pairs in (("guide", 4), ("further", 6))
    )
    usual = list(yardstick_recipes(pool).values())
    said = trust(guide, usual, found=other.equal("level"), found_in=other, further=[further])
    assert (said.network, said.collapsed) == ("the network found", 1.0)
    assert said.kept_back is not None
    assert max(said.kept_back.guiding, said.kept_back.further) < -20, "against the equal mixture of the first"


def _textured(disparity: int, pairs: int) -> list[MemoryPair]:
    """Random texture before one plane: the network that predicts its disparity is right."""
    found = []
    for n in range(pairs):
        right = np.random.default_rng(n).integers(0, 255, (24, 60, 3)).astype(np.uint8)
        truth = np.full((24, 60), disparity, np.float32)
        found.append(MemoryPair(f"{n}", Sample(f"{n}", np.roll(right, disparity, 1), right, truth)))
    return found


def _sloping(slope: float, pairs: int) -> list[MemoryPair]:
    """Random texture before a slanted plane, the left image resampled from the right."""
    found = []
    truth = (9 + slope * np.linspace(-1, 1, 60)).astype(np.float32)
    columns = np.clip(np.rint(np.arange(60) - truth), 0, 59).astype(int)
    for n in range(pairs):
        right = np.random.default_rng(n).integers(0, 255, (24, 60, 3)).astype(np.uint8)
        whole = np.broadcast_to(truth, (24, 60)).copy()
        found.append(MemoryPair(f"{n}", Sample(f"{n}", right[:, columns], right, whole)))
    return found


def test_pairs_kept_back_tell_a_network_that_is_better_only_where_it_was_guided(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path, {"four": 4.0, "twelve": 12.0, "far": 30.0})
    guide, further = (
        Evaluator(pool, memory_benchmark(name, _textured(disparity, 5), metric="census"))
        for name, disparity in (("guide", 12), ("further", 4))
    )
    found, usual = pool.equal("twelve"), list(yardstick_recipes(pool).values())
    change, there = (
        np.subtract(
            *(np.mean([i.value("census") for i in one.evaluate([recipe])[0].images]) for recipe in both)
        )
        for one, both in ((guide, (found, pool.uniform())), (further, (found, pool.uniform())))
    )
    assert change < -20 < -5 < there, "the texture is random: only the right disparity explains it"
    for scorer, on_further in ((guide, change), (further, there)):
        kept = trust(guide, usual, found=found, further=[scorer]).kept_back
        assert kept is not None
        assert (kept.guiding, kept.further, kept.pairs) == pytest.approx((change, on_further, 5))
    assert trust(guide, usual, found=found).kept_back is None


def test_pairs_kept_back_are_in_the_sentence() -> None:
    better, worse = (replace(SOUND, kept_back=KeptBack(-1.57, change, 16)) for change in (-0.4, 0.7))
    said = (
        "against the equal mixture the census of the network found changes by -1.57 points on the pairs that "
        "guide, and by {} on 16 that guide nothing"
    )
    assert better.trusted
    assert said.format("-0.40") in better.sentence
    assert worse.doubts == (f"{said.format('+0.70')} (expected below 0)",)
    assert "pairs kept back from the search would tell more" in SOUND.sentence
    assert replace(SOUND, kept_back=KeptBack(0.0, 0.0, 16)).trusted, "the equal mixture was found"
    assert not replace(SOUND, kept_back=KeptBack(-1.57, 0.0, 16)).trusted


def test_on_the_recorded_worlds_pairs_kept_back_say_where_it_fails() -> None:
    text = (Path(__file__).parents[2] / "docs" / "results.md").read_text(encoding="utf-8")
    rows = text.partition("<!-- begin census-signs")[2].partition("<!-- end census-signs")[0]
    cells = [[cell.strip() for cell in line.split("|")[1:-1]] for line in rows.splitlines() if "|" in line]
    worlds = {name: tuple(map(float, last)) for name, last in ((r[0], r[5:]) for r in cells[2:]) if all(last)}
    assert len(worlds) == 4
    for own, _, census, truth in worlds.values():
        assert replace(SOUND, kept_back=KeptBack(own, census, 16)).trusted == (truth < 0)
    assert {name for name, (*_, truth) in worlds.items() if truth >= 0} == {"courtyard", "grey-workshop"}


@pytest.mark.slow
def test_on_the_bank_it_says_that_labels_contradict() -> None:
    pool = sfkit.open_pool("bank")
    name = "bank:indoor-rooms"
    unlabelled = Evaluator(pool, sfkit.open_benchmark(name, pairs=4, metric="census"))
    labelled = Evaluator(pool, sfkit.open_benchmark(name, pairs=4))
    found = trust(unlabelled, list(yardstick_recipes(pool).values()), labelled=labelled)
    assert found.agreement is not None
    assert found.agreement.interval[0] < 0.6
    assert found.sentence.startswith(
        "Do not trust the ranking without labels yet: over 24 networks it ranks as"
    )
