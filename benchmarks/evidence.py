"""Evidence for Stage 2's guards: plain and guarded searches, judged on pairs they never saw.

    python benchmarks/evidence.py --minutes 60        # go on with what is missing, at most so long
    python benchmarks/evidence.py --list              # what there is to do, and what is done
    python benchmarks/evidence.py --sharp guards-05   # on the sharp bank, at smaller budgets
    python benchmarks/results.py evidence evidence-sharp    # write what is there into docs/results.md

Every evaluation goes through a store, so that a run can be interrupted at any moment; finished comparisons
are kept as CSV files beside it. The embedded banks' pairs are rendered; the real pool needs SFKIT_REAL_DATA.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from functools import partial

import evidence_bank
import evidence_real
import pandas as pd
from evidence_bank import FIRST, SHARP, EvidenceStudy
from kept import RUNS, Job, KeptRuns
from real_pairs import PAIRS
from tabulated import markdown_lines
from trials import with_changes

from sfkit.bank import VALIDATION
from sfkit.evaluation.separation import marked


def jobs(study: EvidenceStudy = FIRST) -> dict[str, Job]:
    """Every comparison by name, in the order they are run: the first seed of each first."""
    found = evidence_bank.jobs(study)
    if study is FIRST:
        found |= evidence_real.jobs()
    return dict(sorted(found.items(), key=lambda job: _turn(job[0])))


def _turn(name: str) -> int:
    """The seed; the dearest comparisons come a round later."""
    return int(name.rpartition("-")[2]) + name.startswith(("guards-20", "guards-40"))


def kept_of(study: EvidenceStudy = FIRST) -> KeptRuns:
    """The comparisons of a study, those of the sharp bank in a folder of their own."""
    return KeptRuns(__doc__, partial(jobs, study), RUNS if study is FIRST else RUNS / "sharp")


kept = kept_of()


def section() -> str:
    """Tables of whatever ``benchmarks/evidence.py`` has finished.

    Raises:
        SystemExit: that is nothing.
    """
    return written(FIRST, kept, HEAD)


def written(study: EvidenceStudy, kept: KeptRuns, head: str) -> str:
    """The tables of a study below what its section begins with.

    Raises:
        SystemExit: nothing of it is finished.
    """
    if not kept.finished() & kept.jobs().keys():
        raise SystemExit("nothing is finished yet: run python benchmarks/evidence.py first (hours)")
    guards = kept.results("guards-")
    parts = [head + _budgets(study), _guards(guards, study), _course(guards)]
    parts += [
        _routing(kept.results(f"{prefix}-"), text.format(pairs=study.routing_pairs), study)
        for prefix, text in (("routing", ROUTING), ("partitions", PARTITIONS))
    ]
    return "\n\n".join(part for part in [*parts, _real(kept.results("real-"))] if part)


HEAD = """## Does Stage 2 help on pairs it never saw?

`python benchmarks/evidence.py` runs the comparisons (hours on an idle machine) and goes on where it was.
On the first bank both stages are guided by pairs of `courtyard`, drawn anew for each seed: Stage 1 with
"""
LISTED = ", ".join(f"`{name}`" for name in evidence_bank.WORLDS)


def _budgets(study: EvidenceStudy) -> str:
    stage1 = f"M = {evidence_bank.POPULATION} and T = {evidence_bank.GENERATIONS}"
    return f"""{stage1}, Stage 2 with {study.evaluations}
evaluations. Changes are against Stage 1's equal weights, x = 0, in points of bad-3.0;
**below 0 is better**. "New pairs" are {study.unseen} other pairs of `courtyard`, "other worlds"
the mean over {study.unseen} pairs each of {LISTED}; no search saw either. In brackets: how many
runs are better than Stage 1 there, of all runs. Distance is the mean square of x."""


ROUTING = """### Tied, low-rank and block-specific routing

One budget, {pairs} validation pairs; entropy is the weight of the penalty (eq. 13)
in points a nat."""
PARTITIONS = """### The architecture's blocks, and blocks from the network itself

One budget, {pairs} validation pairs, four blocks each: AnyNet's own, the module tree
cut into parts of equal size, and layers clustered by how the task vectors disagree."""
GUARDS = """### Plain and guarded, by the number of validation pairs

The row "x / 2" is the plain search's vector, halved."""
COURSE = """### The plain search on its way

What it would have returned after so many evaluations."""


def _guards(frame: pd.DataFrame, study: EvidenceStudy) -> str:
    if frame.empty:
        return ""
    rows = [
        (pairs, trial, *_columns(part))
        for pairs, group in _ends(frame, study).groupby("pairs")
        for trial, part in group.groupby("trial", sort=False)
    ]
    return f"{GUARDS}\n\n{markdown_lines(('pairs', 'Stage 2', *COLUMNS), rows)}"


def _course(frame: pd.DataFrame) -> str:
    if frame.empty:
        return ""
    frame = _changed(frame[frame["trial"] == "plain"])
    rows = [
        (pairs, spent, *_columns(part)) for (pairs, spent), part in frame.groupby(["pairs", "evaluations"])
    ]
    return f"{COURSE}\n\n{markdown_lines(('pairs', 'evaluations', *COLUMNS), rows)}"


def _routing(frame: pd.DataFrame, text: str, study: EvidenceStudy) -> str:
    if frame.empty:
        return ""
    rows = [(trial, *_columns(part)) for trial, part in _ends(frame, study).groupby("trial", sort=False)]
    return f"{text}\n\n{markdown_lines(('Stage 2', *COLUMNS), rows)}"


def _real(frame: pd.DataFrame) -> str:
    if frame.empty:
        return ""
    frame = frame[frame["evaluations"] == evidence_real.EVALUATIONS]
    pairs, rows = list(PAIRS), []
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


def _ends(frame: pd.DataFrame, study: EvidenceStudy) -> pd.DataFrame:
    return _changed(frame[frame["evaluations"] == study.evaluations])


def _changed(frame: pd.DataFrame) -> pd.DataFrame:
    return with_changes(frame, evidence_bank.WORLDS).assign(
        new=frame[VALIDATION] - frame[f"{VALIDATION}:equal"]
    )


def _columns(part: pd.DataFrame) -> tuple[str, str, str, str]:
    validation = "" if part["change"].isna().all() else f"{part['change'].mean():+.2f}"
    new, other = (f"{part[n].mean():+.2f} ({(part[n] < 0).sum()} of {len(part)})" for n in ("new", "unseen"))
    return validation, new, other, f"{part['distance'].mean():.2f}"


if __name__ == "__main__":
    asked = argparse.ArgumentParser(add_help=False)
    asked.add_argument("--sharp", action="store_true")
    options, rest = asked.parse_known_args()
    kept_of(SHARP if options.sharp else FIRST).main(rest)
