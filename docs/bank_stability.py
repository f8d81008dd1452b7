"""How alike two halves of a benchmark rank merges: whether its pairs are enough to search on.

Run ``python docs/bank_stability.py --bank bank-sharp`` in a checkout; ``--store`` keeps what is evaluated.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1] / "benchmarks"))

import numpy as np
import pandas as pd
from exhaustive import evaluated

from sfkit.analysis.trust import stability
from sfkit.bank.plan import bank_plan
from sfkit.bank.rendered import benchmark, benchmarks
from sfkit.evaluation import EvaluationStore, Evaluator
from sfkit.merging import Pool, open_pool
from sfkit.merging.live import LiveModel

SUBSETS, SEED = 64, 16
COUNTS = (8, 16, 24, 40)


def drawn_subsets(names: Sequence[str], count: int = SUBSETS) -> list[tuple[str, ...]]:
    """So many different subsets, each of all 2^N - 1 as likely; all of them where there are no more."""
    every = 1 << len(names)
    masks = np.random.default_rng(SEED).permutation(np.arange(1, every))[:count]
    return [tuple(name for i, name in enumerate(names) if mask >> i & 1) for mask in masks]


def rank_stability(
    pool: Pool,
    *,
    of: str,
    store: EvaluationStore | None = None,
    subsets: int = SUBSETS,
    pairs: int | None = None,
    counts: Sequence[int] = COUNTS,
) -> pd.DataFrame:
    """Mean Spearman correlation over 50 random halves of the first n pairs, a row a benchmark, a column an n.

    Over random subsets merged equally, by bad-3.0; ``pairs`` limits the benchmarks, for a quick look.
    """
    chosen, live = drawn_subsets(pool.names, subsets), LiveModel(pool)
    rows = {}
    for name in benchmarks():
        scorer = Evaluator(pool, benchmark(name, of=of).first(pairs or bank_plan(of).pairs), store=store)
        merges = [evaluated(scorer, live, pool.equal(*subset)).images for subset in chosen]
        scores = np.array([[scorer.score([image]) for image in images] for images in merges])
        rows[name] = {n: stability(scores[:, :n]) for n in counts if n <= scores.shape[1]}
    return pd.DataFrame.from_dict(rows, orient="index")


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--bank", default="bank-sharp")
    parser.add_argument("--pool", type=Path, help="another pool.toml, of a bank that is being built")
    parser.add_argument("--store", type=Path, default=Path("runs/bank_stability.sqlite"))
    parser.add_argument("--subsets", type=int, default=SUBSETS)
    parser.add_argument("--pairs", type=int)
    options = parser.parse_args()
    with EvaluationStore(options.store) as kept:
        opened = open_pool(options.pool or options.bank)
        found = rank_stability(
            opened, of=options.bank, store=kept, subsets=options.subsets, pairs=options.pairs
        )
    print(found.round(2).to_string())
