"""Evaluation: metrics, protocols, engines, the evaluation store and what is built on them."""

from typing import TYPE_CHECKING

from sfkit.on_demand import on_demand

if TYPE_CHECKING:
    from sfkit.evaluation.combining import CombinedScorer, validation_scorer
    from sfkit.evaluation.compute import Compute
    from sfkit.evaluation.estimating import Estimate, estimate
    from sfkit.evaluation.evaluator import Evaluator
    from sfkit.evaluation.outcome import Outcome, Scorer
    from sfkit.evaluation.store import Evaluation, EvaluationStore
    from sfkit.evaluation.table import pivot, score_recipes
else:
    __getattr__, __dir__ = on_demand(__name__)
