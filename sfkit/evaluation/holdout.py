"""Validation pairs held out from the search they belong to, at no cost: evaluations are of all images.

Each stored evaluation keeps the errors of every image, so that a recipe scored once has a score on the
images that may guide a search, and another one on those held out from it. The split is no part of an
evaluation's key: with another split, or without one, the same evaluations serve.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from numbers import Real
from typing import Any

from sfkit.errors import InputError, SfkitWarning
from sfkit.evaluation.outcome import Scorer
from sfkit.streams import Stream, generator

LEAST = 4
"""Fewer validation pairs are not split: neither part would say anything."""

Held = tuple[frozenset[int], ...]
"""Of one benchmark and each split, the numbers of the images held out."""


def check_holdout(argument: str, holdout: Any) -> Any:
    """Its value; refuses anything but 0, a share in (0, 1), or a whole number of folds of at least 2.

    Raises:
        InputError: what was found.
    """
    number = float(holdout) if isinstance(holdout, Real) else -1.0
    if not (0.0 <= number < 1.0 or (number >= 2.0 and number.is_integer())):
        raise InputError(
            f"{argument}: found {holdout!r}, expected 0 for none, a share of the validation pairs between 0 "
            "and 1, or a whole number of folds of at least 2"
        )
    return holdout


def deal(sizes: Sequence[int], holdout: float, seed: int) -> tuple[Held, ...]:
    """Who is held out: a share of all pairs, or each of k folds in its turn.

    Pairs are shuffled within their benchmark, and dealt one benchmark after the other, so that each
    benchmark gives its share, within a pair.

    Args:
        sizes: pairs of each benchmark; together at least two.
        holdout: a share in (0, 1), of which at least one pair and not all are held out, or k >= 2 folds,
            at most one a pair.
        seed: of the shuffle.

    Returns:
        For each benchmark and each split (one of a share, k of k folds) the images held out.
    """
    total = sum(sizes)
    rng = generator(seed, Stream.HOLDOUT)
    # Benchmark after benchmark, shuffled within each: dealt evenly, each part has pairs of all.
    order = [(b, int(i)) for b, size in enumerate(sizes) for i in rng.permutation(size)]
    if holdout < 1:
        # One pair at least on either side.
        count = min(max(round(total * holdout), 1), total - 1)
        # Spread evenly over the deal: the j-th held-out pair is the one where j / total is first reached.
        marks = [(n + 1) * count // total - n * count // total for n in range(total)]
        folds = [0 if mark else -1 for mark in marks]
        splits = 1
    else:
        # A fold without a pair would hold nothing out.
        splits = min(int(holdout), total)
        folds = [n % splits for n in range(total)]
    held = [[set[int]() for _ in range(splits)] for _ in sizes]
    for (benchmark, image), fold in zip(order, folds, strict=True):
        if fold >= 0:
            held[benchmark][fold].add(image)
    return tuple(tuple(frozenset(images) for images in splits_of) for splits_of in held)


def held_out(scorer: Scorer, holdout: float, seed: int = 0) -> Scorer:
    """The same scorer, whose outcomes also tell scores on pairs held out (:attr:`Outcome.parts`).

    Warns (:class:`~sfkit.errors.SfkitWarning`) where there are fewer than four pairs, and returns the
    scorer as it is.

    Args:
        scorer: an evaluator, or several combined, whose pairs are then split together.
        holdout: a share in (0, 1), or the number of folds; 0 returns the scorer as it is.
        seed: which pairs; the same seed holds out the same ones.

    Raises:
        InputError: ``holdout`` is none of these, or the scorer is of another kind.
    """
    check_holdout("holdout", holdout)
    if holdout == 0:
        return scorer
    from sfkit.evaluation.combining import CombinedScorer, evaluators_for

    known = evaluators_for("holdout", scorer)
    sizes = [len(evaluator.benchmark) for evaluator in known]
    if sum(sizes) < LEAST:
        pairs = f"{sum(sizes)} validation pair{'s' * (sum(sizes) > 1)}"
        warnings.warn(
            f"holdout: found {pairs}, expected at least {LEAST} to hold some out: the search is "
            "guided by all of them, and what it gains on so few need not show elsewhere",
            SfkitWarning,
            stacklevel=3,
        )
        return scorer
    views = [e.with_splits(held) for e, held in zip(known, deal(sizes, holdout, seed), strict=True)]
    return scorer.over(views) if isinstance(scorer, CombinedScorer) else views[0]


def splits_of(scorer: Scorer) -> int:
    """How many splits the outcomes of a scorer tell: 0 without a hold-out, 1 of a share, k of k folds."""
    from sfkit.evaluation.combining import CombinedScorer
    from sfkit.evaluation.evaluator import Evaluator

    first = scorer.evaluators[0] if isinstance(scorer, CombinedScorer) else scorer
    return len(first.splits) if isinstance(first, Evaluator) else 0
