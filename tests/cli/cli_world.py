"""A working folder full of good and bad things to hand to the command line."""

from __future__ import annotations

import json
import shutil
import sqlite3
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import nbformat
import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file
from tiny import write_pairs, write_pool

from sfkit import Elect, FisherMean, Trim
from sfkit.cli import main
from sfkit.datasets.pfm import write_pfm
from sfkit.merging import Recipe, open_pool
from sfkit.merging.saving import save_merged

SOURCES = {"a": "kitti", "b": "driving", "c": "indoor"}
BLOCKS = ("backbone", "neck", "cost_volume", "head")


class Shell:
    """Runs command lines in this process."""

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self.capsys = capsys

    def __call__(self, line: str, code: int = 0) -> tuple[str, str]:
        with pytest.raises(SystemExit) as ended:
            main(line.split())
        out, errors = self.capsys.readouterr()
        assert ended.value.code == code, errors
        return out, errors

    def json(self, line: str, code: int = 0) -> Any:
        """The one document on standard output, which holds nothing else."""
        out, _ = self(f"{line} --json", code)
        document, end = json.JSONDecoder().raw_decode(out)
        assert out[end:] == "\n"
        return document


def make_world(folder: Path) -> Path:
    """Everything the cases name, in some twenty megabytes."""
    rename_sources(write_pool(folder / "pool"))
    write_pairs(folder / "pairs", 2)
    _bad_pools(folder)
    _bad_pairs(folder)
    _recipes(folder)
    _files(folder)
    return folder


def rename_sources(toml: Path) -> None:
    """Give the sources of a tiny pool names that can be misspelt."""
    text = toml.read_text()
    for short, name in SOURCES.items():
        text = text.replace(f"[sources.{short}]", f"[sources.{name}]")
    toml.write_text(text)


def _pool(folder: Path, edit: Callable[[str], str] = str) -> Path:
    """A copy of the sound pool with its description edited."""
    shutil.copytree(folder.parent / "pool", folder)
    toml = folder / "pool.toml"
    toml.write_text(edit(toml.read_text()))
    return folder


def _bad_pools(world: Path) -> None:
    """One folder a fault; the fault lies in ``a``, which the pool calls kitti, or in ``pool.toml``."""

    def faulty(name: str, state: dict[str, torch.Tensor]) -> None:
        save_file(state, _pool(world / name) / "a.safetensors")

    sound = load_file(world / "pool" / "a.safetensors")
    key = "feature_extraction.block0.0.0.weight"
    faulty("wrong-key", {("other" if k == key else k): v for k, v in sound.items()})
    faulty("extra-key", {**sound, "decoder.weight": torch.ones(2, 2)})
    faulty("wrong-shape", {**sound, key: sound[key][:, :1].contiguous()})
    faulty("nan", {**sound, key: torch.full_like(sound[key], torch.nan)})
    faulty("twins", load_file(world / "pool" / "b.safetensors"))
    cut = _pool(world / "truncated") / "a.safetensors"
    cut.write_bytes(cut.read_bytes()[:5000])
    (_pool(world / "empty") / "a.safetensors").write_bytes(b"")
    _torch_file(world / "pickled", {"state_dict": sqlite3.Row})
    _torch_file(world / "no-state", {"epoch": 3, "loss": 0.5})
    cut = _torch_file(world / "truncated-torch", sound)
    cut.write_bytes(cut.read_bytes()[:-2000])
    (_pool(world / "absent") / "a.safetensors").rename(world / "absent" / "a_.safetensors")
    (_pool(world / "no-base") / "base.safetensors").unlink()
    _pool(world / "one-source", lambda text: text[: text.index("[sources.driving")])
    (world / "outside.safetensors").write_bytes((world / "pool" / "a.safetensors").read_bytes())
    link = _pool(world / "link") / "a.safetensors"
    link.unlink()
    link.symlink_to(world / "outside.safetensors")
    for name, old, new in (
        ("bad-toml", "[base]", "[base"),
        ("unknown-key", "[base]\nfile", '[base]\nfiel = "x"\nfile'),
        ("unknown-table", "[options]", "[optoins]"),
        ("leaves-root", '"a.safetensors"', '"../outside.safetensors"'),
        ("absolute", '"a.safetensors"', f'"{world / "outside.safetensors"}"'),
        ("wrong-ending", '"a.safetensors"', '"a.onnx"'),
        ("no-variable", 'name = "tiny"', 'name = "tiny"\nroot = "${SFKIT_NOT_SET}/x"'),
        ("architecture", '"anynet"', '"anynnet"'),
        ("option", "spn = false", "snp = false"),
        ("blocks", "[base]", '[blocks]\nall = ["feature_extration.*"]\n[base]'),
    ):
        _pool(world / name, lambda text, old=old, new=new: text.replace(old, new, 1))
    _pool(world / "no-sources", lambda text: text[: text.index("[sources")])


