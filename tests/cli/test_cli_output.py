"""What commands print: one JSON document or plain text, progress and warnings apart, help that teaches."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import nbformat
import pandas as pd
import pytest
import torch
import typer
from cli_world import Shell
from safetensors.torch import load_file, save_file
from tiny import base_state, write_pairs

from sfkit import Elect, Evaluator, Trim, open_benchmark, prepare
from sfkit.baselines import running
from sfkit.checkpoints.reading import read_checkpoint
from sfkit.cli.app import app
from sfkit.evaluation import EvaluationStore
from sfkit.merging import LiveModel, Recipe, open_pool
from sfkit.merging.origin import read_recipe

PAIRS = "-b pairs -r pairs"


def commands() -> Iterator[tuple[str, Any]]:
    """Every command of the application with its full name."""
    group = typer.main.get_command(app)
    for name, command in group.commands.items():  # type: ignore[attr-defined]
        inner = getattr(command, "commands", {})
        yield from ((f"{name} {sub}", found) for sub, found in inner.items())
        if not inner:
            yield name, command


@pytest.mark.parametrize("name", [name for name, _ in commands()])
def test_help_teaches_by_example(name: str, shell: Shell) -> None:
    text, _ = shell(f"{name} --help")
    lines = [line.strip() for line in text.splitlines()]
    assert any(line in ("Example:", "Examples:") for line in lines)
    assert any(line.startswith(f"sfkit {name}") for line in lines)


def test_every_command_reports_as_json() -> None:
    lacking = [n for n, c in commands() if not any("--json" in option.opts for option in c.params)]
    assert lacking == []


def test_no_command_lists_them(shell: Shell) -> None:
    _, text = shell("", code=2)
    assert "search" in text
    assert "error:" not in text


def test_version(shell: Shell) -> None:
    out, _ = shell("--version")
    assert out.split()[0] == "sfkit"


def test_evaluate(shell: Shell, world: Path) -> None:
    line = f"evaluate pool {PAIRS} --members --uniform --all-subsets --metric bad-1.0 --store s.sqlite"
    document = shell.json(f"{line} -o tables/scores.csv")
    rows = document["scores"]
    assert [row["network"] for row in rows] == [
        "base", "kitti", "driving", "indoor", "kitti+driving", "kitti+indoor", "driving+indoor",
        "kitti+driving+indoor", "uniform",
    ]  # fmt: skip
    scores = {row["network"]: row["score"] for row in rows}
    assert scores["uniform"] == scores["kitti+driving+indoor"]
    assert document["best"] == min(scores, key=scores.__getitem__)
    assert document["benchmark"]["protocol"] == "all-valid"
    assert {row["unit"] for row in rows} == {"%"}
    table = pd.read_csv(world / "tables" / "scores.csv")
    assert table["score"].tolist() == pytest.approx(list(scores.values()))
    with EvaluationStore(world / "s.sqlite") as store:
        assert len(store) == 8, "the uniform merge is the subset of all"
    text, progress = shell(line)
    assert re.search(rf"^base +{scores['base']:.3f}$", text, re.MULTILINE)
    assert text.splitlines()[1].split() == ["network", "bad-1.0", "[%]"]
    assert max(map(len, text.splitlines())) <= 80
    assert "bad-1.0 under protocol all-valid on pairs (2 pairs)" in text
    assert progress.splitlines()[-1] == "pairs: 8 of 8 networks scored", "all from the store"


def test_evaluate_a_recipe_and_the_sources_of_another(shell: Shell) -> None:
    shell("merge pool --weights kitti=0.25,indoor=0.75 -o mix.safetensors")
    document = shell.json(f"evaluate pool {PAIRS} --recipe mix.safetensors --subset-from mix.safetensors")
    names = [row["network"] for row in document["scores"]]
    assert names == ["sources of mix.safetensors", "mix.safetensors"]
    assert document["scores"][0]["score"] != document["scores"][1]["score"]


METHODS = "uniform,ties,stage1,random_subsets"


def test_baselines(shell: Shell, world: Path) -> None:
    line = (
        f"baselines pool {PAIRS} --names {METHODS} --population 4 --generations 2 --seed 3 --store s.sqlite"
    )
    document = shell.json(f"{line} -o table.csv")
    rows = {row["name"]: row for row in document["baselines"]}
    assert list(rows) == METHODS.split(",")
    assert document["unit"] == "px"
    assert document["skipped"] == {}
    (uniform,) = shell.json(f"evaluate pool {PAIRS} --uniform")["scores"]
    assert rows["uniform"]["score"] == uniform["score"]
    assert rows["random_subsets"]["evaluations"] <= rows["stage1"]["evaluations"], "an equal budget"
    table = pd.read_csv(world / "table.csv", index_col="method")
    assert table["validation"].tolist() == pytest.approx([row["score"] for row in rows.values()])
    assert table.loc["TIES", "evaluations"] == rows["ties"]["evaluations"]
    (world / "ties.json").write_text(json.dumps(rows["ties"]["recipe"]))
    (again,) = shell.json(f"evaluate pool {PAIRS} --recipe ties.json")["scores"]
    assert again["score"] == rows["ties"]["score"], "the recipe rebuilds the network that was scored"
    text, progress = shell(line)
    assert "epe on pairs (protocol all-valid): what tunes them" in text
    assert f"{rows['ties']['score']:.3f} px" in next(t for t in text.splitlines() if t.startswith("TIES"))
    assert "4 of 4 methods done" in progress


def test_the_stages_are_set_as_in_a_search(shell: Shell) -> None:
    told = "--population 4 --generations 2 --crossover 0.2 --mutation 0.9 --seed 3"
    told += " --evaluations 6 --sigma 0.2 --rank 1"
    document = shell.json(f"baselines pool {PAIRS} --names stage1,stage1_2 {told}")
    which, both = (row["score"] for row in document["baselines"])
    found = shell.json(f"search pool {PAIRS} {told} --yes --out found")
    assert (which, both) == (found["stage1"], found["stage2"])
    assert both < which, "so that settings of Stage 2 are seen"
    assert (document["stage1"]["crossover"], document["stage1"]["mutation"]) == (0.2, 0.9)
    assert (document["stage2"]["rank"], document["stage2"]["tied"]) == (1, False)
    _, refused = shell(f"baselines pool {PAIRS} --evaluations 0", 2)
    assert "evaluations: found 0, expected a whole number of at least 1" in refused


def test_baselines_on_two_benchmarks_take_their_worst(shell: Shell, world: Path) -> None:
    write_pairs(world / "more", 3)
    line = f"baselines pool {PAIRS} --names uniform --also pairs,root=more"
    both = {how: shell.json(f"{line} --combine {how}") for how in ("mean", "worst")}
    assert (both["worst"]["validation"], both["worst"]["combine"]) == (["pairs", "more"], "worst")
    scores = [
        shell.json(f"evaluate pool -b pairs -r {root} --metric epe --uniform")["scores"][0]["score"]
        for root in ("pairs", "more")
    ]
    assert both["worst"]["baselines"][0]["score"] == pytest.approx(max(scores))
    assert both["mean"]["baselines"][0]["score"] == pytest.approx(sum(scores) / 2)


def test_baselines_that_do_not_suit_are_told(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(running, "baselines", lambda: ("uniform", "single_best_oracle"))
    assert list(shell.json(f"baselines pool {PAIRS}")["skipped"]) == ["single_best_oracle"]
    text, _ = shell(f"baselines pool {PAIRS}")
    (line,) = [line for line in text.splitlines() if "skipped: " in line]
    assert line.startswith("single best (oracle)")
    assert "found no tests" in line


def test_merge_and_show(shell: Shell, world: Path) -> None:
    document = shell.json("merge pool --subset kitti,indoor -o merged.safetensors")
    assert document["file"] == "merged.safetensors"
    assert document["recipe"]["sources"] == ["kitti", "indoor"]
    assert document["licences"] == {"base": "CC0-1.0", "kitti": "licence of a", "indoor": "licence of c"}
    shown = shell.json("show merged.safetensors")
    assert shown["kind"] == "merged network"
    assert shown["origin"]["recipe"] == document["recipe"]
    text, _ = shell("show merged.safetensors")
    assert "licence of c" in text
    assert "weights 0.500 0.500  scale 1.000" in text
    (world / "recipe.json").write_text(read_recipe(world / "merged.safetensors").to_json())
    assert shell.json("show recipe.json")["recipe"] == document["recipe"]
    pool = shell.json("show pool")
    assert pool["members"]["kitti"]["exists"]
    assert pool["kinships"]["kitti"]["cosine"] == open_pool("pool").sources[0].kinship.cosine
    assert sum(pool["blocks"].values()) <= open_pool("pool").layout.size
    assert "cosine to the base" in shell("show pool")[0]
    assert shell.json("show pool/a.safetensors")["architectures"] == ["anynet"]
    (world / "apart").mkdir()
    for name in ("base", "a", "b"):
        shutil.copy(world / "pool" / f"{name}.safetensors", world / "apart")
    folder = shell.json("show apart")
    assert (folder["architecture"], folder["base"]) == ("anynet", "base.safetensors")
    assert set(folder["cosines"]) == {"base.safetensors", "a.safetensors", "b.safetensors"}
    shell(f"evaluate pool {PAIRS} --uniform --store s.sqlite")
    assert shell.json("show s.sqlite")["evaluations"] == 1


def test_a_recipe_with_steps_is_rebuilt_bit_for_bit(shell: Shell, world: Path) -> None:
    """From its JSON, from the merged file, and from the torch file beside which it lies."""
    pool = open_pool("pool")
    made = prepare(pool, Trim(0.3), Elect(sources=("kitti", "indoor")))
    recipe = made.signed(Recipe.weighted({"ties": 1.3}, made.blocks))
    expected = made.state_dict(recipe)
    (world / "ties.json").write_text(recipe.to_json())
    document = shell.json("merge pool --recipe ties.json -o ties.safetensors")
    assert document["recipe"] == recipe.as_dict()
    assert list(document["licences"]) == ["base", "kitti", "indoor"], "of all that the steps made one of"
    shell("merge pool --recipe ties.safetensors -o again.safetensors")
    shell("merge pool --recipe again.safetensors -o torch.pth --form original")
    assert (world / "again.safetensors").read_bytes() == (world / "ties.safetensors").read_bytes()
    for found in (load_file(world / "ties.safetensors"), read_checkpoint(world / "torch.pth").tensors):
        assert found.keys() == expected.keys()
        assert all(torch.equal(found[key], expected[key]) for key in expected)
    plain = pool.state_dict(pool.equal("kitti", "indoor"))
    assert not all(torch.equal(plain[key], expected[key]) for key in expected)
    (outcome,) = Evaluator(made, open_benchmark("pairs", "pairs"))([recipe])
    for file in ("ties.json", "again.safetensors"):
        rows = shell.json(f"evaluate pool {PAIRS} --subset kitti,indoor --recipe {file}")["scores"]
        assert [row["network"] for row in rows] == ["kitti+indoor", file]
        assert rows[1]["score"] == outcome.score != rows[0]["score"]


def test_the_original_form_says_its_origin_too(shell: Shell) -> None:
    shell("merge pool --uniform -o merged.pth --form original")
    assert shell.json("show merged.pth")["origin"]["pool"] == "tiny"


def test_search(shell: Shell, world: Path) -> None:
    line = f"search pool {PAIRS} --population 4 --generations 1 --evaluations 6 -o run --yes"
    document = shell.json(line)
    assert document["stage2"] <= document["stage1"], "x = 0 is the merge that Stage 1 scored"
    assert document["score"] == document["stage2"]
    assert document["folder"] == "run"
    assert document["evaluations"]["computed"] > 0
    stored = json.loads((world / "run" / "result.json").read_text())
    assert stored.items() <= document.items()
    assert read_recipe(world / "run" / "merged.safetensors").as_dict() == document["recipe"]
    assert document["verdict_evaluations"]["computed"] > 0, "base, at least, is no subset"
    verdict = document["verdict"]
    assert verdict["recommended"] == verdict["preferred_by_validation"], "there is no test to overrule it"
    assert verdict["networks"]["Stage 1+2"]["validation"] == pytest.approx(document["score"])
    text, progress = shell(line)
    assert text.startswith(verdict["sentence"])
    assert "cost: at most 10 evaluations of 2 pairs" in progress, "4 subsets exist of 3 sources, and 6"
    assert "verdict: at most 0 evaluations more, 0 image pairs" in progress, "all are in the store by now"
    assert "few pairs: what Stage 2 gains on 2 need not show elsewhere" in progress
    assert f"best epe: {document['score']:.2f} px" in text


def test_a_search_averages_the_winners_of_resamples(shell: Shell, world: Path) -> None:
    line = f"search pool {PAIRS} --population 4 --generations 1 --evaluations 6 --resamples 30 -o mean --yes"
    document = shell.json(line)
    verdict = document["verdict"]
    assert verdict["recommended"] == verdict["preferred_by_validation"] == "averaged winner"
    assert verdict["networks"]["averaged winner"]["validation"] == pytest.approx(document["averaged"])
    assert document["score"] == document["averaged"] != document["stage2"]
    assert read_recipe(world / "mean" / "merged.safetensors").as_dict() == document["recipe"]
    text, progress = shell(line)
    assert "cost: at most 11 evaluations of 2 pairs" in progress, "4 subsets, 6, and the average"
    assert text.startswith("Deploy averaged winner: ")
    assert [row.split()[0] for row in text.splitlines()[2:8]] == [
        *("base", "best", "uniform", "Stage", "Stage", "averaged")
    ]
    assert f"averaged winner, epe: {document['score']:.2f} px" in text
    assert "candidates win 30 resamples)" in text
    _, refusal = shell(f"{line} --shrinkage 0.1 --force", code=2)
    assert "resamples: found shrinkage 0.1" in refusal


@pytest.mark.parametrize(
    ("more", "averages"),
    [
        ("", True),
        ("--resamples 0", False),
        ("--shrinkage 0.1", False),
        ("--largest 2", False),
    ],
)
def test_a_search_by_a_model_returns_the_average_unless_told_otherwise(
    shell: Shell, world: Path, more: str, averages: bool
) -> None:
    """The paper's returns the best on validation, as the tests above have it."""
    out = f"by-model{more.replace(' ', '')}"
    line = (
        f"search pool {PAIRS} --method bayesian --population 2 --generations 1 --evaluations 4 -o {out} --yes"
    )
    _, progress = shell(f"{line} {more}")
    said = "returns: the average of what wins 200 resamples of the pairs; --resamples 0: the best on them"
    assert (said in progress) == averages
    assert (world / out / "winners.csv").exists() == averages


