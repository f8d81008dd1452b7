"""From data sets to sources to one network, in one file: what is missing or stale is made, nothing else."""

from sfkit.factory.example import write_example
from sfkit.factory.file import Factory, read_factory
from sfkit.factory.report import report_values
from sfkit.factory.run import Cost, FactoryResult, run
from sfkit.factory.status import Item, most_evaluations, status
from sfkit.factory.training import train_missing, train_one
