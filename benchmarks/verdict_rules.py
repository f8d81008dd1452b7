"""Evidence for the verdict's rule: what each candidate rule would have deployed, judged on unseen pairs.

    python benchmarks/verdict_rules.py --minutes 60   # go on with what is missing, at most so long
    python benchmarks/verdict_rules.py --list         # what there is to do, and what is done
    python benchmarks/verdict_rules.py --pool bank-slim --minutes 60    # the same on another bank
    python benchmarks/results.py verdict-rules        # write what is there into docs/results.md

A run is both stages guided by a few pairs, drawn anew for each seed. All rules see the same evaluations.
Every one goes through a store, so that a run can be interrupted at any moment. The real pool needs
SFKIT_REAL_DATA.
"""

from __future__ import annotations

import argparse
import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from functools import lru_cache, partial
from itertools import combinations
from pathlib import Path

import evidence_real
import numpy as np
import pandas as pd
from kept import RUNS, Job, KeptRuns
from stages import both

import sfkit
from sfkit.analysis.measured import Measured, measure_with
from sfkit.analysis.tables import markdown_lines
from sfkit.analysis.verdict import estimate_between, shown_worse, simplicity
from sfkit.bank import VALIDATION, benchmark, benchmarks
from sfkit.bank.plan import BANKS, bank_plan
from sfkit.evaluation.metrics import ImageErrors
from sfkit.merging import Pool, Recipe
from sfkit.search.averaging import average
from sfkit.streams import Stream, generator

POPULATION, GENERATIONS, EVALUATIONS = 12, 3, 40
BANK_SEEDS = {3: 4, 5: 4, 8: 4}
"""Validation pairs -> how many draws of pairs and searches; more cost too much on two cores."""
TEST_PAIRS = 8
REAL_PAIRS = 3
DRAWS = 200
"""Bootstrap resamples of the validation pairs."""
RULES = {
    "best": "best on validation",
    "1 SE": "simplest within one standard error",
    "2 SE": "simplest within two standard errors",
    "bagged": "bootstrap-averaged winner",
    "guarded": "bootstrap-averaged winner, unless validation shows it worse than the best",
    "vote": "most frequent bootstrap winner",
}
STAGE1, ROUTED = "Stage 1", "Stage 1+2"

BANK = "bank"

Networks = Mapping[str, Recipe]


def jobs(bank: str = BANK) -> dict[str, Job]:
    """Every run on a bank by name, and beside the first bank's the real pool's, in turn."""
    runs = sorted((seed, pairs) for pairs, seeds in BANK_SEEDS.items() for seed in range(seeds))
    found: list[tuple[float, str, Job]] = [
        (place / len(runs), f"{bank}-{pairs:02d}-{seed}", partial(on_bank, bank, pairs, seed))
        for place, (seed, pairs) in enumerate(runs)
    ]
    if bank == BANK and "SFKIT_REAL_DATA" in os.environ:
        splits = list(combinations(evidence_real.PAIRS, REAL_PAIRS))
        for seed, guides in enumerate(splits):
            found.append((seed / len(splits), f"real-{'+'.join(guides)}", partial(on_real, guides, seed)))
    return {name: job for _, name, job in sorted(found, key=lambda one: one[0])}


def on_bank(bank: str, pairs: int, seed: int, folder: Path) -> pd.DataFrame:
    """Guided by pairs of the validation world, judged on the other three."""
    known = benchmark(VALIDATION, of=bank_plan(bank).benchmarks)
    order = np.random.default_rng([seed, 7]).permutation(len(known))
    chosen = known.select([f"{VALIDATION}-{n:02d}" for n in sorted(order[:pairs])])
    with sfkit.EvaluationStore(folder / "evaluations.sqlite") as store:
        pool, judges = _opened(bank)
        judges = [judge.with_store(store) for judge in judges]
        return judged(pool, [sfkit.Evaluator(pool, chosen, store=store)], judges, seed)


def on_real(guides: Sequence[str], seed: int, folder: Path) -> pd.DataFrame:
    """Guided by three of five pairs of different data sets, judged on the other two."""
    with sfkit.EvaluationStore(folder / "evaluations.sqlite") as store:
        found = {name: one.with_store(store) for name, one in evidence_real.evaluators().items()}
        scorers = [found[name] for name in guides]
        judges = [one for name, one in found.items() if name not in guides]
        return judged(evidence_real.opened(), scorers, judges, seed)


