"""The bank's networks on its benchmarks and domains: numbers for the report and for the bar."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from sfkit.bank.plan import BANK, HELD_OUT_PAIRS, bank_plan
from sfkit.bank.rendered import METRIC, benchmark, benchmarks, held_out
from sfkit.datasets.synthetic.domains import BASE, VALIDATION, domains
from sfkit.evaluation import EvaluationStore, score_recipes
from sfkit.merging import Pool, Recipe

UNIFORM = "uniform"
"""Row name of the equal-weight merge of all sources, beside the 12 networks."""


@dataclass(frozen=True)
class BankScores:
    """All scores, one row a network.

    Attributes:
        benchmarks: bad-3.0 in percent, a column a benchmark, the validation benchmark first.
        domains: bad-3.0 in percent on held-out pairs, a column a domain, the base's first.
        errors: end-point error in pixels on the same pairs.
        trainings: the record of each training, by domain name.
    """

    benchmarks: pd.DataFrame
    domains: pd.DataFrame
    errors: pd.DataFrame
    trainings: dict[str, Any]

    @property
    def unseen(self) -> pd.Series:
        """Mean over the benchmarks that no search looks at, a network each."""
        return self.benchmarks.drop(columns=VALIDATION).mean(axis=1)


def bank_scores(
    pool: Pool,
    folder: Path,
    *,
    store: EvaluationStore | None = None,
    pairs: int | None = None,
    of: str = BANK.name,
) -> BankScores:
    """Score the bank in ``folder`` (where its ``trainings.json`` lies), open as ``pool``.

    All benchmarks and 24 held-out pairs a domain of the bank ``of``; with ``pairs``, only the first so many
    of each. Sources that the bank's domains do not name, such as a joint network, are scored as well.
    """
    recipes = network_recipes(pool)
    own = score_recipes(
        pool,
        recipes,
        [held_out(name, pairs or HELD_OUT_PAIRS, of=of) for name in domains()],
        metrics=(METRIC, "epe"),
        store=store,
    )
    return BankScores(
        benchmarks=benchmark_scores(pool, store=store, pairs=pairs, of=of),
        domains=_square(own, METRIC),
        errors=_square(own, "epe"),
        trainings=json.loads((folder / "trainings.json").read_text()),
    )


def benchmark_scores(
    pool: Pool, *, store: EvaluationStore | None = None, pairs: int | None = None, of: str = BANK.name
) -> pd.DataFrame:
    """bad-3.0 in percent of every network of a bank, a column a benchmark, the validation benchmark first."""
    chosen = [benchmark(name, of=of).first(pairs or bank_plan(of).pairs) for name in benchmarks()]
    return _square(score_recipes(pool, network_recipes(pool), chosen, store=store), METRIC)


def network_recipes(pool: Pool) -> dict[str, Recipe]:
    """The base (under its domain's name), every source alone, and all that have a domain merged equally."""
    alone = {name: pool.equal(name) for name in pool.names}
    merged = pool.equal(*(name for name in pool.names if name in domains()))
    return {BASE.name: pool.base_recipe(), **alone, UNIFORM: merged}


def _square(scores: pd.DataFrame, metric: str) -> pd.DataFrame:
    """A row a network, a column a benchmark, in the order first met."""
    rows, columns = dict.fromkeys(scores["network"]), dict.fromkeys(scores["benchmark"])
    table = scores[scores["metric"] == metric].pivot(index="network", columns="benchmark", values="score")
    return table.loc[list(rows), list(columns)]
