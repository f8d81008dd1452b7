"""The start of the command line: what is said before any work starts costs no import of heavy libraries."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file
from tiny import write_pool

import sfkit
from sfkit.architectures.names import SHIPPED
from sfkit.architectures.registry import _REGISTRY, named
from sfkit.baselines import baseline_named, baselines
from sfkit.checkpoints.headers import read_texts
from sfkit.cli.baselines import ORACLES, methods
from sfkit.cli.commands import ENTRIES, Commands
from sfkit.cli.foreseen import ensure_loadable
from sfkit.cli.groups import first_paragraph
from sfkit.cli.inspection import inspect_file
from sfkit.cli.options import NAMED, RENDERED
from sfkit.datasets.formats import write_png
from sfkit.errors import InputError
from sfkit.training.places import TRAINED

TRAINED_FILE = sfkit.bank.pool_path("bank-sharp").with_name("haze.safetensors")
HEAVY = (
    "torch",
    "pydantic",
    "numpy",
    "pandas",
    "scipy",
    "cv2",
    "plotly",
    "cma",
    "IPython",
    "nbconvert",
    "rich",
)


def test_pools_and_worlds_that_come_with_sfkit_are_known_by_name_before_any_is_opened() -> None:
    assert set(NAMED) == set(sfkit.bank.banks())
    assert set(RENDERED) == {sfkit.bank.bank_plan(name).benchmarks for name in sfkit.bank.banks()}


def test_what_comes_with_sfkit_is_known_by_name_before_torch_is_imported() -> None:
    builders = {name: named(entry.build) for name, entry in _REGISTRY.items()}
    assert set(SHIPPED) == {n for n, builder in builders.items() if builder.__module__.startswith("sfkit.")}
    own = [name for name in baselines() if baseline_named(name).function.__module__.startswith("sfkit.")]
    assert list(methods()) == own
    assert set(ORACLES) == {name for name in own if baseline_named(name).oracle}


def test_a_network_that_sfkit_trained_says_its_architecture_to_those_who_train_on() -> None:
    assert ensure_loadable(TRAINED_FILE, None, None, trained=TRAINED) == {}
    with pytest.raises(InputError, match="--architecture"):
        ensure_loadable(TRAINED_FILE, None, None)


def test_show_tells_how_a_source_was_trained(tmp_path: Path) -> None:
    shown = inspect_file(TRAINED_FILE)
    assert shown.document["training"] == json.loads(read_texts(TRAINED_FILE)[TRAINED])
    base = inspect_file(TRAINED_FILE.with_name("base.safetensors")).document["fingerprint"]
    assert shown.text.splitlines()[4:] == [
        "  trained by sfkit 0.1.0 on haze, 400 of 400 pairs: 500 steps of 8, seed 1",
        f"  base: base.safetensors ({base[:12]}), licence: Apache-2.0",
        "  licence: Apache-2.0",
    ]
    tensors = load_file(TRAINED_FILE)
    save_file(tensors, tmp_path / "short.safetensors", metadata={TRAINED: "{}"})
    assert (
        "  base: none, drawn anew, licence: not stated" in inspect_file(tmp_path / "short.safetensors").text
    )
    save_file(tensors, tmp_path / "edited.safetensors", metadata={TRAINED: "{"})
    with pytest.raises(InputError, match=r"edited\.safetensors: its sfkit\.training entry.*was it edited"):
        inspect_file(tmp_path / "edited.safetensors")
    save_file(tensors, tmp_path / "plain.safetensors")
    assert inspect_file(tmp_path / "plain.safetensors").document["training"] is None


def write_torch_files(pool: Path, folder: Path) -> None:
    """The pool's networks as torch saves them, and its pool.toml."""
    folder.mkdir()
    toml = (pool / "pool.toml").read_text()
    (folder / "pool.toml").write_text(toml.replace(".safetensors", ".tar"))
    for file in pool.glob("*.safetensors"):
        content = {"epoch": 1, "state_dict": {f"module.{k}": t for k, t in load_file(file).items()}}
        torch.save(content, folder / f"{file.stem}.tar")


LINES = f"""
import sys
from sfkit.cli import main
for line in sys.stdin.read().splitlines():
    try:
        main(line.split())
    except SystemExit as ended:
        print(ended.code)
    print("heavy:", sorted(set({HEAVY}) & set(sys.modules)))
"""


