"""Which file system a path lies on, and which of them other machines may write to as well."""

from __future__ import annotations

import os
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

NETWORK_FILE_SYSTEMS = frozenset([
    "nfs", "nfs3", "nfs4", "cifs", "smb", "smb2", "smb3", "smbfs", "ncpfs", "afs", "afpfs", "9p",
    "ceph", "lustre", "gpfs", "beegfs", "fhgfs", "glusterfs", "pvfs2", "orangefs", "davfs", "webdav",
    "coda", "ocfs2", "gfs2", "virtiofs", "vboxsf", "vmhgfs", "prl_fs", "wekafs", "panfs", "juicefs",
])  # fmt: skip
LOCAL_FUSE = frozenset([
    "fuse-overlayfs", "overlayfs", "mergerfs", "bindfs", "ntfs-3g", "encfs", "gocryptfs", "cryfs",
    "squashfuse", "portal",
])  # fmt: skip
"""What runs through FUSE on one machine; any other (sshfs, s3fs, juicefs, ...) may have others behind it."""


def is_shared(kind: str) -> bool:
    """Whether other machines may write to a file system of this type."""
    return kind in NETWORK_FILE_SYSTEMS or (
        kind.startswith("fuse.") and kind.removeprefix("fuse.") not in LOCAL_FUSE
    )


def file_system(path: Path, mounts: Path = Path("/proc/mounts")) -> str:
    """The type of the file system that ``path`` lies on, links followed; empty where nothing says it.

    Args:
        path: it need not exist.
        mounts: Linux's mount table; other systems are asked by ``mount``.
    """
    place = Path(os.path.realpath(path))
    best, kind = -1, ""
    for target, fstype in _mounted(mounts):
        # The deepest mount point counts; of two at one place the later one hides the earlier.
        if place.is_relative_to(target) and len(target.parts) >= best:
            best, kind = len(target.parts), fstype
    return kind


def _mounted(table: Path) -> Iterator[tuple[Path, str]]:
    if table.is_file():
        for line in table.read_text(encoding="utf-8", errors="surrogateescape").splitlines():
            # A space in a mount point is written as \040, and so on.
            _, point, fstype, *_ = line.split(" ")
            yield Path(re.sub(r"\\([0-7]{3})", lambda code: chr(int(code[1], 8)), point)), fstype
        return
    yield from printed_mounts(_printed())


def printed_mounts(text: str) -> Iterator[tuple[Path, str]]:
    """Place and type of each line that macOS's and BSD's ``mount`` prints."""
    for found in re.finditer(r"^.+? on (/.*) \((\w+)[^()]*\)$", text, re.MULTILINE):
        yield Path(found[1]), found[2]


def _printed() -> str:
    try:
        return subprocess.run(["/sbin/mount"], capture_output=True, text=True, check=False).stdout
    except OSError:  # Windows has none
        return ""
