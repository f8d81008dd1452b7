"""Networks of one's own, as files and packages: every engine knows them, and none runs unasked."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path

import pytest
from own_networks import NETWORK, REGISTER, decorated, write_pool, write_states

import sfkit
from sfkit.architectures import code
from sfkit.architectures.registry import entry_for
from sfkit.cli import main
from sfkit.errors import InputError


@pytest.fixture(autouse=True)
def nothing_trusted(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """No memory of what was trusted, and none left behind."""
    monkeypatch.setenv(code.TRUST, "")
    monkeypatch.setenv(code.IMPORT, "")
    monkeypatch.setenv(code.CONFIG, str(tmp_path / "config"))


def run(*words: object) -> int:
    """The exit code of a command."""
    with pytest.raises(SystemExit) as ended:
        main([str(word) for word in words])
    return int(ended.value.code or 0)


def test_code_that_a_pool_names_does_not_run_unasked(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_states(tmp_path)
    pool = decorated(tmp_path)
    (tmp_path / "net.py").write_text(
        f"import pathlib\npathlib.Path({str(tmp_path / 'ran')!r}).touch()\n" + NETWORK + REGISTER + "# 1\n"
    )
    with pytest.raises(InputError, match=r"net\.py: opening this pool would run that code.*--trust-code"):
        sfkit.open_pool(pool)
    assert run("merge", pool, "--uniform", "--out", tmp_path / "m.safetensors") == 2
    assert "--trust-code" in capsys.readouterr().err
    assert not (tmp_path / "ran").exists()
    assert run("merge", pool, "--uniform", "--out", tmp_path / "m.safetensors", "--trust-code") == 0
    assert os.environ[code.TRUST] == ""
    (tmp_path / "ran").unlink()
    (tmp_path / "net.py").write_text((tmp_path / "net.py").read_text() + "# changed\n")
    sfkit.trust_code(tmp_path / "net.py")
    assert sfkit.open_pool(pool).names == ("a", "b")
    assert (tmp_path / "ran").exists()


def test_a_terminal_is_asked_once_for_each_content(tmp_path: Path) -> None:
    write_states(tmp_path)
    pool = decorated(tmp_path)
    (tmp_path / "net.py").write_text(NETWORK + REGISTER + f"# {tmp_path}\n")
    asked: list[Path] = []
    answers = iter([False, True, True])

    def ask(path: Path) -> bool:
        asked.append(path)
        return next(answers)

    code.ask_with(ask)
    try:
        with pytest.raises(InputError, match="would run that code"):
            sfkit.open_pool(pool)
        sfkit.open_pool(pool)
        sfkit.open_pool(pool)
        assert len(asked) == 2
        (tmp_path / "net.py").write_text((tmp_path / "net.py").read_text() + "# changed\n")
        sfkit.open_pool(pool)
        assert len(asked) == 3
    finally:
        code.ask_with(None)


def test_a_changed_helper_is_another_version(tmp_path: Path) -> None:
    """What a file imports from beside it belongs to its identity."""
    versions = []
    for number in (1, 2):
        (tmp_path / "helper.py").write_text(f"VALUE = {number}\n")
        (tmp_path / f"net{number}.py").write_text("import helper\n" + NETWORK + REGISTER)
        sfkit.trust_code(tmp_path / f"net{number}.py")
        versions.append(entry_for("my-net", tmp_path / f"net{number}.py").version)
    assert versions[0] != versions[1]


def test_two_checkouts_with_a_package_of_one_name_live_side_by_side(tmp_path: Path) -> None:
    for name in ("raft", "igev"):
        (tmp_path / name / "core").mkdir(parents=True)
        (tmp_path / name / "core" / "part.py").write_text(f"NAME = {name!r}\n")
        (tmp_path / name / "core" / "net.py").write_text(
            "from core.part import NAME\ndef build(): return NAME\n"
        )
    built = [code.import_from(tmp_path / name, "core.net", "build")() for name in ("raft", "igev")]
    assert built == ["raft", "igev"]


@pytest.mark.parametrize(
    "fails", ["import no_such_package", "raise RuntimeError('no operator')", "x = (", "exit()"]
)
def test_a_checkout_that_cannot_be_imported_is_told_in_a_sentence(fails: str, tmp_path: Path) -> None:
    (tmp_path / "broken_net.py").write_text(fails)
    for _ in range(2):
        with pytest.raises(
            InputError, match=r"broken_net\.Net cannot be imported \(\w+(Error|Exit): .*installed"
        ):
            code.import_from(tmp_path, "broken_net", "Net")


@pytest.mark.parametrize(
    ("head", "write", "message"),
    [
        ('architecture = "my-net"\nmodule = "gone.py"', lambda _: None, r"gone\.py: no such file"),
        (
            'architecture = "other"\nmodule = "net.py"',
            lambda f: (f / "net.py").write_text(NETWORK),
            "does not register the architecture 'other'",
        ),
        (
            'architecture = "x"\nmodule = "net.py"',
            lambda f: (f / "net.py").write_text("1 / 0"),
            r"net\.py: running it failed \(ZeroDivisionError",
        ),
        (
            'architecture = "x"\nmodule = "net.py"',
            lambda f: (f / "net.py").write_text(
                "raise SystemExit(0)"
            ),  # a script that works, and is no module
            r"net\.py: running it failed \(SystemExit: 0",
        ),
        (
            'architecture = "x"\nmodule = "net.py"',
            lambda f: (f / "net.py").symlink_to("net.py"),
            r"net\.py: is a link that leads in a circle",
        ),
        ('architecture = "no_such_module:Net"', lambda _: None, "'no_such_module' cannot be found"),
        (
            'architecture = "there:Nett"',
            lambda f: (f / "there.py").write_text(NETWORK),
            "unknown name in there 'Nett'",
        ),
        ('architecture = "unheard-of"', lambda _: None, "is it your own.*--import FILE"),
    ],
)
def test_refusals(tmp_path: Path, head: str, write: Callable[[Path], object], message: str) -> None:
    write_states(tmp_path)
    write(tmp_path)
    code.trust_all()
    with pytest.raises(InputError, match=message):
        sfkit.open_pool(write_pool(tmp_path, head))
