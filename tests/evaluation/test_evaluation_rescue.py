"""A store with a damaged page: one sentence, and all rows that do not lie on that page are read."""

from __future__ import annotations

import json
import sqlite3
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from flat_world import SIZE, sample
from typer.testing import CliRunner

from sfkit.cli.app import app
from sfkit.errors import DamagedStoreError
from sfkit.evaluation.metrics import image_errors
from sfkit.evaluation.rescue import rescue
from sfkit.evaluation.store import Evaluation, EvaluationStore, evaluation_key

COUNT, PAGE = 120, 4096


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A store of some sixty pages, two rows on most of them."""
    path = tmp_path_factory.mktemp("store") / "whole.sqlite"
    one, truth = sample("pair", 5.0), np.full(SIZE, 5.0, np.float32)
    valid = np.isfinite(one.disparity)
    with EvaluationStore(path) as store:
        for number in range(COUNT):
            images = tuple(
                image_errors(truth + np.float32(number), replace(one, id=f"pair{i}"), valid) for i in range(3)
            )
            description = {"benchmark": "pairs", "number": number}
            evaluation = Evaluation(evaluation_key(description), description, images, None, 0.5)
            store.put(evaluation)
            store.put(evaluation)  # of a second search: takes a number, and no row
    with closing(sqlite3.connect(path)) as db:
        db.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        assert db.execute("SELECT seq FROM sqlite_sequence").fetchone() > (COUNT,), "numbers without a row"
        assert db.execute("PRAGMA page_size").fetchone() == (PAGE,)
    return path


def damaged(whole: Path, page: int, folder: Path) -> Path:
    """A copy with one page (from 0) full of noise."""
    content = bytearray(whole.read_bytes())
    content[page * PAGE : (page + 1) * PAGE] = np.random.default_rng(page).bytes(PAGE)
    (folder / "damaged.sqlite").write_bytes(bytes(content))
    return folder / "damaged.sqlite"


def rows(path: Path) -> list[Evaluation]:
    with EvaluationStore(path) as store:
        return list(store)


def test_whatever_page_is_lost_the_rows_of_the_others_are_read(whole: Path, tmp_path: Path) -> None:
    written = {evaluation.key: evaluation for evaluation in rows(whole)}
    pages = whole.stat().st_size // PAGE
    assert pages > 20
    unreadable = 0
    for page in (*range(1, 6), *range(6, pages, 4)):  # the first few hold the tables' roots
        path = damaged(whole, page, tmp_path)
        before = path.read_bytes()
        with EvaluationStore(":memory:") as target:
            try:
                found = rescue(path, target)
            except DamagedStoreError:
                unreadable += 1
                continue
            kept = {evaluation.key: evaluation for evaluation in target}
        assert path.read_bytes() == before
        assert all(written[key] == evaluation for key, evaluation in kept.items())
        assert found.copied == len(kept) == COUNT - len(found.lost)
        # One page holds few rows; the one page above all others holds the way to them.
        unreadable += len(found.lost) > 12
    assert unreadable <= 2


def test_the_store_says_so_and_import_reads_the_rest(whole: Path, tmp_path: Path) -> None:
    page = whole.stat().st_size // PAGE // 2
    path, new = damaged(whole, page, tmp_path), tmp_path / "new.sqlite"
    with pytest.raises(
        DamagedStoreError, match=r"damaged\.sqlite: is damaged .* sfkit runs import .*damaged"
    ):
        EvaluationStore(path)
    words = ["runs", "import", str(path), "--into", str(new)]
    told = json.loads(CliRunner().invoke(app, [*words, "--json"]).stdout)
    assert 0 < told["lost"] < 12
    assert told["copied"] == COUNT - told["lost"] == len(rows(new))
    again = CliRunner().invoke(app, words)
    assert again.stdout == f"copied 0, {told['copied']} were there\n"
    assert f"{told['lost']} of its evaluations cannot be read" in again.stderr


def test_a_row_that_says_something_else_costs_itself_alone(whole: Path, tmp_path: Path) -> None:
    path = tmp_path / "edited.sqlite"
    path.write_bytes(whole.read_bytes())
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("UPDATE evaluations SET errors = replace(errors, 'pair1', 'pair7') WHERE number = 5")
        assert db.total_changes == 1
    with pytest.raises(DamagedStoreError, match="is not what was written"):
        rows(path)
    with EvaluationStore(":memory:") as target:
        assert rescue(path, target).lost == (5,)


def test_no_store_is_rescued(tmp_path: Path) -> None:
    (tmp_path / "x.sqlite").write_bytes(b"SQLite format 3\0" + bytes(5000))
    with EvaluationStore(":memory:") as target, pytest.raises(DamagedStoreError, match="nothing of it"):
        rescue(tmp_path / "x.sqlite", target)
