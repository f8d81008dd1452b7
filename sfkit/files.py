"""Files of sfkit's own: written whole or not at all, where they can be written, and where shipped ones lie.

Every file that must not be met half written goes through :func:`writing`. A command's checks of the places
it will write to rest on :func:`unwritable`. Work that one process alone may do goes on within
:func:`holding`.
"""

from __future__ import annotations

import errno
import os
import stat
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sfkit.errors import InputError, SfkitWarning

_NO_LOCKS = (errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP)  # of a file system without them
_PATIENCE, _PAUSE = 1.0, 0.05  # seconds to wait for a lock that :func:`is_held` may just be looking at
_NAME = 50  # characters of a name that a temporary one repeats: names end at 255 bytes
PACKAGE = Path(__file__).resolve().parent


@contextmanager
def writing(path: Path, *, durable: bool = True) -> Iterator[Path]:
    """A new, empty file to fill, which takes the name ``path`` once that went well; its folder is made.

    Until then ``path`` is what it was, and whatever ends the block leaves nothing else behind. The file
    gets the permissions that the user's umask gives, however it is written.

    Args:
        path: the file to make or to replace.
        durable: whether its content is on the disk before it takes the name; a cache, which is checked when
            it is read, can do without.
    """
    with fresh_beside(path) as fresh:
        mode = fresh.stat().st_mode
        yield fresh
        fresh.chmod(mode)  # safetensors writes for the owner alone
        if durable:
            _flush(fresh)
        fresh.replace(path)


@contextmanager
def fresh_beside(path: Path) -> Iterator[Path]:
    """A new, empty file in the folder of ``path``, which is made; it is gone when the block ends.

    Its name cannot be foreseen, so that nobody else can have put a link there, and ends unlike that of any
    file that a folder is searched for.
    """
    path.parent.mkdir(parents=True, exist_ok=True)
    fresh = path.with_name(f".{path.name[:_NAME]}.{os.urandom(8).hex()}.part")
    fresh.touch(exist_ok=False)
    try:
        yield fresh
    finally:
        fresh.unlink(missing_ok=True)


def write_text(path: Path, text: str, *, durable: bool = True) -> Path:
    """Write a text as UTF-8, whole or not at all, and return its path."""
    return write_bytes(path, text.encode(), durable=durable)


def write_bytes(path: Path, content: bytes, *, durable: bool = True) -> Path:
    """Write bytes, whole or not at all, and return their path."""
    with writing(path, durable=durable) as fresh:
        fresh.write_bytes(content)
    return path


@contextmanager
def holding(lock: Path, refusal: str) -> Iterator[None]:
    """Hold a lock as long as the block runs; the system frees it when the process ends, however it ends.

    The file and its folder are made where there are none, and stay.

    Args:
        lock: the lock's file.
        refusal: the sentence for who comes second.

    Warns (:class:`~sfkit.errors.SfkitWarning`) where the file system has no locks: nobody is kept out then.

    Raises:
        InputError: ``refusal``, where another process, or another block of this one, holds it; or the file
            may not be written to.
    """
    from filelock import FileLock, Timeout  # not for commands that hold nothing

    lock.parent.mkdir(parents=True, exist_ok=True)
    # Not the thread's own: a notebook may begin work in one thread and end it in another.
    held = FileLock(lock, thread_local=False)
    try:
        held.acquire(timeout=_PATIENCE, poll_interval=_PAUSE)
    except Timeout as error:
        raise InputError(refusal) from error
    except (OSError, NotImplementedError) as error:
        if isinstance(error, OSError) and error.errno not in _NO_LOCKS:
            raise InputError(
                f"{lock}: cannot be locked ({error.strerror}), expected a file that this user may write to"
            ) from error
        warnings.warn(
            f"{lock}: its file system has no locks: let one process at a time work here",
            SfkitWarning,
            stacklevel=3,
        )
    try:
        yield
    finally:
        held.release()


