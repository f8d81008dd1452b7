"""The evaluation store on real SQLite files: the first score is the truth, and damage is refused."""

from __future__ import annotations

import math
import os
import random
import resource
import sqlite3
import subprocess
import sys
import tempfile
import threading
from contextlib import closing
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from sfkit.cli import main
from sfkit.errors import SfkitWarning, StoreError
from sfkit.evaluation.exchange import evaluation_table
from sfkit.evaluation.file_systems import file_system, is_shared, printed_mounts
from sfkit.evaluation.metrics import ImageErrors, RegionErrors
from sfkit.evaluation.rescue import rescue
from sfkit.evaluation.store import COLUMNS, Evaluation, EvaluationStore, evaluation_key
from sfkit.evaluation.store_file import readable_columns

IMAGE = ImageErrors("one", (1.0, 2.0), 0, {"all": RegionErrors(10, 1.1 / 3, (3, 1), 0)})


def evaluation(name: str, *, seconds: float = 1.0, failure: str | None = None) -> Evaluation:
    description = {"recipe": name}
    images = () if failure else (IMAGE,)
    return Evaluation(evaluation_key(description), description, images, failure, seconds)


def test_what_is_written_is_read_back_bit_for_bit(tmp_path: Path) -> None:
    path = tmp_path / "deep" / "store.sqlite"
    with EvaluationStore(path) as store:
        store.put(evaluation("a"))
    with EvaluationStore(path) as store:
        held = store.get(evaluation("a").key)
        assert held is not None
        assert held.images == (IMAGE,)
        assert held.images[0].regions["all"].sum_abs == 1.1 / 3
        assert held.cached
        assert len(store) == 1


def test_an_infinite_error_survives(tmp_path: Path) -> None:
    broken = ImageErrors("one", (1.0,), 5, {"all": RegionErrors(10, math.inf, (10,), 10)})
    entry = Evaluation("k", {}, (broken,), None, 1.0)
    with EvaluationStore(tmp_path / "s.sqlite") as store:
        assert store.put(entry).images == (broken,)


def test_the_first_score_is_the_truth(tmp_path: Path) -> None:
    with EvaluationStore(tmp_path / "s.sqlite") as store:
        store.put(evaluation("a", seconds=1.0))
        assert store.put(evaluation("a", seconds=2.0)).seconds == 1.0
        assert len(store) == 1


def test_a_failure_gives_way_to_a_later_success(tmp_path: Path) -> None:
    with EvaluationStore(tmp_path / "s.sqlite") as store:
        assert store.put(evaluation("a", failure="RuntimeError: no")).failure == "RuntimeError: no"
        assert store.put(evaluation("a")).failure is None
        assert store.put(evaluation("a", failure="again")).failure is None
        assert store.attempts(evaluation("a").key) == 2


def test_the_key_is_the_content(tmp_path: Path) -> None:
    assert evaluation_key({"a": 1, "b": [0.1]}) == evaluation_key({"b": [0.1], "a": 1})
    assert evaluation_key({"a": 1}) != evaluation_key({"a": 2})


def test_threads_and_processes_share_one_file(tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    script = (
        "import sys; from sfkit.evaluation.store import *\n"
        "with EvaluationStore(sys.argv[1]) as s:\n"
        "    for i in range(40): s.put(Evaluation(f'k{i}', {'by': sys.argv[2]}, (), None, float(i)))\n"
    )
    others = [subprocess.Popen([sys.executable, "-c", script, str(path), str(n)]) for n in range(2)]
    with EvaluationStore(path) as store:

        def write(start: int) -> None:
            for i in range(start, 40, 2):
                store.put(Evaluation(f"k{i}", {"by": "thread"}, (), None, float(i)))

        threads = [threading.Thread(target=write, args=(n,)) for n in range(2)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
        assert [other.wait(300) for other in others] == [0, 0]
        assert {e.key: e.seconds for e in store} == {f"k{i}": float(i) for i in range(40)}


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"garbage, not a database at all" * 50, "cannot be used as an evaluation store"),
        (b"SQLite format 3\x00" + b"\x07" * 4096, "evaluation store"),
    ],
)
def test_garbage_is_refused_and_left_alone(tmp_path: Path, content: bytes, message: str) -> None:
    path = tmp_path / "s.sqlite"
    path.write_bytes(content)
    with pytest.raises(StoreError, match=message):
        EvaluationStore(path)
    assert path.read_bytes() == content