def _torch_file(folder: Path, content: object) -> Path:
    """A pool whose kitti is a torch file with this content."""
    _pool(folder, lambda text: text.replace('"a.safetensors"', '"a.pth"'))
    torch.save(content, folder / "a.pth")
    return folder / "a.pth"


def _bad_pairs(world: Path) -> None:
    """One folder a fault, the fault in ``pair0``."""

    def copy(name: str) -> Path:
        shutil.copytree(world / "pairs", world / name)
        return world / name / "pair0"

    cv2.imwrite(str(copy("unequal") / "right.png"), np.zeros((40, 96, 3), np.uint8))
    cv2.imwrite(str(copy("deep-image") / "left.png"), np.zeros((48, 96, 3), np.uint16))
    write_pfm(copy("invalid") / "disparity.pfm", np.full((48, 96), np.inf, np.float32))
    write_pfm(copy("other-size") / "disparity.pfm", np.full((24, 48), 5, np.float32))
    truth = copy("cut-truth") / "disparity.pfm"
    truth.write_bytes(truth.read_bytes()[:-100])
    image = copy("cut-image") / "left.png"
    image.write_bytes(image.read_bytes()[:-100])
    for name, hint in (
        ("eight-bit", 'coding = "png16"\n'),
        ("no-coding", ""),
        ("bad-hint", 'codign = "x"\n'),
    ):
        pair = copy(name)
        (pair / "disparity.pfm").unlink()
        cv2.imwrite(str(pair / "disparity.png"), np.full((48, 96), 5, np.uint8))
        if hint:
            (pair / "pairs.toml").write_text(hint)
    for number in (0, 1):
        (world / "no-truth" / f"pair{number}").mkdir(parents=True)
        shutil.copy(world / "pairs" / f"pair{number}" / "left.png", world / "no-truth" / f"pair{number}")
    (world / "nothing").mkdir()
    scene = world / "eth3d" / "two_view_training" / "delivery_area_1l"
    truth = world / "eth3d" / "two_view_training_gt" / "delivery_area_1l"
    scene.mkdir(parents=True), truth.mkdir(parents=True)
    for name, source in (("im0", "left"), ("im1", "right")):
        shutil.copy(world / "pairs" / "pair0" / f"{source}.png", scene / f"{name}.png")
    shutil.copy(world / "pairs" / "pair0" / "disparity.pfm", truth / "disp0GT.pfm")
    row = "pair0/left.png,pair0/right.png,pair0/disparity.pfm"
    for name, text in (
        ("column", f"left,right,disparty\n{row}\n"),
        ("absent", "left,right,disparity\npair0/left.png,pair0/rigth.png,pair0/disparity.pfm\n"),
        ("leaves", "left,right,disparity\n../unequal/pair0/left.png,pair0/right.png,pair0/disparity.pfm\n"),
        ("no-row", "left,right,disparity\n"),
    ):
        (world / f"{name}.csv").write_text(text)


