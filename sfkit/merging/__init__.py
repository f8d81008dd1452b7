"""Merging: blocks, flat task vectors, recipes, the pool and the live model."""

from sfkit.merging.blocks import BlockPartition
from sfkit.merging.live import LiveModel
from sfkit.merging.opening import open_pool
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe, routed

__all__ = ["BlockPartition", "LiveModel", "Pool", "Recipe", "open_pool", "routed"]
