"""Engines: where evaluations run. Recipes go in, per-image errors come out."""

from sfkit.evaluation.engines.inline import InlineEngine
from sfkit.evaluation.engines.worker import Result, Worker

__all__ = ["InlineEngine", "Result", "Worker"]