def test_a_truncated_store_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    with EvaluationStore(path) as store:
        for number in range(300):
            store.put(evaluation(f"recipe {number}"))
    data = path.read_bytes()
    path.write_bytes(data[: len(data) // 2])
    with pytest.raises(StoreError, match=r"s\.sqlite: (is damaged|cannot be used)"):
        EvaluationStore(path)
    assert len(path.read_bytes()) == len(data) // 2


def test_garbage_anywhere_is_refused_or_harmless_and_never_written_to(tmp_path: Path) -> None:
    """Truncated anywhere, or 1 to 3000 random bytes anywhere: no score ever changes, the file never does."""
    path, rng = tmp_path / "s.sqlite", random.Random(4)
    with EvaluationStore(path) as store:
        for number in range(40):
            store.put(evaluation(f"recipe {number}", failure="it fell" if number % 9 == 0 else None))
        expected = [(e.key, e.images, e.failure) for e in store]
    whole, refused = path.read_bytes(), 0
    for number in range(120):
        data = bytearray(whole)
        if number % 4 == 0:
            del data[rng.randrange(1, len(data)) // 4096 * 4096 + rng.choice((0, 0, 7)) :]
        else:
            start = rng.randrange(len(data))
            data[start : start + rng.choice((1, 20, 3000))] = rng.randbytes(rng.choice((1, 20, 3000)))
        if not data:
            continue  # an empty file is a new store's name: nothing tells it from one
        path.write_bytes(data)
        try:
            with EvaluationStore(path) as store:
                found = [(e.key, e.images, e.failure) for e in store]
        except StoreError:
            refused += 1
            assert path.read_bytes() == data
        else:
            assert found == expected
    assert refused > 60


def test_opening_reading_and_showing_a_store_do_not_touch_its_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "s.sqlite"
    with EvaluationStore(path) as store:
        store.put(evaluation("a"))
    os.utime(path, (1e9, 1e9))
    before = path.read_bytes()
    with EvaluationStore(path) as store:
        assert store.get(evaluation("a").key) is not None
    with pytest.raises(SystemExit, match=r"^0$"):
        main(["show", str(path)])
    assert "1 evaluations" in capsys.readouterr().out
    assert path.read_bytes() == before
    assert path.stat().st_mtime == 1e9
    assert [entry.name for entry in tmp_path.iterdir()] == ["s.sqlite"]


def test_a_store_from_before_there_were_checksums_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    with EvaluationStore(path) as store:
        store.put(evaluation("a"))
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("ALTER TABLE evaluations DROP COLUMN checksum")
    with EvaluationStore(path) as store:
        store.put(evaluation("b"))
        assert [e.images for e in store] == [(IMAGE,), (IMAGE,)]


def test_a_store_from_before_cpu_seconds_were_measured_goes_on_and_does_not_guess(tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    with EvaluationStore(path) as store:
        store.put(evaluation("a"))
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("ALTER TABLE evaluations DROP COLUMN cpu_seconds")
        db.execute("PRAGMA user_version = 1")
        assert "NULL AS cpu_seconds" in readable_columns(db, COLUMNS), "one that nobody may write to"
    with EvaluationStore(tmp_path / "other.sqlite") as other:
        assert rescue(path, other).lost == ()
    with EvaluationStore(path) as store:
        store.put(replace(evaluation("b"), cpu_seconds=2.5))
        assert [e.cpu_seconds for e in store] == [None, 2.5]
        table = evaluation_table(store).set_index("key")["cpu_seconds"]
        assert table.isna().tolist() == [True, False]
    with closing(sqlite3.connect(path)) as db:
        assert db.execute("PRAGMA user_version").fetchone() == (2,), "an sfkit of then would call it damaged"


def _of_version_1(path: Path) -> None:
    with EvaluationStore(path) as store:
        store.put(evaluation("a"))
    with closing(sqlite3.connect(path)) as db, db:
        db.execute("ALTER TABLE evaluations DROP COLUMN cpu_seconds")
        db.execute("PRAGMA user_version = 1")


def test_who_only_reads_leaves_a_store_of_an_earlier_version_as_it_is(tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    _of_version_1(path)
    before = path.read_bytes()
    with EvaluationStore(path, read_only=True) as store:
        assert [(e.images, e.cpu_seconds) for e in store] == [((IMAGE,), None)]
    assert path.read_bytes() == before, "an sfkit of then must be able to go on with it"


def test_one_that_may_not_be_written_to_is_served(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "s.sqlite"
    _of_version_1(path)
    real = sqlite3.connect

    def protected(*arguments: Any, **options: Any) -> sqlite3.Connection:
        db = real(*arguments, **options)
        db.execute("PRAGMA query_only = ON")  # as for a user without the right, which the tests may have
        return db

    monkeypatch.setattr(sqlite3, "connect", protected)
    with EvaluationStore(path) as store:
        assert store.get(evaluation("a").key) is not None


def test_a_result_that_an_earlier_version_wrote_over_a_failure_is_no_damage(tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    with EvaluationStore(path) as store:
        key = store.put(evaluation("a")).key
    with closing(sqlite3.connect(path)) as db, db:  # the failure's, which it did not know of
        db.execute("UPDATE evaluations SET cpu_seconds = 3.0")
    with EvaluationStore(path) as store:
        held = store.get(key)
    assert held is not None
    assert held.images == (IMAGE,)


def test_cpu_seconds_that_were_changed_are_damage(tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    with EvaluationStore(path) as store:
        store.put(replace(evaluation("a"), cpu_seconds=2.5))
    for value in ("9.5", "NULL"):
        with closing(sqlite3.connect(path)) as db, db:
            db.execute(f"UPDATE evaluations SET cpu_seconds = {value}")
        with EvaluationStore(path) as store, pytest.raises(StoreError, match="is not what was written"):
            list(store)


def test_a_full_disk_is_said_and_what_was_stored_stays(tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    with EvaluationStore(path) as store:
        store.put(evaluation("a"))
        resource.setrlimit(resource.RLIMIT_FSIZE, (56 << 10, hard))
        try:
            store.put(evaluation("b"))
            with pytest.raises(StoreError, match="what was stored before is kept; look whether the disk is"):
                store.put(evaluation("c" * 60000))
            stored = [e.key for e in store]
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
        assert stored == [evaluation("a").key, evaluation("b").key]
        store.put(evaluation("z"))
        assert [e.key for e in store] == [*stored, evaluation("z").key]
    with EvaluationStore(path) as store:
        assert [e.key for e in store] == [*stored, evaluation("z").key]


def test_another_database_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    db = sqlite3.connect(path)
    db.execute("CREATE TABLE accounts (name TEXT)")
    db.commit()
    db.close()
    with pytest.raises(StoreError, match="is an SQLite file but no evaluation store"):
        EvaluationStore(path)


def test_a_newer_store_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    EvaluationStore(path).close()
    db = sqlite3.connect(path)
    db.execute("PRAGMA user_version = 99")
    db.close()
    with pytest.raises(StoreError, match="newer sfkit"):
        EvaluationStore(path)


def test_network_file_systems_are_recognised(tmp_path: Path) -> None:
    mounts = tmp_path / "mounts"
    mounts.write_text(
        f"/dev/x / ext4 rw 0 0\nserver:/e {tmp_path} nfs4 rw 0 0\ntmpfs {tmp_path}/a\\040b tmpfs rw 0 0\n"
    )
    assert file_system(tmp_path / "run" / "s.sqlite", mounts) == "nfs4"
    assert file_system(tmp_path / "a b" / "s.sqlite", mounts) == "tmpfs"
    assert file_system(Path("/other/s.sqlite"), mounts) == "ext4"


def test_links_to_a_network_file_system_are_followed(tmp_path: Path) -> None:
    mounts = tmp_path / "mounts"
    mounts.write_text(f"/dev/x / ext4 rw 0 0\nserver:/e {tmp_path}/share nfs rw 0 0\n")
    (tmp_path / "share").mkdir()
    (tmp_path / "runs").symlink_to("share")
    assert file_system(tmp_path / "runs" / "new" / "s.sqlite", mounts) == "nfs"


def test_file_systems_that_other_machines_write_to(tmp_path: Path) -> None:
    shared = (
        "virtiofs",
        "vboxsf",
        "vmhgfs",
        "wekafs",
        "panfs",
        "fuse.juicefs",
        "fuse.sshfs",
        "fuse.new",
        "nfs",
    )
    assert [kind for kind in shared if not is_shared(kind)] == []
    assert not any(map(is_shared, ("ext4", "overlay", "apfs", "fuse.fuse-overlayfs", "fuseblk", "")))
    printed = (
        "/dev/disk3s1 on / (apfs, sealed, local)\n//me@nas/lab on /Volumes/my (lab) (smbfs, nodev, nosuid)\n"
    )
    assert list(printed_mounts(printed)) == [(Path("/"), "apfs"), (Path("/Volumes/my (lab)"), "smbfs")]


def test_a_store_on_a_network_file_system_needs_no_shared_memory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "s.sqlite"
    with EvaluationStore(path) as store:  # as a store that was copied there is
        store.put(evaluation("a"))
    monkeypatch.setattr("sfkit.evaluation.store_file.file_system", lambda _path: "nfs4")
    for name in ("s.sqlite", "new.sqlite"):
        with pytest.warns(SfkitWarning, match=r"other machines share \(nfs4\)"):
            store = EvaluationStore(tmp_path / name)
        with pytest.warns(SfkitWarning, match="nfs4"):
            beside = EvaluationStore(tmp_path / name)
        with store, beside:
            store.put(evaluation("b"))
            assert beside.put(evaluation("c")).key in {e.key for e in store}
            assert sorted(entry.name for entry in tmp_path.iterdir()) == sorted({"s.sqlite", name})
    monkeypatch.undo()
    with EvaluationStore(path) as store:
        assert len(store) == 3
        assert (tmp_path / "s.sqlite-shm").exists(), "on a local disk again"


def test_a_store_that_is_deleted_while_open_is_written_again(tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    with EvaluationStore(path) as store:
        store.put(evaluation("a"))
        path.unlink()  # and not what SQLite keeps beside it
        with pytest.warns(SfkitWarning, match="was deleted while in use, and is written again"):
            store.put(evaluation("b"))
        store.put(evaluation("c"))
    with EvaluationStore(path) as store:
        assert [e.key for e in store] == [evaluation(name).key for name in "abc"]
    assert [entry.name for entry in tmp_path.iterdir()] == ["s.sqlite"]


def test_a_store_whose_place_another_took_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "s.sqlite"
    with EvaluationStore(path) as store:
        path.rename(tmp_path / "moved.sqlite")
        with EvaluationStore(path) as other:
            other.put(evaluation("z"))
        with pytest.raises(StoreError, match="another file took this store's place"):
            store.put(evaluation("a"))
    with EvaluationStore(path) as other:
        assert len(other) == 1


def test_an_empty_file_is_no_store(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").touch()
    with pytest.raises(StoreError, match="is empty, expected an evaluation store or a new file's name"):
        EvaluationStore(tmp_path / "notes.txt")
    assert (tmp_path / "notes.txt").read_bytes() == b""


def test_a_store_that_is_cut_off_while_it_is_made_leaves_no_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupted(*_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("sfkit.evaluation.store_file._turn_journal", interrupted)
    with pytest.raises(KeyboardInterrupt):
        EvaluationStore(tmp_path / "s.sqlite")
    assert list(tmp_path.iterdir()) == []


def test_a_store_that_may_not_be_written_to_can_be_read() -> None:
    with tempfile.TemporaryDirectory() as folder:  # pytest's own cannot be entered by other users
        path = Path(folder) / "it's here?" / "s.sqlite"
        with EvaluationStore(path) as store:
            store.put(evaluation("a"))
        path.chmod(0o444)
        for place in (path.parent, path.parent.parent):
            place.chmod(0o555)
        user = os.geteuid()
        try:
            if user == 0:  # root may write anywhere
                os.seteuid(65534)
            with pytest.raises(StoreError, match=r"may not be written to .* make file and folder writable"):
                EvaluationStore(path)
            with EvaluationStore(path, read_only=True) as store:
                assert [e.key for e in store] == [evaluation("a").key]
                with pytest.raises(StoreError, match="may not be written to"):
                    store.put(evaluation("b"))
        finally:
            os.seteuid(user)
            for place in (path.parent.parent, path.parent):
                place.chmod(0o755)
        assert [entry.name for entry in path.parent.iterdir()] == ["s.sqlite"]


def test_a_folder_is_refused(tmp_path: Path) -> None:
    with pytest.raises(StoreError, match="is a folder"):
        EvaluationStore(tmp_path)
