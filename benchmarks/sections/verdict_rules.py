"""What each candidate rule of the verdict would have deployed, on pairs no search saw."""

from __future__ import annotations

import pandas as pd
import verdict_rules

from sfkit.analysis.tables import markdown_lines
from sfkit.bank.plan import BANKS

KINDS = ("base", "single source", "equal weights", "routed")


def section() -> str:
    """Tables of whatever ``benchmarks/verdict_rules.py`` has finished.

    Raises:
        SystemExit: that is nothing.
    """
    parts = [_table(TITLES[name], verdict_rules.kept.results(f"{name}-")) for name in TITLES]
    others = {name: verdict_rules.kept_of(name) for name in BANKS if name != verdict_rules.BANK}
    parts += [_table(f"On `{name}`, {UNSEEN}", runs.results(f"{name}-")) for name, runs in others.items()]
    if not any(parts):
        raise SystemExit("nothing is finished yet: run python benchmarks/verdict_rules.py first (hours)")
    return "\n\n".join([HEAD, *(part for part in parts if part)])


STAGE1 = f"M = {verdict_rules.POPULATION}, T = {verdict_rules.GENERATIONS}"
HEAD = f"""## Which rule should a verdict follow?

`python benchmarks/verdict_rules.py` (`--pool bank-sharp` for the sharp bank) goes on where it was, and what
follows are the runs that are finished. In each both stages ({STAGE1},
{verdict_rules.EVALUATIONS} evaluations) are guided by a few pairs, and every rule chooses among the
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
        told = verdict_rules.RULES[str(rule)]
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
