"""Greedy model soups (Wortsman et al., ICML 2022, recipe 1)."""

from __future__ import annotations

from sfkit.baselines.registry import Choice, baseline
from sfkit.baselines.trials import Trials

PAPER = "Wortsman et al., ICML 2022"


@baseline("greedy_soup", label="greedy soup (>=)", paper=PAPER)
def greedy_soup(trials: Trials) -> Choice:
    """Sources from best to worst, each kept where the mean scores no worse with it, as the paper says."""
    return _greedy(trials, strict=False)


@baseline("greedy_soup_strict", label="greedy soup (>)", paper=f"{PAPER}, the authors' code")
def greedy_soup_strict(trials: Trials) -> Choice:
    """The same, each kept only where the mean scores better with it, as the authors' code does."""
    return _greedy(trials, strict=True)


def _greedy(trials: Trials, *, strict: bool) -> Choice:
    names = trials.pool.names
    alone = trials.score(
        [trials.pool.equal(name) for name in names],
        [{"step": "alone", "subset": (name,), "kept": False} for name in names],
    )
    # Of equals the pool's order decides, so that two runs agree.
    ranked = sorted(range(len(names)), key=lambda n: (alone[n], n))
    soup: tuple[str, ...] = (names[ranked[0]],)
    score = alone[ranked[0]]
    for n in ranked[1:]:
        tried = (*soup, names[n])
        # The pool's order, as in every other equal-weight merge, so that one subset is one evaluation.
        recipe = trials.pool.equal(*(name for name in names if name in tried))
        (found,) = trials.score([recipe], [{"step": f"with {names[n]}", "subset": recipe.sources}])
        if found < score or (found == score and not strict):
            soup, score = tried, found
    chosen = trials.pool.equal(*(name for name in names if name in soup))
    return Choice(chosen, settings={"subset": chosen.sources})
