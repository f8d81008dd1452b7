"""One owner of a command's files: nothing a user computed is replaced by another run, nor by another file."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from cli_world import Shell

from sfkit.cli import outputs
from sfkit.cli.outputs import Places
from sfkit.errors import InputError
from sfkit.search.run_folder import run_folder

PAIRS = "-b pairs -r pairs"
SEARCH = f"search pool {PAIRS} --population 3 --generations 0 --evaluations 0 --yes"


def files(folder: Path) -> dict[str, bytes]:
    return {str(path): path.read_bytes() for path in folder.rglob("*") if path.is_file()}


def test_another_search_does_not_replace_one_unless_it_is_forced(shell: Shell, world: Path) -> None:
    first = shell.json(f"{SEARCH} --seed 0 -o run")
    before = files(world)
    for other, said in (
        ("--seed 1", "stage1.seed 0 there and 1 now"),
        ("--metric d1", "metrics.0 epe there and d1 now"),
        ("--exclude indoor", "constraints.exclude"),
    ):
        _, errors = shell(f"{SEARCH} {other} -o run", code=2)
        assert said in errors
        assert "--force" in errors
        assert files(world) == before
    assert shell.json(f"{SEARCH} --seed 0 -o run")["evaluations"]["computed"] == 0, "the same search goes on"
    forced = shell.json(f"{SEARCH} --seed 1 -o run --force")
    assert json.loads((world / "run" / "result.json").read_text())["recipe"] == forced["recipe"]
    assert first["folder"] == forced["folder"]


def test_another_pool_is_another_search(shell: Shell, world: Path) -> None:
    shell(f"{SEARCH} -o run")
    toml = world / "pool" / "pool.toml"
    toml.write_text(toml.read_text().replace("[sources.driving]", "[sources.sintel]"))
    _, errors = shell(f"{SEARCH} -o run", code=2)
    assert "pool.sources.driving" in errors


def test_a_search_s_recipe_is_refused_where_names_were_exchanged(shell: Shell, world: Path) -> None:
    shell(f"{SEARCH} -o run")
    _, errors = shell("merge pool --recipe run/recipe.json -o same.safetensors")
    assert "does not say" not in errors
    toml = world / "pool" / "pool.toml"
    text = toml.read_text()
    for one, other in (
        ("a.safe", "x.safe"),
        ("b.safe", "a.safe"),
        ("c.safe", "b.safe"),
        ("x.safe", "c.safe"),
    ):
        text = text.replace(f'"{one}', f'"{other}')
    toml.write_text(text)
    _, errors = shell("merge pool --recipe run/recipe.json -o other.safetensors", code=2)
    assert "run/recipe.json" in errors
    assert "were names exchanged" in errors
    old = json.loads((world / "run" / "recipe.json").read_text())
    del old["networks"]
    (world / "old.json").write_text(json.dumps(old))
    _, errors = shell("merge pool --recipe old.json -o other.safetensors")
    assert "old.json: does not say which networks it was made with" in errors


def test_two_searches_do_not_share_a_folder(shell: Shell, world: Path) -> None:
    with run_folder(world / "run", {"seed": 7}):
        _, errors = shell(f"{SEARCH} -o run --force", code=2)
        assert "another search is writing to this folder" in errors
        assert not (world / "run" / "evaluations.sqlite").exists()
    shell(f"{SEARCH} -o run --force")


@pytest.mark.parametrize(
    ("line", "said"),
    [
        (f"evaluate pool {PAIRS} --uniform --store x.csv -o x.csv", "--out"),
        (f"baselines pool {PAIRS} --names uniform --store x.csv -o ./pool/../x.csv", "--out"),
        (f"{SEARCH} -o run --store run/merged.safetensors", "run/merged.safetensors"),
        (f"{SEARCH} -o run --store run/journal.jsonl", "run/journal.jsonl"),
        (f"{SEARCH} -o link --store run/stage1.csv", "run/stage1.csv"),
        (f"evaluate pool {PAIRS} --csv table.csv --uniform -o table.csv --force", "--csv"),
        ("merge pool --recipe mix.pth -o link/../mix.pth --form original --force", "--recipe"),
    ],
)
def test_one_file_is_not_two_things(line: str, said: str, shell: Shell, world: Path) -> None:
    (world / "link").symlink_to("run")
    (world / "run").mkdir()
    row = "pair0/left.png,pair0/right.png,pair0/disparity.pfm"
    (world / "table.csv").write_text(f"left,right,disparity\n{row}\n")
    shell("merge pool --uniform -o mix.pth --form original")
    before = files(world)
    _, errors = shell(line, code=2)
    assert said in errors
    assert files(world) == before


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("report book.ipynb -o book.html", "NOTEBOOK"),
        ("report book.ipynb -p store x.html -o ./link/../x.html", "-p store"),
        ("finetune pool/base.safetensors pairs -r pairs -a anynet -o pool/base.safetensors --force", "BASE"),
        ("finetune pool/base.safetensors pairs -r pairs -a anynet -o link.safetensors --force", "BASE"),
        ("runs import kept.sqlite --into ./kept.sqlite", "SOURCE"),
        ("runs import kept.sqlite --into kept.sqlite-wal", "kept.sqlite-wal"),
        ("export mix.pth -f pth -o ./mix.pth --force", "FILE"),
    ],
)
def test_what_is_read_is_not_written(line: str, said: str, shell: Shell, world: Path) -> None:
    """Each of these replaced, or would have, what it was made from."""
    shell("merge pool --uniform -o mix.pth --form original")
    shell(f"evaluate pool {PAIRS} --uniform --store kept.sqlite")
    (world / "link").mkdir()
    (world / "link.safetensors").symlink_to("pool/base.safetensors")
    (world / "kept.sqlite-wal").write_bytes(b"")
    (world / "book.ipynb").write_text(json.dumps(BOOK))
    before = files(world)
    _, errors = shell(line, code=2)
    assert said in errors
    assert files(world) == before


def test_a_file_under_two_names_and_a_value_that_is_no_name(tmp_path: Path) -> None:
    """A link to the same file of the disk; and a sentence that a parameter of a notebook holds."""
    (tmp_path / "a.html").write_text("")
    (tmp_path / "b.html").hardlink_to(tmp_path / "a.html")
    places = Places()
    places.reads("-p note", Path("long. " * 100))
    places.claim("--out", tmp_path / "a.html")
    with pytest.raises(InputError, match=r"b\.html is a file that --out writes to already"):
        places.claim("--report", tmp_path / "b.html")


def test_maps_of_a_large_data_set_are_claimed_at_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each is looked at once, not once for every other."""
    looked: list[Path] = []
    marks = outputs._marks
    monkeypatch.setattr(outputs, "_marks", lambda path: (looked.append(path), marks(path))[1])
    Places().folder("--maps", tmp_path / "maps", [f"pair{number}.png" for number in range(50)])
    assert len(looked) == 50


BOOK = {
    "nbformat": 4,
    "nbformat_minor": 5,
    "metadata": {"papermill": {}},
    "cells": [
        {
            "cell_type": "code",
            "id": "a",
            "metadata": {"tags": ["parameters"]},
            "source": "store = ''",
            "outputs": [],
            "execution_count": None,
        }
    ],
}
