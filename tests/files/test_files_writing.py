"""The one owner of how and where files are written."""

from __future__ import annotations

import errno
import fcntl
import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

import sfkit
from sfkit import files
from sfkit.errors import InputError, SfkitWarning


def test_a_file_appears_whole_and_alone(tmp_path: Path) -> None:
    target = tmp_path / "new" / "name.txt"
    with files.writing(target) as fresh:
        fresh.write_text("half")
        assert not target.exists()
        assert not list(target.parent.glob("*.txt")), "a search for its kind does not find it half written"
    assert [path.name for path in target.parent.iterdir()] == ["name.txt"]
    assert target.read_text() == "half"


@pytest.mark.parametrize("durable", [True, False])
def test_what_fails_leaves_the_former_file(tmp_path: Path, durable: bool) -> None:
    target = files.write_text(tmp_path / "name.txt", "former")

    def interrupted() -> None:
        with files.writing(target, durable=durable) as fresh:
            fresh.write_text("half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        interrupted()
    assert target.read_text() == "former"
    assert list(tmp_path.iterdir()) == [target]


def test_the_umask_decides_who_may_read(tmp_path: Path) -> None:
    former = os.umask(0o027)
    try:
        with files.writing(tmp_path / "private") as fresh:
            fresh.write_bytes(b"x")
            fresh.chmod(0o600)  # as safetensors leaves it
    finally:
        os.umask(former)
    assert stat.S_IMODE((tmp_path / "private").stat().st_mode) == 0o640


def test_threads_that_write_one_file_do_not_meet(tmp_path: Path) -> None:
    target, both = tmp_path / "shared", threading.Barrier(2)

    def write(content: bytes) -> None:
        with files.writing(target, durable=False) as fresh:
            both.wait(timeout=300)
            fresh.write_bytes(content)

    threads = [threading.Thread(target=write, args=(letter * 1000,)) for letter in (b"a", b"b")]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert target.read_bytes() in (b"a" * 1000, b"b" * 1000)
    assert list(tmp_path.iterdir()) == [target]


def test_text_is_utf8_and_bytes_are_themselves(tmp_path: Path) -> None:
    assert files.write_text(tmp_path / "text", "θ_base\n").read_bytes() == b"\xce\xb8_base\n"
    assert files.write_bytes(tmp_path / "bytes", b"\r\n\x00").read_bytes() == b"\r\n\x00"


def test_what_keeps_a_folder_from_being_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert files.unwritable(tmp_path / "not" / "yet" / "there") is None
    monkeypatch.chdir(tmp_path)
    assert files.unwritable(Path("relative")) is None
    file = files.write_text(tmp_path / "file", "")
    assert files.unwritable(file) == file
    assert files.unwritable(file / "inside" / "it") == file
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may write anywhere
    assert files.unwritable(tmp_path / "new") == tmp_path


def test_shipped_folders_lie_inside_a_wheel_or_beside_a_checkout(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(files, "PACKAGE", tmp_path / "sfkit")
    assert files.shipped("notebooks", "notebook_files") is None
    (tmp_path / "notebooks").mkdir()
    assert files.shipped("notebooks", "notebook_files") == tmp_path / "notebooks"
    (tmp_path / "sfkit" / "notebook_files").mkdir(parents=True)
    assert files.shipped("notebooks", "notebook_files") == tmp_path / "sfkit" / "notebook_files"


def test_what_keeps_a_file_from_being_read_is_said_as_what_it_is(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A folder and a file without permission used to be "no such file"."""
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    assert files.trouble(tmp_path / "file") is None
    assert files.trouble(tmp_path / "folder") == "is a folder"
    assert files.trouble(tmp_path / "absent") == "no such file"
    assert files.trouble(Path("a\0b")) == "is no name that a file can have"
    monkeypatch.setattr(os, "access", lambda *_: False)  # root may read anything
    assert files.trouble(tmp_path / "file") == "may not be read by this user"


def test_a_temporary_name_cannot_be_foreseen(tmp_path: Path) -> None:
    with files.fresh_beside(tmp_path / "x") as one, files.fresh_beside(tmp_path / "x") as two:
        assert one != two
        assert len(one.name) > len(".x..part") + 12


HOLDER = """import sys, time
from pathlib import Path
from sfkit.files import holding
with holding(Path(sys.argv[1]), "busy"):
    print("held", flush=True)
    time.sleep(600)
"""


def test_a_lock_is_held_as_long_as_its_process_lives(tmp_path: Path) -> None:
    lock = tmp_path / "new" / ".lock"
    assert not files.is_held(lock)
    with subprocess.Popen([sys.executable, "-c", HOLDER, str(lock)], stdout=subprocess.PIPE) as other:
        try:
            assert other.stdout is not None
            assert other.stdout.readline() == b"held\n"
            assert files.is_held(lock)
            with (
                pytest.raises(sfkit.InputError, match=r"^somebody is at it$"),
                files.holding(lock, "somebody is at it"),
            ):
                pass
            assert files.is_held(lock), "who was refused took nothing"
        finally:
            other.kill()
    assert not files.is_held(lock), "killed, it could tidy up nothing"
    with files.holding(lock, "busy"):
        assert files.is_held(lock), "by this very process"
    assert not files.is_held(lock)


@pytest.mark.parametrize("code", [errno.ENOLCK, errno.ENOTSUP])
def test_where_a_file_system_has_no_locks_work_goes_on_with_a_word(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, code: int
) -> None:
    def flock(*_: object) -> None:
        raise OSError(code, os.strerror(code))

    monkeypatch.setattr(fcntl, "flock", flock)
    with (
        pytest.warns(SfkitWarning, match="has no locks: let one process at a time"),
        files.holding(tmp_path / "x", "busy"),
    ):
        assert not files.is_held(tmp_path / "x")


def test_a_lock_of_another_user_is_refused_in_a_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def open_(*_: object, **__: object) -> int:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES))

    monkeypatch.setattr(os, "open", open_)
    with (
        pytest.raises(InputError, match=r"x: cannot be locked \(Permission denied\), expected"),
        files.holding(tmp_path / "x", "busy"),
    ):
        raise AssertionError("it was held")
