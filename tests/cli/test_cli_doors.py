"""Things that are no file, text or network where one is expected: exit 2, one sentence, nothing left."""

from __future__ import annotations

import os
import resource
import shutil
import signal
import socket
import sys
import types
from collections.abc import Iterator
from pathlib import Path

import pytest
from cli_world import Shell
from tiny import write_pairs, write_pool

from sfkit.checkpoints import writing
from sfkit.datasets import open_benchmark
from sfkit.evaluation import Compute, Evaluator, estimating
from sfkit.evaluation.engines import plan
from sfkit.evaluation.engines.auto import AutoEngine
from sfkit.evaluation.engines.worker import Worker
from sfkit.merging import open_pool

PAIRS = "-b pairs -r pairs"
LEFT, RIGHT = "pairs/pair0/left.png", "pairs/pair0/right.png"
ANYNET = "--architecture anynet --option spn=false --option ranges=[4,3,3]"
FINETUNE = "finetune pool/base.safetensors pairs -r pairs -a anynet -o x.safetensors"
FACTORY = """name = "f"
base = "pool/base.safetensors"
architecture = "anynet"
{more}
[sources.{source}]
data = "bank:haze"
pairs = {pairs}
[validation]
name = "bank:courtyard"
pairs = 1
"""
LATIN = os.fsdecode(b"caf\xe9")  # a name that is no UTF-8
BOMB = "a0: &a0 [x, x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"a{n}: &a{n} [{', '.join([f'*a{n - 1}'] * 10)}]\n" for n in range(1, 9)
)


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Path:
    world = tmp_path_factory.mktemp("doors")
    toml = write_pool(world / "pool")
    write_pairs(world / "pairs", 1)
    for name in ("deep", "digits"):
        value = {"deep": "[" * 100_000 + "]" * 100_000, "digits": "9" * 10_000}[name]
        (world / f"{name}.toml").write_text(f"seed = {value}")
        (world / f"{name}.json").write_text(value)
    sound = {"more": "", "source": "haze", "pairs": "2"}
    for name, edit in (
        *((name, {"source": name}) for name in ("uniform", "merged", "search")),
        ("joint", {"more": 'joint = "no"'}),
        ("tested", {"more": "tests = 5"}),
        ("nul", {"more": 'out = "a\\u0000b"'}),
        *(
            (f"by-{name}", {"more": f'module = "{name}"'})
            for name in ("loop", "pipe", "folder.pth", "a\\u0000")
        ),
        ("pairs", {"pairs": '"2"'}),
    ):
        (world / f"{name}.toml").write_text(FACTORY.format(**{**sound, **edit}))
    (world / "place.toml").write_text('out = "a\\u0000b"')
    (world / "loop").symlink_to("loop")
    (world / "nowhere").symlink_to("absent")
    (world / "folder.pth").mkdir()
    for name in ("pipe", "pipe.pth", "pipe.png", "pipe.sqlite", "pipe.avi", "pipe.ipynb"):
        os.mkfifo(world / name)
    (world / "claimed").mkdir()
    (world / "claimed" / "journal.jsonl").write_text("{}")
    os.mkfifo(world / "claimed" / "search.json")
    (world / "lfs.safetensors").write_text("version https://git-lfs.github.com/spec/v1\nsize 123\n")
    (world / "page.pth").write_text("<!DOCTYPE html><html>Sign in</html>")
    for name, folder in (("scale", "pairs-scale"), ("npy", "pairs-npy")):
        shutil.copytree(world / "pairs", world / folder)
        truth = world / folder / "pair0" / "disparity.pfm"
        if name == "scale":
            truth.write_bytes(truth.read_bytes().replace(b"\n-1\n", b"\n-1.0.0\n"))
        else:
            truth.unlink()
            about = (
                b"{'descr': '<f8', 'fortran_order': False, 'shape': (700000, 700000), }".ljust(117) + b"\n"
            )
            head = b"\x93NUMPY\x01\x00" + len(about).to_bytes(2, "little") + about
            truth.with_suffix(".npy").write_bytes(head + bytes(100))
    for name, text in (("torn", "garbage\n{}\n"), ("lacking", '{"event":"start","search":"subset"}\n' * 2)):
        (world / "runs" / name).mkdir(parents=True)
        (world / "runs" / name / "journal.jsonl").write_text(text)
    with (world / "runs" / "lacking" / "journal.jsonl").open("a") as stream:
        stream.write('{"event":"generation","search":"subset"}\n')
    (world / "bomb").mkdir()
    shutil.copytree(world / "pool", world / "bomb" / "pool")
    text = toml.read_text().replace('"anynet"', '"foundation-stereo"')
    (world / "bomb" / "pool" / "pool.toml").write_text(
        text[: text.index("[options]")] + text[text.index("[base]") :]
    )
    (world / "bomb" / "pool" / "cfg.yaml").write_text(f"{BOMB}vit_size: *a8\n")
    for name in ("out.csv", "run/merged.safetensors", "seen/left.pfm", "page.html"):
        (world / name).mkdir(parents=True)
    return world