def test_a_search_is_tested_on_what_guided_nothing(shell: Shell, world: Path) -> None:
    write_pairs(world / "fresh" / "pairs", 6, shift=4)
    line = f"search pool {PAIRS} --population 4 --generations 1 --evaluations 0 -o tested --yes"
    text, progress = shell(f"{line} --test pairs,root=fresh/pairs")
    assert "verdict: at most 10 evaluations more, 44 image pairs" in progress, "4 on 2 pairs, 6 on 6"
    head, *rows = text.splitlines()[1:6]
    assert head.split()[:3] == ["network", "validation", "unseen"]
    assert [row.split()[0] for row in rows] == ["base", "best", "uniform", "Stage"]
    scored = shell.json("evaluate pool -b pairs -r fresh/pairs --uniform")["scores"][0]["score"]
    assert f"{scored:.2f}" in rows[2].split()
    assert "On what guided nothing (pairs (2))" in text
    stored = json.loads((world / "tested" / "result.json").read_text())["verdict"]
    assert stored["tests"] == ["pairs (2)"], "two folders of one name are told apart"
    assert stored["networks"]["uniform"]["unseen"] == pytest.approx(scored)
    _, refusal = shell(f"{line} --test pairs,root=pairs", code=2)
    assert "among the pairs that guide the search" in refusal