def is_held(lock: Path) -> bool:
    """Whether a process that lives is within :func:`holding` of this file; nothing is written."""
    from filelock import FileLock, Timeout

    if not lock.is_file():
        return False
    probe = FileLock(lock, thread_local=False)
    try:
        probe.acquire(blocking=False)
    except Timeout:
        return True
    except (OSError, NotImplementedError):  # of another user, or without locks: not told
        return False
    probe.release()
    return False


Signature = tuple[int, int, int, int]


def signature(path: Path) -> Signature:
    """What a file looks like without being read: size, times of its last write and last change, and inode.

    The time of change cannot be set back: a copy that keeps the time of writing (``cp -p``) shows.

    Raises:
        OSError: there is no such file.
    """
    stat = path.stat()
    return stat.st_size, stat.st_mtime_ns, stat.st_ctime_ns, stat.st_ino


def is_file(path: Path) -> bool:
    """Whether there is a file of that name; no name that the system cannot have is one."""
    try:
        return path.is_file()
    except (OSError, ValueError):  # too long, or with a NUL
        return False


def unwritable(folder: Path) -> Path | None:
    """What keeps ``folder`` from being made or written to; None where nothing does.

    That is the nearest thing on the way to it that exists: a file, or a folder without write permission.
    """
    # A link that leads nowhere, or in a circle, is in the way as a file is.
    place = next(f for f in (folder.absolute(), *folder.absolute().parents) if os.path.lexists(f))
    return None if place.is_dir() and os.access(place, os.W_OK) else place


def ensure_writable(folder: Path, called: object, wanted: str = "expected one") -> None:
    """Refuse a folder that can be neither made nor written to.

    Args:
        folder: where something will be written.
        called: what the user named: the folder, a file in it, or an option.
        wanted: how the sentence ends.

    Raises:
        InputError: what is in the way (:func:`unwritable`).
    """
    if (place := unwritable(folder)) is not None:
        raise InputError(f"{called}: {place} is no folder that can be written to, {wanted}")


def trouble(path: Path) -> str | None:
    """What keeps a path from being read as a file, in words after its name; None where all is well."""
    try:
        mode = path.stat().st_mode
    except FileNotFoundError:
        return "is a link that leads nowhere" if path.is_symlink() else "no such file"
    except NotADirectoryError:
        return "no such file"
    except ValueError:
        return "is no name that a file can have"
    except OSError as error:
        circle = error.errno == errno.ELOOP
        return "is a link that leads in a circle" if circle else f"cannot be looked at ({error.strerror})"
    if stat.S_ISDIR(mode):
        return "is a folder"
    if not stat.S_ISREG(mode):
        return "is a pipe or a device"
    return None if os.access(path, os.R_OK) else "may not be read by this user"


def home(path: str | os.PathLike[str]) -> Path:
    """The path with ``~`` and ``~user`` replaced; one of a user who does not exist stays as it is.

    Raises:
        InputError: a text from a file that holds a NUL.
    """
    if "\0" in os.fspath(path):  # whose length systems and libraries take for different ones
        raise InputError(f"{str(path)!r}: is no name that a file can have, expected one without a NUL")
    try:
        return Path(path).expanduser()
    except RuntimeError:
        return Path(path)


def shipped(beside: str, inside: str) -> Path | None:
    """A folder that ships with sfkit; None where it is missing.

    Args:
        beside: its name in a checkout, where it lies beside the package.
        inside: its name in a wheel, which carries it inside the package.
    """
    places = (PACKAGE / inside, PACKAGE.parent / beside)
    return next((place for place in places if place.is_dir()), None)


def default_folder() -> Path:
    """The cache: ``SFKIT_CACHE``, or ``sfkit`` in the user's cache folder.

    Raises:
        InputError: ``SFKIT_CACHE`` names a file.
    """
    import platformdirs

    folder = Path(os.environ.get("SFKIT_CACHE") or platformdirs.user_cache_dir("sfkit"))
    if folder.exists() and not folder.is_dir():
        raise InputError(f"{folder}: SFKIT_CACHE names a file, expected a folder")
    return folder


def _flush(path: Path) -> None:
    # Open to write: Windows flushes nothing else.
    with path.open("rb+") as stream:
        os.fsync(stream.fileno())
