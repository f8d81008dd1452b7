"""Engines: where evaluations run. Recipes go in, per-image errors come out."""

from sfkit.evaluation.compute import ENGINES
from sfkit.evaluation.engines.choice import Engine, Runner, check_pool, make_engine
from sfkit.evaluation.engines.inline import InlineEngine
from sfkit.evaluation.engines.worker import Result, Worker
