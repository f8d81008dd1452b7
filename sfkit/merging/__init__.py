"""Merging: blocks, flat task vectors, recipes, the pool and the live model."""

from typing import TYPE_CHECKING

from sfkit.on_demand import on_demand

if TYPE_CHECKING:
    from sfkit.merging.blocks import BlockPartition
    from sfkit.merging.live import LiveModel
    from sfkit.merging.opening import open_pool
    from sfkit.merging.pool import Pool
    from sfkit.merging.recipe import Recipe, routed
else:
    __getattr__, __dir__ = on_demand(__name__)
