"""Evidence for Stage 2's guards: plain and guarded searches, judged on pairs they never saw.

    python benchmarks/evidence.py --minutes 60        # go on with what is missing, at most so long
    python benchmarks/evidence.py --list              # what there is to do, and what is done
    python benchmarks/results.py evidence             # write what is there into docs/results.md

Every evaluation goes through a store, so that a run can be interrupted at any moment; finished comparisons
are kept as CSV files beside it. The embedded bank's pairs are rendered; the real pool needs SFKIT_REAL_DATA.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Sequence
from pathlib import Path

import evidence_bank
import evidence_real
import pandas as pd
import torch

FOLDER = Path(os.environ.get("SFKIT_EVIDENCE", Path(__file__).parents[1] / "runs" / "evidence"))

Job = Callable[[Path], pd.DataFrame]


def jobs() -> dict[str, Job]:
    """Every comparison by name, in the order they are run: the first seed of each first."""
    found = {**evidence_bank.jobs(), **evidence_real.jobs()}
    return dict(sorted(found.items(), key=lambda job: _turn(job[0])))


def _turn(name: str) -> int:
    """The seed; the dearest comparisons come a round later."""
    return int(name.rpartition("-")[2]) + name.startswith(("guards-20", "guards-40"))


def done(name: str) -> Path:
    """The file of a finished comparison."""
    return FOLDER / f"{name}.csv"


def results(prefix: str) -> pd.DataFrame:
    """All finished comparisons whose name begins so, as one table."""
    frames = [pd.read_csv(path) for path in sorted(FOLDER.glob(f"{prefix}*.csv"))]
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


def main(arguments: Sequence[str] | None = None) -> None:
    """Run what is missing."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin nothing after so long")
    parser.add_argument("--most", type=int, default=None, help="begin at most so many")
    parser.add_argument("--list", action="store_true", help="print the names and what is done")
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    FOLDER.mkdir(parents=True, exist_ok=True)
    missing = [name for name in jobs() if not done(name).is_file()]
    if options.list:
        print("\n".join(f"{'missing' if name in missing else 'done   '} {name}" for name in jobs()))
        return
    end = time.monotonic() + 60 * options.minutes
    for name in missing[: options.most]:
        if time.monotonic() > end:
            break
        began = time.monotonic()
        jobs()[name](FOLDER).to_csv(done(name), index=False)
        print(f"{name}: {time.monotonic() - began:.0f} s", flush=True)


if __name__ == "__main__":
    main()
