"""Engines: where evaluations run. Recipes go in, per-image errors come out."""

from sfkit.evaluation.compute import ENGINES
from sfkit.evaluation.engines.choice import Engine, check_pool, make_engine
from sfkit.evaluation.engines.inline import InlineEngine
from sfkit.evaluation.engines.runner import Runner
from sfkit.evaluation.engines.worker import Result, Worker
