"""Which file system a path lies on, and which of them lie on another machine."""

from __future__ import annotations

from pathlib import Path

NETWORK_FILE_SYSTEMS = frozenset(
    [
        "nfs",
        "nfs4",
        "cifs",
        "smb",
        "smb2",
        "smb3",
        "smbfs",
        "ncpfs",
        "afs",
        "9p",
        "ceph",
        "lustre",
        "gpfs",
        "beegfs",
        "glusterfs",
        "pvfs2",
        "davfs",
        "fuse.sshfs",
        "fuse.glusterfs",
        "fuse.s3fs",
        "fuse.gcsfuse",
        "fuse.rclone",
        "fuse.ceph",
    ]
)


def file_system(path: Path, mounts: Path = Path("/proc/mounts")) -> str:
    """The file-system type ``path`` lies on, by the mount table; empty where there is none to read."""
    if not mounts.is_file():
        return ""
    place = path.absolute()
    best, kind = -1, ""
    for line in mounts.read_text(encoding="utf-8", errors="replace").splitlines():
        _, point, fstype, *_ = line.split(" ")
        target = Path(point.replace("\\040", " "))
        if place.is_relative_to(target) and len(target.parts) >= best:
            best, kind = len(target.parts), fstype
    return kind
