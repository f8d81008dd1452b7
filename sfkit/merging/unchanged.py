"""Whether a pool's files are what it was opened from: their pages are mapped, and workers open them anew."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from sfkit.checkpoints.layouts import Wrapping
from sfkit.errors import InputError
from sfkit.files import Signature, signature
from sfkit.merging.members import Checked, PoolOpener

_SAME: set[tuple[Path, Signature, str]] = set()
"""Files that look otherwise than when they were opened and were found to have the same content."""


def ensure_unchanged(
    members: Iterable[Checked], opener: PoolOpener, wrappings: dict[str, Wrapping], pool: str
) -> None:
    """Compare the members' files with what they were; one that looks otherwise is read again.

    A file that was moved away or replaced by another of its name is still mapped, and only the latter shows.

    Raises:
        InputError: a file has another content than it had.
    """
    for member in members:
        for path, look in member.signatures.items():
            try:
                now = signature(path)
            except OSError:
                continue
            if now == look or (path, now, member.fingerprint) in _SAME:
                continue
            if not _is_same(member, opener, wrappings.get(member.name)):
                raise InputError(
                    f"{path}: has changed since pool {pool!r} was opened (member {member.name!r}), expected "
                    "a file that stays: open the pool again, and write new checkpoints under new names"
                )
            _SAME.add((path, now, member.fingerprint))


def _is_same(member: Checked, opener: PoolOpener, wrapping: Wrapping | None) -> bool:
    try:
        file = opener.read(member.path, is_base=member.name == "base", wrapping=wrapping)
        return opener.contents(file).fingerprint == member.fingerprint
    except InputError:
        return False
