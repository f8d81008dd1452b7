"""The page of error messages quotes what is really said: each entry's sentence is provoked."""

from __future__ import annotations

import re
import sqlite3
import warnings
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file
from tiny import write_pairs, write_pool

import sfkit
from sfkit.checkpoints import read_checkpoint
from sfkit.cli.panels import BenchmarkChoice
from sfkit.cli.search import few_pairs
from sfkit.datasets.protocols import rule
from sfkit.errors import InputError, SfkitError, SfkitWarning
from sfkit.evaluation import store_file
from sfkit.evaluation.separation import check_separation
from sfkit.search.run_folder import run_folder

PAGE = Path(__file__).parents[2] / "docs" / "errors.md"
ENTRIES = re.findall(r"^`(.+)`(?: \(a \w+\))?$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)


def said(act: Callable[[], object]) -> str:
    """What an act is refused with, or else warned of."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", SfkitWarning)
        try:
            act()
        except SfkitError as error:
            return str(error)
    return "\n".join(str(one.message) for one in caught)


def edited(folder: Path, edit: Callable[[dict[str, torch.Tensor]], object]) -> Callable[[], object]:
    """Open a tiny pool whose first source was edited."""
    toml = write_pool(folder, sources=2)
    state = load_file(folder / "a.safetensors")
    edit(state)
    save_file(state, folder / "a.safetensors")
    return lambda: sfkit.open_pool(toml)


def held_twice(folder: Path) -> None:
    with run_folder(folder, {}), run_folder(folder, {}):
        pytest.fail("both hold it")


def sentences(folder: Path, monkeypatch: pytest.MonkeyPatch) -> list[str]:
    key = "feature_extraction.block0.0.0.weight"
    torch.save({"state_dict": sqlite3.Row}, folder / "pickled.pth")
    pairs = sfkit.open_benchmark("pairs", write_pairs(folder / "pairs", 2))
    unknown = replace(pairs.pairs[0].load(), disparity=np.full((48, 96), np.inf, np.float32))
    with run_folder(folder / "run", {"seed": 0}) as run:
        (run.path / "result.json").touch()
    acts: list[Callable[[], object]] = [
        lambda: sfkit.open_pool(folder / "nowhere.toml"),
        lambda: read_checkpoint(folder / "pickled.pth"),
        edited(folder / "lacks", lambda state: state.pop(key)),
        edited(folder / "more", lambda state: state.update({"decoder.weight": torch.ones(2)})),
        edited(folder / "far", lambda state: state.update({key: 100.0 * torch.ones_like(state[key])})),
        lambda: sfkit.load(folder / "lacks" / "base.safetensors"),
        lambda: BenchmarkChoice(benchmark="eth3d").open(),
        lambda: rule("all-valid", "pairs").valid_mask(unknown),
        lambda: check_separation(pairs, [pairs]),
        lambda: run_folder(folder / "run", {"seed": 1}).__enter__(),
        lambda: held_twice(folder / "held"),
    ]
    found = [said(act) for act in acts]
    found.append(str(rule("openstereo", "eth3d").mask_missing("playground", Path("disp0GT.pfm"))))
    found.append(few_pairs(2, sfkit.RoutingSettings()) or "")
    monkeypatch.setattr(store_file, "file_system", lambda _: "nfs4")
    found.append(said(lambda: store_file.open_store(folder / "s.sqlite").close()))
    return found


def test_every_entry_is_a_sentence_that_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = "\n".join(sentences(tmp_path, monkeypatch))
    assert len(ENTRIES) > 10
    lacking = [
        entry
        for entry in ENTRIES
        if not re.search("^" + ".*".join(map(re.escape, entry.split("..."))) + "$", found, re.MULTILINE)
    ]
    assert lacking == [], found


def test_what_is_no_error_is_not_taken_for_one() -> None:
    assert said(lambda: None) == ""
    assert issubclass(InputError, SfkitError)
