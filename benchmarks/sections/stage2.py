"""Stage 2 in several ways: the best score against evaluations."""

from __future__ import annotations

import numpy as np
import pandas as pd
import stage2
import stage2_worlds

from sfkit.analysis.tables import markdown_lines

DOCUMENT = "benchmarks/README.md"
MARKS = (10, 20, 40, 60, 80, 100, 150, 300)
KEY = ["world", "seed"]
TITLES = {
    stage2.BANK: f"On the bank, {stage2_worlds.BANK_PAIRS} windows of "
    f"{' x '.join(map(str, stage2_worlds.BANK_WINDOW))} px",
    stage2.REAL: f"On the real AnyNet pool, {stage2_worlds.REAL_PAIRS} windows of "
    f"{' x '.join(map(str, stage2_worlds.REAL_WINDOW))} px of as many data sets",
}
HEAD = """## Stage 2: the best score against evaluations

`python benchmarks/stage2.py` runs the searches and goes on where it was. A search is Stage 1 by its model,
then Stage 2 over the subset it found, on windows of a few validation pairs drawn by the seed. Numbers are
points behind (above 0) or ahead (below 0) of what CMA-ES has after 300 evaluations of the same search:
median and quartiles. Evaluations are those of Stage 2; what has no stages gets those of Stage 1 besides.
`needs` is how many it takes for CMA-ES's score after 300, median over searches, beside how many got there.
`model, no far draws` has further settings of its own: beta 1 and patience 8, for 2 and 4."""
BLOCKWISE = """### Block-specific routing

The same searches with weights for every block of its own. Points against CMA-ES with tied weights after 300
evaluations; entries of x are the median over searches."""


def section() -> str:
    """Tables of whatever ``benchmarks/stage2.py`` has finished.

    Raises:
        SystemExit: that is nothing, or no search by CMA-ES.
    """
    frame = stage2.kept.results("")
    if frame.empty or stage2.CMA_ES not in set(frame["way"]):
        raise SystemExit("nothing is finished yet: run python benchmarks/stage2.py first (hours)")
    behind = curves(frame)
    parts = [HEAD]
    for kind, title in TITLES.items():
        part = behind[behind["world"] == kind]
        tied = part[~part["way"].str.endswith("block-specific")]
        if not tied.empty:
            parts += [f"{title}:", table(tied)]
    blockwise = behind[behind["way"].str.endswith("block-specific")]
    return "\n\n".join([*parts, BLOCKWISE, table(blockwise)] if not blockwise.empty else parts)


def curves(frame: pd.DataFrame) -> pd.DataFrame:
    """A row a search and way: points behind CMA-ES's last after each evaluation, as one array ``behind``.

    Searches that CMA-ES has not finished are left out.
    """
    aim = frame[frame["way"] == stage2.CMA_ES].groupby(KEY)["score"].min()
    rows = []
    for (kind, seed, way), part in frame.groupby([*KEY, "way"], sort=False):
        if (kind, seed) in aim.index:
            best = part.sort_values("evaluation")["score"].cummin().to_numpy()
            if way == stage2.ONE_MODEL:
                best = best[int(part["stage1"].iloc[0]) :]
            rows.append((kind, seed, way, part["dimension"].iloc[0], best - aim[kind, seed]))
    return pd.DataFrame(rows, columns=[*KEY, "way", "dimension", "behind"])


def table(behind: pd.DataFrame) -> str:
    """A row a way: median and quartiles at each mark it reached, and evaluations it needs."""
    rows = []
    for way, part in behind.groupby("way", sort=False):
        every = list(part["behind"])
        cells = [
            spread([one[mark - 1] for one in every]) if all(len(one) >= mark for one in every) else ""
            for mark in MARKS
        ]
        reached = [int(np.argmax(one <= 0.0)) + 1 if (one <= 0.0).any() else np.inf for one in every]
        needs = np.median(reached)
        there = f"{sum(map(np.isfinite, reached))} of {len(every)}"
        rows.append(
            (
                way,
                f"{part['dimension'].median():.0f}",
                *cells,
                f"{needs:.0f}" if np.isfinite(needs) else "more",
                there,
            )
        )
    return markdown_lines(
        ("Stage 2", "entries of x", *(f"after {mark}" for mark in MARKS), "needs", "reached"), rows
    )


def spread(values: list[float]) -> str:
    """Median, and quartiles in brackets, points."""
    low, middle, high = np.quantile(values, (0.25, 0.5, 0.75))
    return f"{middle:+.2f} ({low:+.2f} to {high:+.2f})"
