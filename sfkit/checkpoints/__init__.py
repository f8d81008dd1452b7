"""Checkpoints: reading, checking, fingerprinting and writing them; the description of a pool."""

from sfkit.checkpoints.layouts import Layout
from sfkit.checkpoints.reading import CheckpointFile, read_checkpoint
from sfkit.checkpoints.spec import Member, PoolSpec, read_pool_spec
from sfkit.checkpoints.writing import FileForm, write_checkpoint

__all__ = [
    "CheckpointFile",
    "FileForm",
    "Layout",
    "Member",
    "PoolSpec",
    "read_checkpoint",
    "read_pool_spec",
    "write_checkpoint",
]
