"""Evaluations as parquet, read back by pyarrow, which `make test` does without."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pyarrow.parquet
from tiny import write_pairs, write_pool

from sfkit.datasets.benchmark import open_benchmark
from sfkit.evaluation import EvaluationStore, Evaluator
from sfkit.evaluation.exchange import evaluation_table, export_evaluations
from sfkit.merging import open_pool


def test_a_table_of_evaluations_survives_parquet(tmp_path: Path) -> None:
    pool = open_pool(write_pool(tmp_path / "pool"))
    pairs = open_benchmark("pairs", write_pairs(tmp_path / "pairs"))
    with EvaluationStore(tmp_path / "e.sqlite") as store:
        Evaluator(pool, pairs, store=store)([pool.uniform(), pool.equal("a")])
        table = evaluation_table(store)
        path = export_evaluations(store, tmp_path / "e.parquet")
    assert pyarrow.parquet.read_metadata(path).num_rows == len(table) == 2 * 2 * 2
    pd.testing.assert_frame_equal(pd.read_parquet(path), table, check_dtype=False)
