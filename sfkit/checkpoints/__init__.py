"""Checkpoints: reading, checking, fingerprinting and writing them; the description of a pool."""

from typing import TYPE_CHECKING

from sfkit.on_demand import on_demand

if TYPE_CHECKING:
    from sfkit.checkpoints.layouts import Layout
    from sfkit.checkpoints.reading import CheckpointFile, read_checkpoint
    from sfkit.checkpoints.spec import Member, PoolSpec, read_pool_spec
    from sfkit.checkpoints.targets import FileForm
    from sfkit.checkpoints.writing import write_checkpoint
else:
    __getattr__, __dir__ = on_demand(__name__)
