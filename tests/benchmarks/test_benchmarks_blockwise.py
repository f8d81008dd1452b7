"""What is said of block-specific searches is what their tables say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
from benchmark_scripts import imported


def test_searches_are_measured_against_cma_es_of_the_same_subset(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with imported("blockwise") as (blockwise,):
        monkeypatch.setattr(blockwise, "kept", replace(blockwise.kept, folder=tmp_path))
        with pytest.raises(SystemExit, match="nothing is finished yet"):
            blockwise.section()

        def finished(size: int, way: str, routing: str, scores: list[float]) -> None:
            rows = {"evaluation": range(1, len(scores) + 1), "score": scores}
            about = {"bank": "bank", "way": way, "routing": routing, "size": size, "entries": 9, "knows": 2}
            name = f"bank-{routing}-{way}-{size}.csv"
            pd.DataFrame({**about, **rows}).to_csv(tmp_path / name, index=False)

        finished(3, "CMA-ES", "block-specific", [9.0] * 99 + [8.0] * 200 + [5.0])
        finished(3, "model", "block-specific", [9.0] * 49 + [7.0] * 60 + [4.5] + [8.0] * 40)
        finished(4, "CMA-ES", "block-specific", [9.0] * 99 + [8.0] * 200 + [6.0])
        finished(4, "model", "block-specific", [9.0] * 150)
        finished(5, "model", "block-specific", [1.0] * 150)  # no CMA-ES of that search yet
        written = blockwise.section()
    model = "model, block-specific"
    assert f"| 3 | 9 | {model} | 2 | +4.00 | +4.00 | +2.00 | +2.00 | +2.00 | -0.50 |  | 50 | 110 |" in written
    assert "| 3 | 9 | CMA-ES, block-specific | 2 | +4.00 |" in written
    assert "| +3.00 | +0.00 | 100 | 300 |" in written
    assert f"| {model} | 2 | +3.50 | +3.50 | +2.50 | +2.50 | +2.50 | +1.25 |  | never | never |" in written
    assert "| 5 |" not in written


def test_subsets_are_the_best_of_their_size(tmp_path: Path) -> None:
    with imported("blockwise", "exhaustive") as (blockwise, exhaustive):
        import sfkit

        table = exhaustive.subset_scores()
        with sfkit.EvaluationStore(tmp_path / "evaluations.sqlite") as store:
            place = blockwise.place("bank", 3, store)
        triples = {mask: score for mask, score in table.quick.items() if mask.bit_count() == 3}
        assert table.quick[table.mask(place.subset)] == min(triples.values())
        assert len(place.subset) == 3
        assert all(entry.score == table.quick[table.mask(entry.recipe.sources)] for entry in place.known)