def test_search_guarded_on_two_benchmarks(shell: Shell, world: Path) -> None:
    write_pairs(world / "more", 3)
    guards = "--also pairs,root=more --holdout 0.4 --shrinkage 0.01 --blocks modules:3 --rank 1"
    line = f"search pool {PAIRS} {guards} --subset kitti,driving --evaluations 8 -o new --yes"
    document = shell.json(line)
    assert (document["validation"], document["combine"]) == (["pairs", "more"], "mean")
    assert document["recipe"]["blocks"] == ["part1", "part2", "part3"]
    check = document["holdout"]
    assert (check["folds"], check["metric"]) == (1, "epe")
    assert check["chosen"] <= 0.0, "chosen on the held-out pairs"
    text, progress = shell(line)
    assert "validation: more (3 pairs), epe" in progress
    assert "pairs that guide" in text
    assert "few pairs" not in progress


def test_data_check(shell: Shell) -> None:
    document = shell.json("data check pairs -r pairs")
    assert document["ok"]
    assert document["found"] == 2
    text, _ = shell("data check pairs -r pairs")
    assert "found 2 pairs" in text


def test_data_that_is_not_usable_ends_with_1(shell: Shell, world: Path) -> None:
    shutil.copy(world / "pairs/pair0/left.png", world / "pairs/pair0/right.png")
    document = shell.json("data check pairs -r pairs", code=1)
    assert not document["ok"]


