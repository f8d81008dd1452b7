"""From data sets to sources to one network, in one file: what is missing or stale is made, nothing else."""

from sfkit.factory.file import Factory, read_factory
from sfkit.factory.run import run
from sfkit.factory.status import Item, status

__all__ = ["Factory", "Item", "read_factory", "run", "status"]