def judged(
    pool: Pool, guides: Sequence[sfkit.Evaluator], judges: Sequence[sfkit.Evaluator], seed: int
) -> pd.DataFrame:
    """Both stages, what each rule takes of them, and its score on what guided nothing: a row a rule."""
    scorer = guides[0] if len(guides) == 1 else sfkit.CombinedScorer(guides)
    budget = {"population": POPULATION, "generations": GENERATIONS, "evaluations": EVALUATIONS}
    first, second = both(pool, scorer, seed, **budget, converge=True)
    best1, best2 = first.run(), second.run()
    searched = {
        f"{stage} {c.number}": c.recipe
        for stage, search in (("1", first), ("2", second))
        for c in search.candidates
        if not (c.repeated or c.failed)
    }
    named = {name: pool.equal(name) for name in pool.names}
    named |= {"uniform": pool.uniform(), STAGE1: best1.recipe, ROUTED: best2.recipe}
    validation = pooled(measure_with(guides, {**named, **searched}))
    choices, bagged = chosen(named, searched, validation, seed)
    names = {**named, "bagged": bagged}
    tests = measure_with(judges, {name: names[name] for name in {*choices.values(), STAGE1, ROUTED}})
    beside = pooled(measure_with(guides, {"bagged": bagged, "best": names[choices["best"]]}))
    choices["guarded"] = choices["best"] if shown_worse([beside], "bagged", "best") else "bagged"
    rows = []
    for rule, name in choices.items():
        rows.append(
            {
                "rule": rule,
                "network": name,
                "rung": simplicity(names[name])[0],
                "seed": seed,
                "pairs": len(validation.ids),
                "subset": "+".join(best1.subset),
                "validation": (beside if name == "bagged" else validation).score(name),
                "validation:stage1": validation.score(STAGE1),
                "unseen": mean(tests, name),
                "unseen:stage1": mean(tests, STAGE1),
            }
        )
    return pd.DataFrame(rows)


def chosen(
    named: Networks, searched: Networks, validation: Measured, seed: int
) -> tuple[dict[str, str], Recipe]:
    """Rule -> the network it takes; and the average of what wins bootstrap resamples of the pairs.

    As ``SearchPlan(resamples=200)`` does it, over pairs of one metric that count alike. The first three rules
    and the vote choose among the networks a verdict has; the average is over the
    winners among everything the stages scored.
    """
    scores = {name: validation.score(name) for name in named}
    rungs = {name: simplicity(recipe) for name, recipe in named.items()}
    best = min(scores, key=lambda name: (scores[name], rungs[name]))
    choices = {"best": best}
    for errors in (1, 2):
        close = [best]
        for name in named:
            between = estimate_between([validation], best, name)
            if rungs[name] < rungs[best] and between and -between.value <= errors * between.error:
                close.append(name)
        choices[f"{errors} SE"] = min(close, key=lambda name: (rungs[name], scores[name]))
    pairs = len(validation.ids)
    resamples = generator(seed, Stream.BOOTSTRAP_AVERAGE).integers(pairs, size=(DRAWS, pairs))
    winners = Counter(winning(list(searched), validation, resamples))
    votes = Counter(winning(list(named), validation, resamples))
    won = {searched[name]: count for name, count in winners.items()}
    bagged = average(won, list(dict.fromkeys(source for recipe in won for source in recipe.sources)))
    return {**choices, "bagged": "bagged", "vote": votes.most_common(1)[0][0]}, bagged


def winning(names: Sequence[str], validation: Measured, resamples: np.ndarray) -> list[str]:
    """The network of least error on each resample of the pairs; the earlier one of equals."""
    errors = np.stack([validation.terms(name)[0] for name in names])
    return [names[place] for place in errors[:, resamples].mean(axis=2).argmin(axis=0)]


def pooled(measured: Sequence[Measured]) -> Measured:
    """Benchmarks of one metric as one: a mean over all their images, each alike."""
    first = measured[0]
    images: dict[str, tuple[ImageErrors, ...]] = {
        name: tuple(image for one in measured for image in one.images[name]) for name in first.images
    }
    return Measured("validation", "all-valid", "pairs", first.metric, validation=True, images=images)


