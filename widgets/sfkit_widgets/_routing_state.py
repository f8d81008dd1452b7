"""The workbench's records as the plain values that traits carry: lists, dicts, finite numbers or None."""

from __future__ import annotations

import math
from typing import Any

from sfkit.analysis.previews import PairLook, PairPreview
from sfkit.analysis.routings import RoutingTrace
from sfkit.analysis.workbench import RoutingWorkbench
from sfkit.editing import EditHistory, SeenByHand
from sfkit.evaluation.evaluator import Evaluator
from sfkit.merging import Pool
from sfkit.merging.recipe import Recipe
from sfkit_widgets._pictures import (
    disparity_legend,
    disparity_picture,
    error_legend,
    error_picture,
    photograph,
)

State = dict[str, Any]


def metric_state(evaluator: Evaluator) -> State:
    """How scores are called, and what they are over."""
    return {
        "name": evaluator.metric.name,
        "unit": evaluator.metric.unit,
        "benchmark": evaluator.benchmark.name,
        "pairs": len(evaluator.benchmark),
        "protocol": evaluator.benchmark.protocol,
    }


def trials_state(trace: RoutingTrace | None) -> State:
    """Columns by trial: iteration, score (None where it failed), number of the best up to it (-1: none)."""
    if trace is None:
        return {"iteration": [], "score": [], "best": []}
    return {
        "iteration": trace.generation.tolist(),
        "score": [plain(score) for score in trace.score.tolist()],
        "best": trace.incumbent.tolist(),
    }


def draft_state(history: EditHistory, pool: Pool) -> State:
    """The traits that show a draft; its JSON names the pool's networks."""
    draft = history.present
    return {
        "weights": [list(row) for row in draft.recipe.weights],
        "scales": list(draft.recipe.scales),
        "tied": draft.tied,
        "locked": [[(block, source) in draft.locked for source in draft.sources] for block in draft.blocks],
        "gone": list(draft.gone),
        "can_undo": bool(history.past),
        "can_redo": bool(history.future),
        "recipe_json": pool.bound(draft.recipe).to_json(),
    }


def pair_state(preview: PairPreview) -> State:
    """The traits that show a pair, whatever the recipe."""
    comparand = preview.comparand
    return {
        "pair": preview.pair,
        "size": list(preview.sample.size),
        "left_picture": photograph(preview.sample.left),
        "truth_picture": (
            disparity_picture(comparand.truth, preview.limits)
            if comparand.labelled
            else photograph(preview.sample.right)
        ),
        "captions": {
            "truth": "ground truth" if comparand.labelled else "right image",
            "error": comparand.kind.name,
        },
        "legends": {
            "disparity": disparity_legend(preview.limits),
            "error": error_legend(comparand.threshold, comparand.kind.unit),
        },
    }


def look_state(look: PairLook, preview: PairPreview) -> State:
    """The traits that show what a recipe does to the pair."""
    return {
        "disparity_picture": disparity_picture(look.disparity, preview.limits),
        "error_picture": error_picture(look.error, preview.comparand.threshold),
        "look": {
            "score": score_state(look.score),
            "reduction": look.reduction,
            "milliseconds": round(1000 * look.seconds, 1),
        },
    }


def pins_state(bench: RoutingWorkbench) -> State:
    """By pin: score on the pair, and on the whole benchmark."""
    return {
        name: {"pair": score_state(pin.look.score), "benchmark": score_state(bench.known_score(pin.recipe))}
        for name, pin in bench.pins.items()
    }


def pin_pictures(bench: RoutingWorkbench) -> State:
    """By pin: its pictures, apart from the scores since these change more often."""
    return {
        name: {
            "disparity": disparity_picture(pin.look.disparity, bench.preview.limits),
            "error": error_picture(pin.look.error, bench.preview.comparand.threshold),
        }
        for name, pin in bench.pins.items()
    }


def benchmark_state(bench: RoutingWorkbench, scoring: Recipe | None) -> State:
    """The recipe's score on the whole benchmark, or that it is being found out."""
    # Edits go on while a recipe is scored: only its own score is under way.
    if scoring is not None and scoring == bench.recipe:
        return {"state": "running", "value": None}
    return score_state(bench.known_score(bench.recipe))


def flag_text(bench: RoutingWorkbench, seen: tuple[SeenByHand, ...]) -> str:
    """What to know about scores here where a report tests on the same pairs; empty where none does."""
    if seen:
        return " ".join(map(str, seen))
    return " ".join(
        f"{name}: a report tests on {_pairs(len(ids))} of this benchmark; an edit that is scored here makes "
        "of that no test, and the report says so."
        for name, ids in bench.shared.items()
    )


def _pairs(number: int) -> str:
    return "1 pair" if number == 1 else f"{number} pairs"


def score_state(value: float | None) -> State:
    """A score and its state: ``unknown``, ``failed`` (not finite) or ``known``."""
    if value is None:
        return {"state": "unknown", "value": None}
    return {"state": "known" if math.isfinite(value) else "failed", "value": plain(value)}


def plain(value: float | None) -> float | None:
    """A number as JSON can carry it: None where it is not finite."""
    return value if value is not None and math.isfinite(value) else None
