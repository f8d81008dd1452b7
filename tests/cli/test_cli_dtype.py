"""``--dtype`` chooses what the written network is made of."""

from __future__ import annotations

from pathlib import Path

from cli_world import Shell
from safetensors.torch import load_file

PAIRS = "-b pairs -r pairs"
SEARCH = f"search pool {PAIRS} --population 3 --generations 0 --evaluations 0 --yes -o run"


def kinds(file: str) -> set[str]:
    return {str(tensor.dtype) for tensor in load_file(file).values() if tensor.is_floating_point()}


def test_merge_and_search_write_the_type_that_is_asked_for(shell: Shell) -> None:
    shell("merge pool --uniform -o half.safetensors --dtype float16")
    assert kinds("half.safetensors") == {"torch.float16"}
    whole = shell.json(SEARCH)
    assert kinds("run/merged.safetensors") == {"torch.float32"}
    _, errors = shell(f"{SEARCH} --dtype bfloat16", code=2)
    assert "holds another search" in errors
    found = shell.json(f"{SEARCH} --dtype bfloat16 --force")
    assert kinds("run/merged.safetensors") == {"torch.bfloat16"}
    assert found["evaluations"]["computed"] == whole["evaluations"]["computed"], "other networks"
    assert found["score"] != whole["score"]


def test_an_unknown_type_is_refused_before_any_work(shell: Shell) -> None:
    for file in Path("pool").glob("*.safetensors"):
        file.unlink()  # nothing is read
    _, errors = shell("merge pool --uniform -o half.safetensors --dtype float", code=2)
    assert "unknown --dtype 'float', expected one of: bfloat16, float16, float32" in errors
