"""A pool that grows or changes: what was scored on it before is not scored again; images are read once."""

from __future__ import annotations

import json
import re
from collections import Counter
from itertools import combinations
from pathlib import Path
from typing import Any

import pytest
import torch
from faults_network import Brief
from faults_world import write_pool
from safetensors.torch import save_file
from tiny import write_pairs

from sfkit.architectures import InputConvention
from sfkit.cli import main
from sfkit.datasets import images
from sfkit.datasets.benchmark import open_benchmark
from sfkit.evaluation import EvaluationStore, Evaluator, prepared
from sfkit.merging import open_pool
from sfkit.search import RoutingSettings, SubsetSettings
from sfkit.search.pipeline import search_pool
from sfkit.search.plan import SearchPlan


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """The brief network without its sleep."""
    monkeypatch.setattr("faults_network.SECONDS", 0.0)
    assert Brief.forward


def subsets(names: tuple[str, ...]) -> list[tuple[str, ...]]:
    """Every subset of two or more."""
    return [subset for size in range(2, len(names) + 1) for subset in combinations(names, size)]


def scored(folder: Path) -> tuple[Evaluator, dict[tuple[str, ...], bool]]:
    """Score every subset of the pool; which of them were in the store already."""
    pool = open_pool(folder / "pool" / "pool.toml")
    pairs = open_benchmark("pairs", folder / "pairs", metric="epe")
    with EvaluationStore(folder / "s.sqlite") as store:
        evaluator = Evaluator(pool, pairs, store=store)
        asked = subsets(pool.names)
        outcomes = evaluator([pool.equal(*subset) for subset in asked])
    return evaluator, {subset: o.cached for subset, o in zip(asked, outcomes, strict=True)}


def test_a_twelfth_source_costs_only_the_subsets_it_is_in(tmp_path: Path) -> None:
    write_pairs(tmp_path / "pairs", 1, size=(16, 32))
    write_pool(tmp_path / "pool", 7)
    before, _ = scored(tmp_path)
    assert before.counts.computed == 2**7 - 8
    write_pool(tmp_path / "pool", 8)  # the first seven files are written again, to the same last byte
    after, cached = scored(tmp_path)
    assert after.counts.cached == before.counts.computed
    assert cached == {subset: "h" not in subset for subset in cached}
    share = after.counts.cached / len(cached)
    assert share == (2**7 - 8) / (2**8 - 9), "49 %: of a pool of 12 that was searched with 11 it is 2036/4083"


def test_a_changed_file_costs_only_the_subsets_it_is_in(tmp_path: Path) -> None:
    write_pairs(tmp_path / "pairs", 1, size=(16, 32))
    write_pool(tmp_path / "pool", 6)
    scored(tmp_path)
    state = {"level": torch.tensor([5.5]), "slope": torch.tensor([0.25])}
    save_file(state, tmp_path / "pool" / "c.safetensors")
    _, cached = scored(tmp_path)
    assert cached == {subset: "c" not in subset for subset in cached}
    state = {"level": torch.tensor([6.5]), "slope": torch.tensor([0.75])}
    save_file(state, tmp_path / "pool" / "base.safetensors")
    _, cached = scored(tmp_path)
    assert not any(cached.values()), "every merge starts from the base"


def test_a_search_on_a_grown_pool_says_what_it_saved(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_pairs(tmp_path / "pairs", 1, size=(16, 32))
    line = ["search", "pool", "-b", "pairs", "-r", "pairs", "--metric", "epe", "--yes", "--evaluations", "0"]
    line += ["--population", "20", "--generations", "3", "--store", "s.sqlite", "--engine", "inline"]
    said = []
    for sources in (5, 6):
        write_pool(tmp_path / "pool", sources)
        with pytest.raises(SystemExit, match=r"^0$"):
            main([*line, "-o", f"r{sources}"])
        said.append(next(x for x in capsys.readouterr().out.splitlines() if x.startswith("evaluations: ")))
        with pytest.raises(SystemExit, match=r"^0$"):
            main([*line, "-o", f"r{sources}", "--json"])
        again = json.loads(capsys.readouterr().out)["evaluations"]
        assert again["computed"] == 0
    assert said[0].endswith("1 (5 %) were in the store"), "the evaluation that was timed for the estimate"
    saved = re.search(r", (\d+) \(\d+ %\) were in the store$", said[1])
    assert saved is not None, said
    assert int(saved[1]) > 8, said


def test_images_are_read_decoded_and_prepared_once_for_a_whole_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_pool(tmp_path / "pool", 5)
    write_pairs(tmp_path / "pairs", 3, size=(16, 32))
    calls: Counter[Any] = Counter()

    def counted(place: Any, name: str, key: Any) -> None:
        function = getattr(place, name)

        def call(*arguments: Any, **named: Any) -> Any:
            calls[key(*arguments)] += 1
            return function(*arguments, **named)

        monkeypatch.setattr(place, name, call)

    counted(images, "decode", lambda path: path.relative_to(tmp_path / "pairs"))
    counted(InputConvention, "prepare", lambda *_: "prepared")
    counted(prepared, "regions_of", lambda sample, *__: f"regions of {sample.id}")
    pool = open_pool(tmp_path / "pool" / "pool.toml")
    evaluator = Evaluator(pool, open_benchmark("pairs", tmp_path / "pairs", metric="epe"))
    plan = SearchPlan(
        stage1=SubsetSettings(population=6, generations=2), stage2=RoutingSettings(evaluations=12)
    )
    search_pool(pool, evaluator, plan, tmp_path / "run")
    assert evaluator.counts.computed > 20
    files = {Path(f"pair{n}") / f"{side}.png": 1 for n in range(3) for side in ("left", "right")}
    assert calls == {**files, "prepared": 3, **{f"regions of pair{n}": 1 for n in range(3)}}
