"""Evidence for Stage 2's guards: plain and guarded searches, judged on pairs they never saw.

    python benchmarks/evidence.py --minutes 60        # go on with what is missing, at most so long
    python benchmarks/evidence.py --list              # what there is to do, and what is done
    python benchmarks/results.py evidence             # write what is there into docs/results.md

Every evaluation goes through a store, so that a run can be interrupted at any moment; finished comparisons
are kept as CSV files beside it. The embedded bank's pairs are rendered; the real pool needs SFKIT_REAL_DATA.
"""

from __future__ import annotations

from collections.abc import Sequence

import evidence_bank
import evidence_real
import pandas as pd
from kept import RUNS, Job, KeptRuns
from trials import with_changes

from sfkit.analysis.tables import markdown_lines
from sfkit.bank import VALIDATION
from sfkit.evaluation.separation import marked


def jobs() -> dict[str, Job]:
    """Every comparison by name, in the order they are run: the first seed of each first."""
    found = {**evidence_bank.jobs(), **evidence_real.jobs()}
    return dict(sorted(found.items(), key=lambda job: _turn(job[0])))


def _turn(name: str) -> int:
    """The seed; the dearest comparisons come a round later."""
    return int(name.rpartition("-")[2]) + name.startswith(("guards-20", "guards-40"))


kept = KeptRuns(__doc__, jobs, RUNS)


def section() -> str:
    """Tables of whatever ``benchmarks/evidence.py`` has finished.

    Raises:
        SystemExit: that is nothing.
    """
    if not any(kept.done(name).is_file() for name in jobs()):
        raise SystemExit("nothing is finished yet: run python benchmarks/evidence.py first (hours)")
    parts = [
        HEAD,
        _guards(),
        _course(),
        _routing("routing", ROUTING),
        _routing("partitions", PARTITIONS),
        _real(),
    ]
    return "\n\n".join(part for part in parts if part)


LISTED = ", ".join(f"`{name}`" for name in evidence_bank.WORLDS)
HEAD = f"""## Does Stage 2 help on pairs it never saw?

`python benchmarks/evidence.py` runs the comparisons (hours on an idle machine) and goes on where it was.
On the embedded bank both stages are guided by pairs of `courtyard`, drawn anew for each seed: Stage 1 with
M = {evidence_bank.POPULATION} and T = {evidence_bank.GENERATIONS}, Stage 2 with {evidence_bank.EVALUATIONS}
evaluations. Changes are against Stage 1's equal weights, x = 0, in points of bad-3.0;
**below 0 is better**. "New pairs" are {evidence_bank.UNSEEN_PAIRS} other pairs of `courtyard`, "other worlds"
the mean over {evidence_bank.UNSEEN_PAIRS} pairs each of {LISTED}; no search saw either. In brackets: how many
runs are better than Stage 1 there, of all runs. Distance is the mean square of x."""
ROUTING = f"""### Tied, low-rank and block-specific routing

One budget, {evidence_bank.ROUTING_PAIRS} validation pairs; entropy is the weight of the penalty (eq. 13)
in points a nat."""
PARTITIONS = f"""### The architecture's blocks, and blocks from the network itself

One budget, {evidence_bank.ROUTING_PAIRS} validation pairs, four blocks each: AnyNet's own, the module tree
cut into parts of equal size, and layers clustered by how the task vectors disagree."""
GUARDS = """### Plain and guarded, by the number of validation pairs

The row "x / 2" is the plain search's vector, halved."""
COURSE = """### The plain search on its way

What it would have returned after so many evaluations."""


def _guards() -> str:
    frame = _ends(kept.results("guards-"))
    if frame.empty:
        return ""
    rows = [
        (pairs, trial, *_columns(part))
        for pairs, group in frame.groupby("pairs")
        for trial, part in group.groupby("trial", sort=False)
    ]
    return f"{GUARDS}\n\n{markdown_lines(('pairs', 'Stage 2', *COLUMNS), rows)}"


def _course() -> str:
    frame = kept.results("guards-")
    if frame.empty:
        return ""
    frame = _changed(frame[frame["trial"] == "plain"])
    rows = [
        (pairs, spent, *_columns(part)) for (pairs, spent), part in frame.groupby(["pairs", "evaluations"])
    ]
    return f"{COURSE}\n\n{markdown_lines(('pairs', 'evaluations', *COLUMNS), rows)}"


def _routing(prefix: str, text: str) -> str:
    frame = _ends(kept.results(f"{prefix}-"))
    if frame.empty:
        return ""
    rows = [(trial, *_columns(part)) for trial, part in frame.groupby("trial", sort=False)]
    return f"{text}\n\n{markdown_lines(('Stage 2', *COLUMNS), rows)}"


def _real() -> str:
    frame = kept.results("real-")
    if frame.empty:
        return ""
    frame = frame[frame["evaluations"] == evidence_real.EVALUATIONS]
    pairs, rows = list(evidence_real.PAIRS), []
    for how, seen in evidence_real.GUIDES.items():
        group = frame[frame["how"] == how]
        for trial, part in group.groupby("trial", sort=False):
            changes = {name: (part[name] - part[f"{name}:equal"]).mean() for name in pairs}
            cells = [marked(f"{change:+.2f}", guided=name in seen) for name, change in changes.items()]
            unseen = [change for name, change in changes.items() if name not in seen]
            rows.append((how, trial, *cells, f"{sum(unseen) / len(unseen):+.2f}", len(part)))
    names: Sequence[str] = ("guided by", "Stage 2", *pairs, "unseen, mean", "runs")
    return f"{REAL}\n\n{markdown_lines(names, rows)}"


REAL = f"""### The real AnyNet pool

Points of bad-1.0 against Stage 1's equal weights, one pair a benchmark, {evidence_real.EVALUATIONS}
evaluations, mean over runs; `*` marks the pairs that guided the search. "one" is ETH3D's pair, "mean" and
"worst" combine ETH3D, Cones and Motorcycle, "folds" is the mean of these and Reindeer, where four folds leave
out one data set each. KITTI 2012's pair belongs to the training images of these fine-tunes."""

COLUMNS = ("validation", "new pairs", "other worlds", "distance")


def _ends(frame: pd.DataFrame) -> pd.DataFrame:
    return frame if frame.empty else _changed(frame[frame["evaluations"] == evidence_bank.EVALUATIONS])


def _changed(frame: pd.DataFrame) -> pd.DataFrame:
    return with_changes(frame, evidence_bank.WORLDS).assign(
        new=frame[VALIDATION] - frame[f"{VALIDATION}:equal"]
    )


def _columns(part: pd.DataFrame) -> tuple[str, str, str, str]:
    validation = "" if part["change"].isna().all() else f"{part['change'].mean():+.2f}"
    new, other = (f"{part[n].mean():+.2f} ({(part[n] < 0).sum()} of {len(part)})" for n in ("new", "unseen"))
    return validation, new, other, f"{part['distance'].mean():.2f}"


if __name__ == "__main__":
    kept.main()