def test_help_usage_errors_and_show_import_nothing_heavy(tmp_path: Path) -> None:
    pool = sfkit.open_pool(write_pool(tmp_path / "pool"))
    sfkit.save_merged(pool, pool.equal("a"), tmp_path / "net.safetensors")
    (tmp_path / "pool.toml").write_text(
        'name = "p"\narchitecture = "anynet"\n[base]\nfile = "net.safetensors"\n[sources.a]\nfile = "a.tar"\n'
    )
    (tmp_path / "bad.toml").write_text("[base")
    (tmp_path / "unknown.toml").write_text((tmp_path / "pool.toml").read_text().replace("anynet", "anynett"))
    write_torch_files(tmp_path / "pool", tmp_path / "torch")
    (tmp_path / "text.pth").write_text("Not found")
    (tmp_path / "factory.toml").write_text(
        'name = "p"\nbase = "net.safetensors"\narchitecture = "anynet"\n[sources.a]\ndata = "nothing"\n'
        '[validation]\nname = "bank:courtyard"\n'
    )
    lines = {
        "--help": 0,
        "evaluat": 2,
        "search --help": 0,
        "search pool.toml": 2,
        "evaluate pool.toml --bogus": 2,
        "merge pool.toml": 2,
        "predict": 2,
        "search --generations many": 2,
        "search --gamma 1 much": 2,
        "search nowhere/pool.toml -b eth3d": 2,
        "predict nothing.pth --left l.png --right r.png": 2,
        "export nothing.pth": 2,
        "factory run nothing.toml": 2,
        "open nothing": 2,
        "evaluate bank -b eth3d": 2,
        "evaluate bank --subset , -b eth3d": 2,
        "evaluate bank --recipe nothing.json -b eth3d": 2,
        "merge bank --uniform --subset a -o net.safetensors": 2,
        "search bank --method bayes -b eth3d": 2,
        "search bank --population 0 -b eth3d": 2,
        "search bank --rank 0 -b eth3d": 2,
        "search pool-of-nobody -b eth3d": 2,
        "baselines bank --names , -b eth3d": 2,
        f"evaluate {tmp_path / 'bad.toml'} --uniform -b eth3d": 2,
        f"export {tmp_path / 'net.safetensors'} --format onx": 2,
        f"export {tmp_path / 'net.safetensors'} --size large": 2,
        "runs --help": 0,
        "finetune --help": 0,
        "show nothing.json": 2,
        f"show {tmp_path / 'net.safetensors'}": 0,
        f"show {TRAINED_FILE}": 0,
        f"show {tmp_path / 'pool.toml'}": 0,
        f"show {tmp_path / 'pool' / 'a.safetensors'}": 0,
        f"show {tmp_path / 'torch' / 'a.tar'}": 0,
    }
    network, world = tmp_path / "net.safetensors", "-b bank:courtyard"
    for name in ("left.png", "right.png"):
        write_png(tmp_path / name, np.zeros((64, 64, 3), np.uint8))
    views = f"--left {tmp_path / 'left.png'} --right {tmp_path / 'right.png'} -o {tmp_path / 'out'}"
    lines |= {
        "search bank --blocks modul -b eth3d": 2,
        "search bank --dtype int8 -b eth3d": 2,
        "search bank --subset haze --evaluations 0 -b eth3d": 2,
        "search bank --batch 0 -b eth3d": 2,
        "search bank --include nobody -b eth3d": 2,
        "search bank --exclude nobody -b eth3d": 2,
        "search bank --frozen nobody -b eth3d": 2,
        "search bank --start nothing.json -b eth3d": 2,
        f"search {tmp_path / 'unknown.toml'} -b eth3d": 2,
        "evaluate bank --subset nobody -b eth3d": 2,
        "merge bank --weights nobody=1 -o new.safetensors": 2,
        "baselines bank --names nobody -b eth3d": 2,
        "baselines bank --names single_best_oracle -b eth3d": 2,
        f"export {network} --size 9x9": 2,
        f"export {network} --size 64x64 --dynamic": 2,
        "report --figures gif -o page.html": 2,
        "report 01_quickstart -p sed 1 -o page.html": 2,
        f"demo --out {network}": 2,
        "runs page nowhere": 2,
        "runs export nothing.sqlite -o new.csv": 2,
        "runs import nothing.sqlite --into new.sqlite": 2,
        "search bank -b eth3d": 2,
        "compare a.pth b.pth -b kitty -r here": 2,
        "baselines bank -b eth3d -r nowhere": 2,
        "search bank -b bank:nowhere": 2,
        f"search bank {world} --metric bad": 2,
        f"search bank {world} --combine best": 2,
        f"search bank {world} --test nothing": 2,
        f"search bank {world} --test bank:courtyard": 2,
        "data check nothing -r .": 2,
        "bank build nobody": 2,
        f"finetune {network} nothing -r . -o new.safetensors": 2,
        f"search bank {world} --also eth3d": 2,
        f"search bank {world} --protocol kitti": 2,
        f"factory run {tmp_path / 'factory.toml'}": 2,
        f"factory status {tmp_path / 'factory.toml'}": 2,
        f"show {tmp_path / 'text.pth'}": 2,
    }
    if not shutil.which("nvidia-smi"):  # where one is, torch alone knows what there is
        lines |= {
            "search bank --device cuda:77 -b eth3d": 2,
        }
    with_numpy = {
        f"show {tmp_path / 'pool'}": 0,
        f"show {tmp_path / 'torch'}": 0,
        f"show {tmp_path / 'torch' / 'pool.toml'}": 0,
        f"init {tmp_path / 'pool'} --force": 0,
        "search bank --subset haze -b eth3d": 2,
        "show bank-sharp": 0,
        f"compare {network} {tmp_path / 'pool' / 'a.safetensors'} {world}": 2,
        "runs diff here here": 2,
        f"runs list {tmp_path}": 0,
    }
    with_cv2 = {
        f"predict {network} --left l.png --right r.png": 2,
        f"predict {network} --left l.png --right r.png --form png": 2,
        f"predict {tmp_path / 'torch' / 'a.tar'} {views}": 2,
        f"predict {network} --architecture nobody {views}": 2,
        f"predict {network} --option nobody=1 {views}": 2,
        f"compare {network} {tmp_path / 'torch' / 'a.tar'} {world}": 2,
        f"finetune {network} pairs -r . -o new.safetensors --crop wide": 2,
    }
    # One process for all: what one line imports would show in all that follow.
    ran = subprocess.run(
        [sys.executable, "-c", LINES],
        input="\n".join({**lines, **with_numpy, **with_cv2}),
        capture_output=True,
        text=True,
        check=True,
    )
    found = [line for line in ran.stdout.splitlines() if line.startswith("heavy: ")]
    expected = ["heavy: []"] * len(lines) + ["heavy: ['numpy']"] * len(with_numpy)
    assert found == [*expected, *["heavy: ['cv2', 'numpy']"] * len(with_cv2)], ran.stdout + ran.stderr
    codes = [int(line) for line in ran.stdout.splitlines() if line.isdecimal()]
    assert codes == list({**lines, **with_numpy, **with_cv2}.values())


