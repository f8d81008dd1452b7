"""Engines: where evaluations run. Recipes go in, per-image errors come out."""

from sfkit.evaluation.engines.choice import ENGINES, Engine, check_engine, check_pool, make_engine
from sfkit.evaluation.engines.inline import InlineEngine
from sfkit.evaluation.engines.worker import Result, Worker

__all__ = [
    "ENGINES",
    "Engine",
    "InlineEngine",
    "Result",
    "Worker",
    "check_engine",
    "check_pool",
    "make_engine",
]