def _recipes(world: Path) -> None:
    names = tuple(SOURCES.values())
    good = Recipe.equal(names, BLOCKS)
    one = Recipe.weighted({"ties": 1.0}, BLOCKS)
    fisher = FisherMean("0", on="eth3d", name="ties")
    texts = {
        "good": good.to_json(),
        "strong": Recipe.weighted({"kitti": 0.5, "driving": 0.5}, BLOCKS, scale=2.0).to_json(),
        "other-pool": Recipe.equal(("sintel", "kitty"), BLOCKS).to_json(),
        "other-blocks": Recipe.equal(names, ("backbone", "head")).to_json(),
        "not-json": good.to_json()[:-20],
        "list": "[1, 2]",
        "no-format": "{}",
        "lacking": json.dumps({k: v for k, v in good.as_dict().items() if k != "scales"}),
        "malformed": json.dumps({**good.as_dict(), "weights": [0.5, 0.5]}),
        "nan": good.to_json().replace("0.3333333333333333", "NaN", 1),
        "no-step": replace(one, preparation=(Elect(),)).to_json().replace('"elect"', '"elekt"'),
        "step-source": replace(one, preparation=(Trim(), Elect(sources=("kiti",)))).to_json(),
        "step-name": replace(one, preparation=(Trim(), Elect("other"))).to_json(),
        "step-fisher": replace(one, preparation=(fisher,)).to_json(),
    }
    for name, text in texts.items():
        (world / f"{name}.json").write_text(text)


def _files(world: Path) -> None:
    pool = open_pool(world / "pool")
    merged = save_merged(pool, pool.uniform(), world / "merged.safetensors")
    tensors = load_file(merged)
    edits: dict[str, dict[str, str]] = {
        "edited-json": {"sfkit.recipe": "{"},
        "edited-form": {"sfkit.architecture": '"anynet"'},
        "edited-member": {"sfkit.base": '{"file": "x"}'},
    }
    whole = {f"sfkit.{k}": v for k, v in _metadata(merged).items()}
    for name, edit in edits.items():
        save_file(tensors, world / f"{name}.safetensors", metadata=whole | edit)
    save_file(tensors, world / "lacks-entries.safetensors", metadata={"sfkit.recipe": whole["sfkit.recipe"]})
    broken = {k: torch.full_like(v, torch.inf) if v.is_floating_point() else v for k, v in tensors.items()}
    save_file(broken, world / "infinite.safetensors", metadata=whole)
    (world / "garbage.sqlite").write_bytes(b"this is no database at all" * 100)
    (world / "empty.sqlite").touch()
    with sqlite3.connect(world / "other.sqlite") as db:
        db.execute("CREATE TABLE notes (text TEXT)")
    db.close()
    (world / "calib.txt").write_text("cam0=[100 0 48; 0 100 24; 0 0 1]\ndoffs=0\n")
    (world / "sized.txt").write_text(
        "cam0=[542 0 541; 0 542 255; 0 0 1]\ndoffs=0\nbaseline=60\nwidth=941\nheight=490\n"
    )
    (world / "no.mp4").write_bytes(b"no video" * 100)
    (world / "three").mkdir()
    for name in ("x", "y", "z"):
        shutil.copy(world / "pairs" / "pair0" / "left.png", world / "three" / f"{name}.png")
    (world / "scores.csv").write_text("mine\n")
    (world / "earlier").mkdir()
    (world / "earlier" / "left.pfm").write_text("mine\n")
    (world / "kept").mkdir()
    shutil.copy(merged, world / "kept" / "merged.safetensors")
    book = nbformat.v4.new_notebook()
    book.cells = [nbformat.v4.new_code_cell("seed = 0\npool = 'x'", metadata={"tags": ["parameters"]})]
    nbformat.write(book, world / "book.ipynb")
    (world / "broken.ipynb").write_text("{}")


def _metadata(path: Path) -> dict[str, str]:
    from sfkit.checkpoints import read_checkpoint

    found = read_checkpoint(path).metadata
    return {k.removeprefix("sfkit."): v for k, v in found.items() if k.startswith("sfkit.")}