def mean(measured: Sequence[Measured], name: str) -> float:
    """The mean score over benchmarks."""
    return math.fsum(one.score(name) for one in measured) / len(measured)


@lru_cache
def _opened(bank: str) -> tuple[Pool, list[sfkit.Evaluator]]:
    """A bank, and the worlds that guide nothing."""
    pool, of = sfkit.open_pool(bank), bank_plan(bank).benchmarks
    names = [name for name in benchmarks() if name != VALIDATION]
    return pool, [sfkit.Evaluator(pool, benchmark(n, of=of).first(TEST_PAIRS)) for n in names]


def kept_of(bank: str = BANK) -> KeptRuns:
    """The runs on a bank, those of another than the first in a folder of their own."""
    return KeptRuns(__doc__, partial(jobs, bank), RUNS / ("rules" if bank == BANK else f"rules-{bank}"))


kept = kept_of()


KINDS = ("base", "single source", "equal weights", "routed")


def section() -> str:
    """Tables of whatever ``benchmarks/verdict_rules.py`` has finished.

    Raises:
        SystemExit: that is nothing.
    """
    parts = [_table(TITLES[name], kept.results(f"{name}-")) for name in TITLES]
    others = {name: kept_of(name) for name in BANKS if name != BANK}
    parts += [_table(f"On `{name}`, {UNSEEN}", runs.results(f"{name}-")) for name, runs in others.items()]
    if not any(parts):
        raise SystemExit("nothing is finished yet: run python benchmarks/verdict_rules.py first (hours)")
    return "\n\n".join([HEAD, *(part for part in parts if part)])


BUDGETS = f"M = {POPULATION}, T = {GENERATIONS}"
HEAD = f"""## Which rule should a verdict follow?

`python benchmarks/verdict_rules.py` (`--pool bank-sharp` for the sharp bank) goes on where it was, and what
follows are the runs that are finished. In each both stages ({BUDGETS},
{EVALUATIONS} evaluations) are guided by a few pairs, and every rule chooses among the
same networks. Change: the chosen network's score minus that of Stage 1, on the guiding pairs and on
unseen data sets, in points; **below 0 is better**. The last column sets each rule beside the best on
validation, on the unseen: mean change, and in how many of the runs where the two differ it is better."""


def _table(title: str, frame: pd.DataFrame) -> str:
    if frame.empty:
        return ""
    gained, change = (frame[name] - frame[f"{name}:stage1"] for name in ("validation", "unseen"))
    frame = frame.assign(gained=gained, change=change)
    rows, runs = [], len(frame) // frame["rule"].nunique()
    best = frame.loc[frame["rule"] == "best", "unseen"].to_numpy()
    for rule, part in frame.groupby("rule", sort=False):
        took = part["rung"].value_counts().sort_index()
        kinds = ", ".join(f"{count} {KINDS[int(rung)]}" for rung, count in took.items())
        better = f"{(part['change'] < 0).sum()} of {len(part)}"
        mean, worst = part["change"].mean(), part["change"].max()
        told = RULES[str(rule)]
        beside = part["unseen"].to_numpy() - best  # runs stand in one order under every rule
        unlike = int((beside != 0.0).sum())
        against = f"{beside.mean():+.2f}, {(beside < 0).sum()} of {unlike}" if unlike else ""
        rows.append(
            (told, kinds, f"{part['gained'].mean():+.2f}", f"{mean:+.2f}", f"{worst:+.2f}", better, against)
        )
    columns = ("rule", "what it took", "on validation", "on unseen", "worst run")
    columns += ("better than Stage 1", "beside the best")
    return f"### {title}\n\n{runs} runs.\n\n{markdown_lines(columns, rows)}"


UNSEEN = "bad-3.0, three other worlds unseen"
TITLES = {
    "bank": f"On the embedded bank, {UNSEEN}",
    "real": "On the real AnyNet pool, bad-1.0, each three of five pairs guide and two are unseen",
}


if __name__ == "__main__":
    asked = argparse.ArgumentParser(add_help=False)
    asked.add_argument("--pool", default=BANK)
    options, rest = asked.parse_known_args()
    kept_of(options.pool).main(rest)
