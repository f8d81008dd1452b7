"""``sfkit runs`` and ``sfkit cache`` on what searches left."""

from __future__ import annotations

from pathlib import Path

import pandas as pd
import pytest
from cli_world import Shell

from sfkit.merging import members

SEARCH = "search pool -b pairs -r pairs --population 4 --generations 1 --evaluations 6 --yes"


def test_what_searches_did_is_listed_shown_and_compared(shell: Shell) -> None:
    found = {seed: shell.json(f"{SEARCH} --seed {seed} -o runs/{seed}") for seed in (0, 1)}
    rows = shell.json("runs list runs")["runs"]
    assert [(row["run"], row["stage"], row["state"]) for row in rows] == [
        ("runs/1", "Stage 1", "finished"), ("runs/1", "Stage 2", "finished"),
        ("runs/0", "Stage 1", "finished"), ("runs/0", "Stage 2", "finished"),
    ]  # fmt: skip
    assert [row["best"] for row in rows] == [found[s][f"stage{n}"] for s in (1, 0) for n in (1, 2)]
    assert all(row["evaluations"] >= 1 and row["seconds"] >= 0 for row in rows)
    fresh = sum(row["evaluations"] - row["cached"] for row in rows[2:])
    assert fresh + 1 == found[0]["evaluations"]["computed"], "one told before what the search would cost"

    assert {row["metric"] for row in rows} == {"epe [px]"}
    assert {row["benchmark"] for row in rows} == {"pairs"}
    text, _ = shell("runs list runs")
    assert max(map(len, text.splitlines())) <= 80
    assert f"{rows[0]['best']:.2f}" in text.splitlines()[1]
    text, _ = shell("runs diff runs/0 runs/1")
    assert max(map(len, text.splitlines())) <= 80
    assert shell.json("runs page runs -o runs.html")["runs"] == 2
    assert "runs/0" in Path("runs.html").read_text(encoding="utf-8")

    text, _ = shell("runs show runs/0")
    assert shell("show runs/0")[0] == text, "a search's folder shows itself"
    (line,) = (line for line in text.splitlines() if line.startswith("Stage 2: finished"))
    assert f"best {found[0]['score']:.2f} (" in line
    differences = {
        (row["stage"], row["what"]): row for row in shell.json("runs diff runs/0 runs/1")["differences"]
    }
    assert differences["Stage 1", "settings.seed"] == {
        "stage": "Stage 1", "what": "settings.seed", "runs/0": "0", "runs/1": "1", "differs": True,
    }  # fmt: skip
    assert differences["Stage 1", "state"]["differs"] is False
    assert ("Stage 1", "settings.population") not in differences


def test_evaluations_become_a_table_and_move_to_another_machine(shell: Shell) -> None:
    here = shell.json(f"{SEARCH} -o here")
    computed = here["evaluations"]["computed"] + here["verdict_evaluations"]["computed"]
    assert shell.json("runs export here/evaluations.sqlite -o table.csv")["evaluations"] == computed
    table = pd.read_csv("table.csv")
    assert table.groupby("key")["image"].nunique().tolist() == [2] * computed
    best = table[table["region"] == "all"].groupby("key")["epe"].mean().min()
    assert best == pytest.approx(here["score"])

    moved = shell.json("runs import here/evaluations.sqlite --into there/evaluations.sqlite")
    assert (moved["copied"], moved["already_there"]) == (computed, 0)
    again = shell.json("runs import here/evaluations.sqlite --into there/evaluations.sqlite")
    assert (again["copied"], again["already_there"]) == (0, computed)
    there = shell.json(f"{SEARCH} -o there")
    assert (there["evaluations"]["computed"], there["verdict_evaluations"]["computed"]) == (0, 0)
    assert there["recipe"] == here["recipe"]
    _, said = shell("runs export nowhere.sqlite -o more.csv", code=2)
    assert "nowhere.sqlite: no such file, expected an evaluation store" in said


def test_the_cache_is_listed_and_cleared(
    shell: Shell, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("SFKIT_CACHE", str(tmp_path / "cache"))
    assert shell.json("cache list")["entries"] == []
    monkeypatch.setattr(members, "MAPPED_ABOVE", 0)
    shell("merge pool --uniform -o merged.safetensors")
    listed = shell.json("cache list")
    files = sorted(Path(entry["source"]).name for entry in listed["entries"])
    assert files == ["a.safetensors", "b.safetensors", "c.safetensors"]
    assert listed["bytes"] == sum(entry["bytes"] for entry in listed["entries"]) > 0
    assert shell.json("cache clear")["freed"] >= listed["bytes"]
    assert shell.json("cache list")["entries"] == []
