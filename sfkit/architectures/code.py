"""The user's code: files and modules that register architectures, run once and only where they are trusted.

``pool.toml`` may say where a network's code is, a package may declare it as an entry point of the group
``sfkit.architectures``, and ``--import FILE`` names a file by hand. Running a file that a ``pool.toml`` names
is running what somebody wrote into a folder of checkpoints: it is asked for on a terminal, once for each
content of the file, and refused elsewhere unless the file was named, or ``--trust-code`` given.
"""

from __future__ import annotations

import hashlib
import importlib
import importlib.util
import linecache
import os
import sys
import types
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from sfkit.errors import InputError
from sfkit.files import home, trouble

GROUP = "sfkit.architectures"
TRUST = "SFKIT_TRUST_CODE"  # "all", or digests with colons between; child processes inherit it
FAILURES = (Exception, SystemExit)  # of another's code: a script ends the command as if it had worked
IMPORT = "SFKIT_IMPORT"  # files that --import names, for child processes
CONFIG = "SFKIT_CONFIG"


@dataclass(frozen=True)
class Code:
    """A file that registers architectures, as it was run.

    Attributes:
        path: where it is.
        text: its content, so that a worker without the file can run it too.
        identity: digest of it and of the modules beside it that it imported.
    """

    path: Path
    text: str
    identity: str


_RUN: dict[str, tuple[Code, types.ModuleType]] = {}
_ask: Callable[[Path], bool] | None = None


def digest_of(text: str) -> str:
    """The digest under which a file is trusted."""
    return hashlib.sha256(text.encode()).hexdigest()


def run_file(path: str | Path, *, trusted: bool = False) -> tuple[Code, types.ModuleType]:
    """Run a Python file under a private name, unless that content was run before.

    Two files may be called alike, and import unlike packages called alike from beside them.

    Args:
        path: the file.
        trusted: whether the caller has it from the user in person.

    Raises:
        InputError: there is no such file, it is not trusted, or it fails.
    """
    if why := trouble(Path(path)):
        raise InputError(f"{path}: {why}, expected Python code that registers an architecture")
    path = Path(path).resolve()
    text = path.read_text(encoding="utf-8", errors="replace")
    if not trusted:
        ensure_trusted(path, text)
    trust(text)
    return _execute(path, text)


def run_modules() -> list[tuple[Code, types.ModuleType]]:
    """What was run, in order."""
    return list(_RUN.values())


def run_text(code: Code) -> None:
    """Run what another process ran, from its text; used by workers on machines without the file."""
    trust(code.text)
    _execute(code.path, code.text)


def _execute(path: Path, text: str) -> tuple[Code, types.ModuleType]:
    # By place as well: what it imports from beside it may differ.
    key = digest_of(f"{path}\n{text}")
    if key in _RUN:
        return _RUN[key]
    name = f"sfkit_code_{key[:12]}"
    spec = importlib.util.spec_from_loader(name, loader=None, origin=str(path))
    module = types.ModuleType(name) if spec is None else importlib.util.module_from_spec(spec)
    module.__file__ = str(path)
    sys.modules[name] = module
    # A class's source is part of its version: what runs counts, not what the file has become since.
    linecache.cache[str(path)] = (len(text), None, text.splitlines(keepends=True), str(path))
    try:
        with _beside(path.parent) as imported:
            # What a traceback and inspect show are the file's own lines.
            exec(compile(text, str(path), "exec"), module.__dict__)  # noqa: S102 (the user said so)
    except FAILURES as error:
        del sys.modules[name]
        raise InputError(f"{path}: running it failed ({type(error).__name__}: {error})") from error
    # What lies beside it and was imported decides the network, too.
    parts = [text, *(p.read_text(encoding="utf-8", errors="replace") for p in sorted(imported))]
    code = Code(path, text, digest_of("\0".join(parts))[:16])
    _RUN[key] = code, module
    return _RUN[key]


@contextmanager
def _beside(folder: Path) -> Iterator[set[Path]]:
    """Modules in ``folder`` can be imported, and are forgotten by name after: another file has its own.

    Yields:
        The files that were imported from there, known when the block has ended.
    """
    before, imported = set(sys.modules), set[Path]()
    sys.path.insert(0, str(folder))
    importlib.invalidate_caches()
    try:
        yield imported
    finally:
        sys.path.remove(str(folder))
        # Two files may each have a models.py beside them: neither is to find the other's.
        for name in set(sys.modules) - before:
            file = getattr(sys.modules[name], "__file__", None)
            if file and Path(file).resolve().is_relative_to(folder) and not name.startswith("sfkit_code_"):
                imported.add(Path(file).resolve())
                del sys.modules[name]


def import_from(folder: str | Path, module: str, attribute: str) -> Callable[..., object]:
    """A class of a checkout: ``import_from(root, "core.raft_stereo", "RAFTStereo")``.

    The checkout's packages are importable while it is imported, and forgotten by name after, so that two
    checkouts with a package of one name live side by side.

    Raises:
        InputError: there is no such folder, module or class, or it cannot be imported.
    """
    folder = Path(os.path.realpath(home(folder)))  # links in a circle lead to no folder
    if not folder.is_dir():
        raise InputError(f"{folder}: no such folder, expected a checkout with {module.replace('.', '/')}.py")
    try:
        with _beside(folder):
            found = getattr(importlib.import_module(module), attribute)
    except FAILURES as error:  # a package it needs may fail with anything, torchvision with RuntimeError
        reason = f"{type(error).__name__}: {error}"
        raise InputError(
            f"{folder}: {module}.{attribute} cannot be imported ({reason}); is what this checkout asks for "
            "installed, and is this the right checkout?"
        ) from error
    return found  # type: ignore[no-any-return]