@pytest.fixture(autouse=True)
def here(world: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """In the world, where nothing may run and nothing may hang."""

    def no_network(*_: object, **__: object) -> None:
        raise AssertionError("a network ran although the input is bad")

    def late(*_: object) -> None:
        raise AssertionError("it hangs")

    monkeypatch.chdir(world)
    monkeypatch.setattr(Worker, "run", no_network)
    former = signal.signal(signal.SIGALRM, late)
    signal.alarm(60)
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, former)


DOORS = (
    ("search deep.toml -b pairs -r pairs -o new", "deep.toml", "not TOML"),
    ("show digits.toml", "digits.toml", "not TOML"),
    (f"evaluate pool {PAIRS} --recipe deep.json", "deep.json", "not JSON"),
    ("show digits.json", "digits.json", "not JSON"),
    (
        "finetune pool/base.safetensors pairs -r pairs -o f.safetensors --settings deep.toml",
        "deep.toml",
        "TOML",
    ),
    ("evaluate pool --uniform -b pairs -r ~nosuch/", "~nosuch", "no such folder"),
    (f"search pool {PAIRS} --also pairs,root=~nosuch/ -o new", "~nosuch", "no such folder"),
    ("show loop", "loop", "a circle"),
    ("show nowhere", "nowhere", "leads nowhere"),
    (f"search pool {PAIRS} -o loop", "--out", "loop"),
    (f"evaluate pool --uniform {PAIRS} --store loop/s.sqlite", "--store", "loop"),
    ("merge pool --uniform -o loop/x.safetensors", "loop", "no folder"),
    (f"predict pool/base.safetensors -l {LEFT} -r {RIGHT} -o loop", "loop", "no folder"),
    ("bank build -o loop", "loop", "--out"),
    (f"search pool {PAIRS} -o new --also ,", "--also", "empty"),
    (f"search pool {PAIRS} --also pairs,root=pairs,metric=d1 -o new", "metrics in", "one unit"),
    (f"evaluate pool --uniform {PAIRS} --csv pipe", "pipe", "a pipe or a device"),
    (f"predict pool/base.safetensors -l {LEFT} -r {RIGHT} --calib pipe -o new", "pipe", "a pipe or a device"),
    ("show pipe.pth", "pipe.pth", "a pipe or a device"),
    (f"search pool {PAIRS} --config pipe -o new", "pipe", "a pipe or a device"),
    ("factory status pipe", "pipe", "a pipe or a device"),
    ("evaluate pool --uniform -b unlabelled -r pairs --csv pipe", "pipe", "a pipe or a device"),
    ("report pipe.ipynb -o new.html", "pipe.ipynb", "a pipe or a device"),
    (f"search pool {PAIRS} -o claimed", "claimed/search.json", "a pipe or a device"),
    (f"{FINETUNE} --settings pipe", "pipe", "a pipe or a device"),
    ("export pipe.pth", "pipe.pth", "a pipe or a device"),
    (f"predict pool/base.safetensors -l pipe.avi -r {RIGHT} -o new", "pipe.avi", "a pipe or a device"),
    ("runs export pipe.sqlite -o x.csv", "pipe.sqlite", "no such file"),
    ("show /dev/zero", "/dev/zero", "a pipe or a device"),
    (f"predict folder.pth -l {LEFT} -r {RIGHT} -o new", "folder.pth", "is a folder"),
    ("show lfs.safetensors", "lfs.safetensors", "Git LFS pointer", "git lfs pull"),
    ("show page.pth", "page.pth", "web page"),
    ("evaluate pool --uniform -b pairs -r pairs-scale", "disparity.pfm", "PFM header"),
    ("evaluate pool --uniform -b pairs -r pairs-npy", "disparity.npy", "cannot be read"),
    ("runs show runs/torn", "torn/journal.jsonl", "record 1"),
    ("show runs/lacking", "lacking/journal.jsonl", "not what a search writes"),
    ("demo --seed -1", "--seed", "a whole number of at least 0"),
    (f"evaluate pool --uniform {PAIRS} -o out.csv", "--out", "out.csv", "is a folder"),
    (f"search pool {PAIRS} -o run", "run/merged.safetensors", "is a folder"),
    (f"predict pool/base.safetensors -l {LEFT} -r {RIGHT} -o seen --force", "seen/left.pfm", "is a folder"),
    ("report 01_quickstart -o page.html", "page.html", "a folder"),
    (f"evaluate bomb/pool --uniform {PAIRS}", "cfg.yaml", "aliases are written out"),
    ("show \x1b[31mred.pth", "\\x1b[31mred.pth", "no such file"),
    (
        f"compare pool/base.safetensors pool/a.safetensors {ANYNET} -b unlabelled -r pairs"
        " --metric census,epe",
        "epe needs ground truth",
    ),
    ("evaluate pool --uniform -b unlabelled -r pairs --metric census,d1", "d1 needs ground truth"),
    (f"export pool/base.safetensors {ANYNET} --size 99999x99999 -f torch -o x.pt2", "99999x99999", "at most"),
    *(
        (line, "its keys are those of anynet", "is architecture = 'nmrf-res'")
        for line in (
            "finetune pool/base.safetensors pairs -r pairs -a nmrf-res -o x.safetensors",
            f"predict pool/base.safetensors --architecture nmrf-res -l {LEFT} -r {RIGHT} -o new",
        )
    ),
    (f"{FINETUNE} --option spn", "--option", "NAME=VALUE"),
    (f"{FINETUNE} --option snp=false", "unknown option", "'spn'"),
    *(
        (f"factory status {name}.toml", f"a source called '{name}'")
        for name in ("uniform", "merged", "search")
    ),
    ("factory status joint.toml", "joint: found 'no', expected true or false"),
    *(
        (f"search pool {PAIRS} --test unlabelled,{entries} -o new", f"--test: found {said}")
        for entries, said in (
            ("root=pairs,root=pool", "'root' twice"),
            ("root=pairs,name=pairs", "'name' twice"),
            ("root=", "'root=', expected KEY=VALUE"),
        )
    ),
    (f"{FINETUNE} --option spn=false --option spn=true", "--option: found 'spn' twice"),
    (f"{FINETUNE} --option spn=NaN", "--option spn: not JSON (found NaN)"),
    ("report 01_quickstart -p seed 1 -p seed 2 -o new.html", "-p: found 'seed' twice"),
    ("factory status tested.toml", "found the benchmark 5, expected a table"),
    ("factory status nul.toml", "'a\\x00b': is no name that a file can have"),
    ("factory status by-loop.toml", "loop: is a link that leads in a circle, expected Python code"),
    ("factory status by-pipe.toml", "pipe: is a pipe or a device, expected Python code"),
    ("factory status by-folder.pth.toml", "folder.pth: is a folder, expected Python code"),
    ("factory status by-a\\u0000.toml", "'a\\x00': is no name that a file can have"),
    (f"search pool {PAIRS} --config place.toml", "'a\\x00b': is no name that a file can have"),
    (f"search pool {PAIRS} --resamples 1000000000 -o new", "resamples: found 1000000000", "at most 10000"),
    ("factory status pairs.toml", "pairs: found '2', expected a whole number"),
    ("factory run pool/base.safetensors", "base.safetensors: is not TOML"),
    (f"merge pool --uniform -o {LATIN}.safetensors", "caf\\udce9.safetensors", "no UTF-8"),
)


