"""From data sets to sources to one network, in one file: what is missing or stale is made, nothing else."""

from typing import TYPE_CHECKING

from sfkit.on_demand import on_demand

if TYPE_CHECKING:
    from sfkit.factory.example import write_example
    from sfkit.factory.file import Factory, read_factory
    from sfkit.factory.report import report_values
    from sfkit.factory.running import Cost, FactoryResult, run
    from sfkit.factory.searching import SearchItem, most_evaluations, search_status
    from sfkit.factory.standing import Item, status
    from sfkit.factory.timing import time_evaluation, time_steps
    from sfkit.factory.training import train_missing, train_one
else:
    __getattr__, __dir__ = on_demand(__name__)
