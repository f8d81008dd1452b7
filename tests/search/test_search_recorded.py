"""What an earlier version wrote stays good: its store serves searches now, which end as its search did."""

from __future__ import annotations

import gzip
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import recorded_world

from sfkit.checkpoints.fingerprints import text_digest
from sfkit.merging.recipe import Recipe

RECORDED = Path(__file__).parent / "recorded"
CLOCK = ("time", "seconds", "seconds_saved", "cpu_seconds", "cpu_seconds_saved", "cached")
ROUNDING = "f4976a5330d42ef7cf6e2a804eff7355c5a8a7e7baeafc5e0a464ee69083f866"


def rounding() -> str:
    """How this machine rounds what CMA-ES computes: its last bits are a matter of the processor."""
    numbers = np.exp(np.linspace(-3.0, 3.0, 97))
    values, vectors = np.linalg.eigh(np.add.outer(numbers[:4], numbers[4:8]))
    return text_digest(repr([*numbers.tolist(), *values.tolist(), *vectors.ravel().tolist()]))


def timeless(value: Any) -> Any:
    """A journal's entry without what the clock, or the store at that time, decides."""
    if isinstance(value, dict):
        return {key: timeless(entry) for key, entry in value.items() if key not in CLOCK}
    return [timeless(entry) for entry in value] if isinstance(value, list) else value


def known_then(value: Any, before: Any) -> Any:
    """The part of an entry that an earlier one has too: later versions may say more."""
    if isinstance(value, dict) and isinstance(before, dict):
        return {key: known_then(entry, before[key]) for key, entry in value.items() if key in before}
    if isinstance(value, list) and isinstance(before, list) and len(value) == len(before):
        return [known_then(*pair) for pair in zip(value, before, strict=True)]
    return value


def journal(text: str) -> list[Any]:
    return [timeless(json.loads(line)) for line in text.splitlines()]


def unpacked(name: str) -> bytes:
    return gzip.decompress((RECORDED / name).read_bytes())


def test_nothing_that_an_earlier_version_evaluated_is_evaluated_again(tmp_path: Path) -> None:
    store = tmp_path / "evaluations.sqlite"
    store.write_bytes(unpacked(recorded_world.STORE))
    found, evaluator = recorded_world.search(tmp_path, store)
    result = (found.folder / recorded_world.RESULT).read_text(encoding="utf-8")
    before = (RECORDED / recorded_world.RESULT).read_text(encoding="utf-8")
    lines = journal((found.folder / "journal.jsonl").read_text(encoding="utf-8"))
    lines_before = journal(unpacked(recorded_world.JOURNAL).decode())
    lines = known_then(lines, lines_before)
    if rounding() == ROUNDING:
        assert evaluator.counts.computed == 0 < evaluator.counts.cached
        assert result == before
        assert lines == lines_before
        return
    # Stage 1 compares and draws alone: it is the same everywhere. Stage 2 is the same but for last bits.
    first = [line for line in lines if line["search"] == "subset"]
    assert first == [line for line in lines_before if line["search"] == "subset"]
    recipes = [Recipe.from_dict(json.loads(text)["recipe"]) for text in (result, before)]
    assert recipes[0].sources == recipes[1].sources
    assert np.array(recipes[0].weights) == pytest.approx(np.array(recipes[1].weights), rel=1e-9)
    assert json.loads(result)["score"] == pytest.approx(json.loads(before)["score"], rel=1e-6)
