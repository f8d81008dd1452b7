"""Networks that are not sfkit's, from the command line alone: every engine knows them."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import pytest
import torch
from clusters import two_nodes
from own_networks import decorated, package, plain, write_states
from stand_ins import write_stand_in
from tiny import write_pairs

from sfkit.architectures import code
from sfkit.cli import main


def own(write: Callable[[Path], Path], folder: Path) -> Path:
    """A pool of a network of the user's, with its checkpoints."""
    write_states(folder)
    return write(folder)


POOLS: dict[str, Callable[[Path], Path]] = {
    "file": partial(own, decorated),
    "class": partial(own, plain),
    "entry point": partial(own, package),
    "openstereo": partial(write_stand_in, "openstereo"),
    "raft-stereo": partial(write_stand_in, "raft-stereo"),
}


@pytest.fixture(autouse=True)
def own_trust(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    """No memory of what was trusted, none left behind; one thread, as workers have."""
    monkeypatch.setenv(code.TRUST, "")
    monkeypatch.setenv(code.IMPORT, "")
    monkeypatch.setenv(code.CONFIG, str(tmp_path / "config"))
    before = torch.get_num_threads()
    torch.set_num_threads(1)
    yield
    torch.set_num_threads(before)


def run(*words: object) -> int:
    """The exit code of a command."""
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    return int(ended.value.code or 0)


class World:
    """A pool of one kind, two pairs, and what a command prints of them."""

    def __init__(
        self,
        name: str,
        folder: Path,
        monkeypatch: pytest.MonkeyPatch,
        capsys: pytest.CaptureFixture[str],
    ) -> None:
        self.folder, self.capsys = folder, capsys
        self.pool = POOLS[name](folder)
        self.pairs = write_pairs(folder / "pairs")
        monkeypatch.syspath_prepend(str(folder / "site"))

    def search(self, engine: str, *words: object) -> object:
        """Stage 1 over the one subset that two sources have; its result."""
        self.capsys.readouterr()
        budget = ("--population", 3, "--generations", 1, "--evaluations", 0)
        data = ("-b", "pairs", "--root", self.pairs, "--out", self.folder / engine)
        assert (
            run("search", self.pool, *data, *budget, "--engine", engine, *words, "--json", "--trust-code")
            == 0
        )
        return json.loads(self.capsys.readouterr().out)["stage1"]


@pytest.mark.parametrize("name", POOLS)
def test_each_is_checked_searched_and_predicts(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    world = World(name, tmp_path, monkeypatch, capsys)
    assert run("check", world.pool, "--trust-code") == 0
    assert "the network is called rightly" in capsys.readouterr().out
    alone = world.search("inline")
    assert world.search("processes", "--workers", 2) == alone
    merged = tmp_path / "inline" / "merged.safetensors"
    left, right = (world.pairs / "pair0" / f"{side}.png" for side in ("left", "right"))
    asked = {
        "file": ["--import", tmp_path / "net.py"],
        "openstereo": ["--option", f"root={tmp_path / 'checkout'}"],
        "raft-stereo": ["--option", f"root={tmp_path / 'checkout'}"],
    }.get(name, [])
    assert run("predict", merged, "-l", left, "-r", right, "-o", tmp_path / "out", *asked) == 0
    assert list((tmp_path / "out").glob("*.pfm"))


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::FutureWarning")
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_ray_finds_what_one_process_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """One cluster for all: starting it takes longer than four searches."""
    with two_nodes() as cluster:
        import ray

        ray.init(address=cluster.address, log_to_driver=False, logging_level="error")
        try:
            for name in ("file", "entry point", "openstereo", "raft-stereo"):
                world = World(name, tmp_path / name.replace(" ", "-"), monkeypatch, capsys)
                assert world.search("ray", "--workers", 1) == world.search("inline"), name
        finally:
            ray.shutdown()
