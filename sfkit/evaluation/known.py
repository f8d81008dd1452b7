"""What a store knows of a pool and a benchmark already, for searches that learn from every evaluation."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from sfkit.checkpoints.fingerprints import text_digest
from sfkit.evaluation.combining import CombinedScorer, only_evaluators
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.outcome import Scorer
from sfkit.evaluation.store import BASELINE, HAND_EDIT, Evaluation, EvaluationStore
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe

_BEGAN = "search began"


@dataclass(frozen=True)
class Known:
    """A recipe that was scored before a search began, by whomever.

    Attributes:
        recipe: over sources of this pool and its blocks.
        score: on the search's benchmark, lower is better.
        origin: who asked for it: ``"hand edit"``; ``"baseline"`` where one asked first; ``"search"`` for
            searches and tables alike, and for baselines of before November 30, 2026, which left no mark.
    """

    recipe: Recipe
    score: float
    origin: str = "search"


def known_evaluations(pool: Pool, scorer: Scorer, search: Mapping[str, Any]) -> tuple[Known, ...]:
    """Every evaluation of this pool on this benchmark that was stored before a search first began.

    The store remembers how much it held then, so that the search, killed and started again, learns from the
    same: what it stored itself comes to it as its own candidates. Failed candidates and merges of prepared
    task vectors are left out.

    Args:
        pool: recipes over its sources and blocks are found, by content.
        scorer: an evaluator, or several combined; a scorer of another kind knows nothing.
        search: what tells this search from others, as JSON values: its settings, limits and the like.

    Returns:
        In the order of writing; of several benchmarks what is known on all of them.
    """
    evaluators = only_evaluators(scorer)
    if not evaluators:
        return ()
    identity = {
        "search": dict(search),
        "frames": [evaluator.frame for evaluator in evaluators],
        "sources": pool.identity,
        "partition": pool.partition.fingerprint(),
    }
    # In content: a search in another folder, under another name, is the same one.
    name = text_digest(json.dumps(identity, sort_keys=True))
    tables = [_known(pool, evaluator, _began(evaluator.store, name)) for evaluator in evaluators]
    # What one of the stores lacks has no combined score.
    shared = [key for key in tables[0] if all(key in table for table in tables)]
    if not isinstance(scorer, CombinedScorer):
        return tuple(tables[0].values())
    return tuple(
        Known(
            tables[0][key].recipe,
            scorer.combined([table[key].score for table in tables]),
            tables[0][key].origin,
        )
        for key in shared
    )


def _began(store: EvaluationStore, name: str) -> int:
    """How many evaluations the store had when the search first began."""
    # A second mark changes nothing: what is read back is how it was at first.
    store.mark(name, _BEGAN, str(store.last))
    return int(dict(store.marks(_BEGAN))[name])


def scored(evaluator: Evaluator, before: int | None = None) -> dict[str, Evaluation]:
    """Every evaluation in an evaluator's store that it made or might have, by the recipe's canonical JSON.

    In the order of writing; failed candidates are left out. ``before`` keeps the first so many that were
    written, all unless given.
    """
    # As the store gives it back: tuples are lists there.
    frame = json.loads(json.dumps(evaluator.frame))
    store = evaluator.store
    found = {}
    for evaluation in store if before is None else store.until(before):
        described = dict(evaluation.description)
        canonical = described.pop("recipe", None)
        if not evaluation.failure and described == frame:
            found[json.dumps(canonical, sort_keys=True)] = evaluation
    return found


def _known(pool: Pool, evaluator: Evaluator, before: int) -> dict[str, Known]:
    """By the recipe's canonical form."""
    # A person's edit counts, whoever scored it first.
    asked = {key: mark for mark in (BASELINE, HAND_EDIT) for key, _ in evaluator.store.marks(mark)}
    found = {}
    for canonical, evaluation in scored(evaluator, before).items():
        recipe = _recipe(pool, json.loads(canonical))
        if recipe is not None:
            origin = asked.get(evaluation.key, "search")
            found[canonical] = Known(recipe, evaluator.score(evaluation.images), origin)
    return found


def _recipe(pool: Pool, canonical: Any) -> Recipe | None:
    """The recipe over this pool's names; None where it is of other sources or blocks, or prepared."""
    names = {fingerprint: name for name, fingerprint in pool.identity.items()}
    sources = canonical.get("sources", []) if isinstance(canonical, dict) else []
    if not sources or not set(sources) <= set(names) or not set(canonical) <= _FORM:
        return None
    if canonical.get("partition", pool.partition.fingerprint()) != pool.partition.fingerprint():
        return None
    blocks = pool.blocks
    # Without scales it is a merge that treats all blocks alike (Recipe.canonical).
    routed = "scales" in canonical
    rows = canonical["weights"] if routed else [canonical["weights"]] * len(blocks)
    scales = canonical["scales"] if routed else [1.0] * len(blocks)
    # A key has its sources by fingerprint, a recipe in the pool's order.
    order = sorted(range(len(sources)), key=lambda e: pool.names.index(names[sources[e]]))
    return Recipe(
        tuple(names[sources[e]] for e in order),
        blocks,
        tuple(tuple(row[e] for e in order) for row in rows),
        tuple(scales),
    )


_FORM = {"sources", "weights", "scales", "partition"}