@pytest.mark.parametrize("door", DOORS, ids=lambda door: door[0][:50].encode("ascii", "replace").decode())
def test_a_door_says_one_sentence_and_leaves_nothing(
    door: tuple[str, ...], shell: Shell, world: Path
) -> None:
    before = sorted(map(str, world.rglob("*")))
    line, *words = door
    out, errors = shell(line, code=2)
    assert out == ""
    (sentence,) = [said for said in errors.splitlines() if said.startswith("error: ")]
    assert [word for word in words if word not in sentence] == []
    assert "\x1b" not in errors
    assert sorted(map(str, world.rglob("*"))) == before


def test_one_broken_journal_does_not_hide_the_others(shell: Shell, world: Path) -> None:
    _, errors = shell("runs list")
    assert errors.count("journal.jsonl: ") == 2


def test_names_that_are_no_text_are_written_to(
    shell: Shell, world: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    monkeypatch.chdir(world)
    shell("merge pool --uniform -o mixed.safetensors")
    out, _ = shell(f"predict mixed.safetensors -l {LEFT} -r {RIGHT} -o {LATIN} --check")
    assert out.startswith("caf\\udce9/left.pfm: median")
    names = sorted(path.name for path in (world / LATIN).iterdir())
    assert names == ["left.pfm", "left_colour.png", "left_confidence.png", "left_overview.png"]


def test_a_table_alone_stands_in_its_own_folder(
    shell: Shell, world: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    monkeypatch.chdir(world)
    row = "pair0/left.png,pair0/right.png,pair0/disparity.pfm"
    (world / "pairs" / "table.csv").write_text(f"left,right,disparity\n{row}\n")
    (alone,) = shell.json("evaluate pool --uniform -b pairs --csv pairs/table.csv")["scores"]
    (both,) = shell.json("evaluate pool --uniform -b pairs -r pairs")["scores"]
    assert alone["score"] == both["score"]


def test_a_disk_without_room_is_said_before_any_work(
    shell: Shell, world: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    free = types.SimpleNamespace(free=0)
    monkeypatch.setattr(writing.shutil, "disk_usage", lambda _: free)
    for line in ("merge pool --uniform -o big.safetensors", f"search pool {PAIRS} -o big --yes"):
        _, errors = shell(line, code=2)
        assert "0 MiB are free there" in errors
    assert not list(world.glob("big*"))


def test_a_disk_that_fills_leaves_no_file(shell: Shell, world: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for form, error in (
        ("safetensors", writing.SafetensorError("I/O error: No space left on device")),
        ("original", RuntimeError("PytorchStreamWriter failed writing file")),
    ):

        def full(*_: object, error: Exception = error, **__: object) -> None:
            raise error

        monkeypatch.setattr(writing, "save_file", full)
        monkeypatch.setattr(writing.torch, "save", full)
        ending = "safetensors" if form == "safetensors" else "pth"
        _, errors = shell(f"merge pool --uniform -o full.{ending} --form {form}", code=2)
        assert "make room, or name a place on another disk" in errors
        assert not [
            path
            for path in world.iterdir()
            if path.name.startswith((".full", "full.s")) or path.name == "full.pth"
        ]


def test_a_prediction_that_a_disk_cannot_hold_leaves_no_part(
    shell: Shell, world: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A cut .pfm used to stay, which blocked the next prediction."""
    monkeypatch.undo()
    monkeypatch.chdir(world)
    shell("merge pool --uniform -o held.safetensors")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    former = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    try:
        resource.setrlimit(resource.RLIMIT_FSIZE, (6000, limits[1]))
        _, errors = shell(f"predict held.safetensors -l {LEFT} -r {RIGHT} -o cut", code=2)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
        signal.signal(signal.SIGXFSZ, former)
    assert "error: File too large: make room and start again" in errors
    assert list((world / "cut").iterdir()) == []
    shell(f"predict held.safetensors -l {LEFT} -r {RIGHT} -o cut")


def test_a_cluster_that_does_not_answer(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        monkeypatch.setenv("RAY_ADDRESS", f"127.0.0.1:{taken.getsockname()[1]}")  # nobody listens
        _, errors = shell(f"evaluate pool --uniform {PAIRS} --engine ray", code=2)
    assert "nobody answers at RAY_ADDRESS 127.0.0.1" in errors


def test_worker_processes_are_refused_where_there_are_none(
    shell: Shell, world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On Windows; what is picked there does without, and so does what tells the peak of memory."""
    monkeypatch.setattr(plan, "SYSTEM", "win32")
    _, errors = shell(f"evaluate pool --uniform {PAIRS} --engine processes", code=2)
    assert "does not run on Windows" in errors
    pool, pairs = open_pool(world / "pool"), open_benchmark("pairs", world / "pairs")
    engine = AutoEngine(pool, Evaluator(pool, pairs).prepared, Compute(engine="auto", workers=2))
    assert "does not run on Windows" in engine.why
    monkeypatch.setitem(sys.modules, "resource", None)
    monkeypatch.setattr(estimating, "Path", lambda _: tmp_path / "absent")
    assert estimating.peak_memory() == 0


def test_links_that_lie_in_pool_and_pairs_are_followed(
    shell: Shell, world: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.undo()
    monkeypatch.chdir(tmp_path)
    for folder in ("pool", "pairs/pair0"):
        (tmp_path / folder).mkdir(parents=True)
        for file in (world / folder).iterdir():
            (tmp_path / folder / file.name).symlink_to(file)
    (linked,) = shell.json(f"evaluate pool --uniform {PAIRS}")["scores"]
    monkeypatch.chdir(world)
    (plain,) = shell.json(f"evaluate pool --uniform {PAIRS}")["scores"]
    assert linked["score"] == plain["score"]