def tree_digest(folder: str | Path, below: str = ".") -> str:
    """Digest of a checkout's Python files; a changed checkout never meets the scores of its former self."""
    total = hashlib.sha256()
    root = home(folder)
    for path in sorted((root / below).rglob("*.py")):
        name = path.relative_to(root).as_posix()
        if "foundation" not in name.lower() and "/." not in f"/{name}":
            total.update(f"{name}\0".encode())
            total.update(path.read_bytes())
    return total.hexdigest()[:16]


def trust(text: str) -> None:
    """Trust a file's content in this process and in those it starts."""
    trusted = os.environ.get(TRUST, "")
    if digest_of(text) not in trusted.split(":"):
        os.environ[TRUST] = ":".join(filter(None, (trusted, digest_of(text))))


def trust_all() -> None:
    """Run whatever code a ``pool.toml`` names, in this process and in those it starts."""
    os.environ[TRUST] = "all"


def ask_with(ask: Callable[[Path], bool] | None) -> None:
    """How the user is asked whether a file may be run; None where nobody can be asked."""
    global _ask
    _ask = ask


def ensure_trusted(path: Path, text: str) -> None:
    """Refuse a file that nobody has trusted.

    Raises:
        InputError: the user is not there to be asked, or said no.
    """
    trusted, digest = os.environ.get(TRUST, "").split(":"), digest_of(text)
    if "all" in trusted or digest in trusted or digest in _remembered():
        return
    if _ask is not None and _ask(path):
        # By content, so that a changed file is asked about again.
        file = _memory()
        file.parent.mkdir(parents=True, exist_ok=True)
        with file.open("a", encoding="utf-8") as stream:
            stream.write(f"{digest}  {path}\n")
        return
    raise InputError(
        f"{path}: opening this pool would run that code, which sfkit asks about on a terminal and refuses "
        "elsewhere: pass --trust-code (or --import with the file), or call sfkit.trust_code(path) first"
    )


def _memory() -> Path:
    home = os.environ.get(CONFIG) or os.environ.get("XDG_CONFIG_HOME")
    return Path(home or Path.home() / ".config") / "sfkit" / "trusted-code"


def _remembered() -> set[str]:
    file = _memory()
    if not file.is_file():
        return set()
    return {line.partition(" ")[0] for line in file.read_text(encoding="utf-8").splitlines()}


def trust_code(path: str | Path) -> None:
    """Allow a file of code to be run by the pools that name it, as it is now.

    Raises:
        InputError: there is no such file.
    """
    path = Path(path)
    if not path.is_file():
        raise InputError(f"{path}: no such file, expected Python code")
    trust(path.read_text(encoding="utf-8", errors="replace"))


def ensure_module_trusted(name: str) -> None:
    """Refuse to import a module that only a ``pool.toml`` names.

    Raises:
        InputError: there is no such module, or it is not trusted.
    """
    # It has run by now: a refusal would come too late.
    if name in sys.modules:
        return
    try:
        spec = importlib.util.find_spec(name)
    except ImportError:
        spec = None
    if spec is None or spec.origin is None:
        raise InputError(
            f"module {name!r} cannot be found, expected {name.replace('.', '/')}.py beside pool.toml, or an "
            "installed module"
        )
    path = Path(spec.origin)
    ensure_trusted(path, path.read_text(encoding="utf-8", errors="replace"))


def imported_files() -> Iterator[Path]:
    """The files that --import named, here or in the process that started this one."""
    yield from (Path(name) for name in os.environ.get(IMPORT, "").split(os.pathsep) if name)


def declared(name: str) -> object | None:
    """What an installed package declares under this architecture's name; None where none does."""
    from importlib.metadata import entry_points

    for entry in entry_points(group=GROUP, name=name):
        try:
            return entry.load()  # type: ignore[no-any-return]
        except FAILURES as error:
            reason = str(error).partition("\n")[0] or type(error).__name__
            raise InputError(
                f"architecture {name!r}: its package cannot be imported ({reason}; entry point {entry.value})"
            ) from error
    return None


def declared_names() -> set[str]:
    """The names of all architectures that installed packages declare."""
    if not _declares(tuple(sys.path)):
        return set()
    from importlib.metadata import entry_points

    return {entry.name for entry in entry_points(group=GROUP)}


def _declares(places: Sequence[str]) -> bool:
    """Whether an installed package may declare one: its file is looked into, for importlib.metadata, which is
    asked only then, takes as long as all else a refusal needs.
    """
    files = ("*.dist-info/entry_points.txt", "*.egg-info/entry_points.txt", "EGG-INFO/entry_points.txt")
    for place in map(Path, places):
        try:
            if place.is_file():  # an archive, into which importlib.metadata looks
                return True
            for file in (found for pattern in files for found in place.glob(pattern)):
                if f"[{GROUP}]" in file.read_text(encoding="utf-8", errors="replace"):
                    return True
        except OSError:  # not to be looked into by this user: importlib.metadata says what it finds
            return True
    return False
