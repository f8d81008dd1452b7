"""Evidence for Stage 2's guards: plain and guarded searches, judged on pairs they never saw.

    python benchmarks/evidence.py --minutes 60        # go on with what is missing, at most so long
    python benchmarks/evidence.py --list              # what there is to do, and what is done
    python benchmarks/results.py evidence             # write what is there into docs/results.md

Every evaluation goes through a store, so that a run can be interrupted at any moment; finished comparisons
are kept as CSV files beside it. The embedded bank's pairs are rendered; the real pool needs SFKIT_REAL_DATA.
"""

from __future__ import annotations

import evidence_bank
import evidence_real
from kept import RUNS, Job, KeptRuns


def jobs() -> dict[str, Job]:
    """Every comparison by name, in the order they are run: the first seed of each first."""
    found = {**evidence_bank.jobs(), **evidence_real.jobs()}
    return dict(sorted(found.items(), key=lambda job: _turn(job[0])))


def _turn(name: str) -> int:
    """The seed; the dearest comparisons come a round later."""
    return int(name.rpartition("-")[2]) + name.startswith(("guards-20", "guards-40"))


kept = KeptRuns(__doc__, jobs, RUNS)

if __name__ == "__main__":
    kept.main()