def test_report(shell: Shell, world: Path) -> None:
    book = nbformat.v4.new_notebook()
    cell = nbformat.v4.new_code_cell("name = 'x'\nsizes = [1]", metadata={"tags": ["parameters"]})
    book.cells = [cell, nbformat.v4.new_code_cell("print(name, sum(sizes))\nassert name != 'bad'")]
    nbformat.write(book, world / "book.ipynb")
    document = shell.json("report book.ipynb -p name 750 -p sizes [2,3] -o page.html")
    assert document == {"report": "page.html"}
    assert "750 5" in (world / "page.html").read_text(), "text stays text where the default is text"
    _, errors = shell("report book.ipynb -p name bad -o bad.html", code=1)
    assert "bad.html shows it" in errors
    assert "AssertionError" in (world / "bad.html").read_text()


def test_a_random_network_among_the_sources_warns(shell: Shell, world: Path) -> None:
    save_file(base_state(seed=99), world / "pool" / "b.safetensors")
    out, errors = shell(f"evaluate pool {PAIRS} --uniform")
    (warning,) = [line for line in errors.splitlines() if line.startswith("warning: ")]
    assert "pool/b.safetensors" in warning
    assert "'driving' does not look like a fine-tune of the base" in warning
    assert "warning" not in out


def test_exchanged_images_warn_once_for_the_benchmark(shell: Shell, world: Path) -> None:
    for pair in sorted((world / "pairs").iterdir()):
        (pair / "left.png").rename(pair / "kept.png")
        (pair / "right.png").rename(pair / "left.png")
        (pair / "kept.png").rename(pair / "right.png")
    _, errors = shell(f"evaluate pool {PAIRS} --all-subsets")
    (warning,) = [line for line in errors.splitlines() if line.startswith("warning: ")]
    assert "pair 'pair0' looks wrong (like 1 of the other 1)" in warning
    assert "left and right look exchanged" in warning


