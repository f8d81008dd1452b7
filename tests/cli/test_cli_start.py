"""The start of the command line: what is said before any work starts costs no import of heavy libraries."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
import torch
from safetensors.torch import load_file
from tiny import write_pool

import sfkit
from sfkit.checkpoints.headers import read_texts
from sfkit.cli.commands import ENTRIES, Commands
from sfkit.cli.groups import first_paragraph
from sfkit.cli.inspection import inspect_file
from sfkit.cli.options import NAMED
from sfkit.errors import InputError

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


def test_pools_that_come_with_sfkit_are_known_by_name_before_any_is_opened() -> None:
    assert set(NAMED) == set(sfkit.bank.banks())


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
    write_torch_files(tmp_path / "pool", tmp_path / "torch")
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
        f"show {tmp_path / 'pool.toml'}": 0,
        f"show {tmp_path / 'pool' / 'a.safetensors'}": 0,
        f"show {tmp_path / 'torch' / 'a.tar'}": 0,
    }
    with_numpy = {
        f"show {tmp_path / 'pool'}": 0,
        f"show {tmp_path / 'torch'}": 0,
        f"show {tmp_path / 'torch' / 'pool.toml'}": 0,
        f"init {tmp_path / 'pool'} --force": 0,
    }
    with_cv2 = {
        f"runs list {tmp_path}": 0,
        "runs diff here here": 2,
        "search bank -b eth3d": 2,
        "compare a.pth b.pth -b kitty -r here": 2,
        "baselines bank -b eth3d -r nowhere": 2,
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