@pytest.mark.parametrize("name", ENTRIES)
def test_the_list_of_commands_says_what_each_says_itself(name: str) -> None:
    command = Commands(name="sfkit").commands[name]
    assert ENTRIES[name].help == first_paragraph(command.help or "")


def test_names_are_imported_when_they_are_asked_for() -> None:
    missing = [name for name in sfkit.__all__ if not hasattr(sfkit, name)]
    assert missing == []
    assert set(sfkit.__all__) <= set(dir(sfkit))
    with pytest.raises(AttributeError, match="module 'sfkit' has no attribute 'open_pol'"):
        sfkit.open_pol  # noqa: B018


@pytest.mark.parametrize("texts", [[], None, 3, {"a": 1}])
def test_texts_of_another_form_are_refused_in_a_sentence(texts: object, tmp_path: Path) -> None:
    header = json.dumps({"__metadata__": texts}).encode()
    (tmp_path / "net.safetensors").write_bytes(len(header).to_bytes(8, "little") + header)
    if texts is None:
        assert read_texts(tmp_path / "net.safetensors") == {}, "as safetensors has it"
        return
    with pytest.raises(InputError, match=r"net\.safetensors: cannot be read as safetensors"):
        read_texts(tmp_path / "net.safetensors")


@pytest.mark.parametrize(
    "entry",
    [
        {"shape": [-1, -2], "data_offsets": [0, 8]},
        {"shape": [2.0], "data_offsets": [0, 8]},
        {"shape": [2], "data_offsets": [0.0, 8.0]},
        {"shape": [True, 2], "data_offsets": [0, 8]},
        {"shape": [2], "data_offsets": ["0", "8"]},
    ],
)
def test_numbers_that_count_nothing_are_refused_in_a_sentence(
    entry: dict[str, object], tmp_path: Path
) -> None:
    header = json.dumps({"w": {"dtype": "F32", **entry}}).encode()
    (tmp_path / "net.safetensors").write_bytes(len(header).to_bytes(8, "little") + header + bytes(8))
    with pytest.raises(InputError, match=r"net\.safetensors: cannot be read as safetensors"):
        inspect_file(tmp_path / "net.safetensors")