def test_weights_that_overflow_score_as_wrong_everywhere(shell: Shell, world: Path) -> None:
    huge = {
        k: v * 1e30 if v.is_floating_point() else v
        for k, v in load_file(world / "pool/a.safetensors").items()
    }
    save_file(huge, world / "pool" / "a.safetensors")
    text, errors = shell(f"evaluate pool {PAIRS} --subset kitti --metric bad-1.0")
    assert re.search(r"^kitti +100\.000$", text, re.MULTILINE)
    assert text.endswith("kitti: not finite on 2 of 2 images\n")
    assert errors.count("warning: ") == 1


def test_a_network_that_fails_is_told_beside_those_that_do_not(
    shell: Shell, monkeypatch: pytest.MonkeyPatch
) -> None:
    disparity = LiveModel.disparity

    def failing(model: LiveModel, *images: Any) -> Any:
        if model.recipe.sources == ("kitti",):
            raise RuntimeError("out of memory,\nreally")
        return disparity(model, *images)

    monkeypatch.setattr(LiveModel, "disparity", failing)
    text, _ = shell(f"evaluate pool {PAIRS} --members")
    kitti = next(line for line in text.splitlines() if line.startswith("kitti"))
    assert kitti.split(maxsplit=1)[1] == "failed: RuntimeError: out of memory, really"
    assert text.count("failed") == 1
    document = shell.json(f"evaluate pool {PAIRS} --members")
    failures = {row["network"]: row["failure"] for row in document["scores"]}
    assert [name for name, failure in failures.items() if failure is not None] == ["kitti"]
    assert shell.json(f"evaluate pool {PAIRS} --subset kitti", code=1)["best"] is None, "nothing has a score"


def test_one_recipe_is_one_file_to_the_last_byte(shell: Shell, world: Path) -> None:
    for name, form in (("safetensors", "safetensors"), ("pth", "original")):
        shell(f"merge pool --uniform -o one.{name} --form {form}")
        shell(f"merge pool --uniform -o other.{name} --form {form}")
        assert (world / f"one.{name}").read_bytes() == (world / f"other.{name}").read_bytes()
