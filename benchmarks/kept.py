"""Runs that take hours together: each is kept as a CSV file as soon as it is finished."""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
import torch

from sfkit.files import write_text

RUNS = Path(os.environ.get("SFKIT_EVIDENCE", Path(__file__).parents[1] / "runs" / "evidence"))
"""Where they lie, unless the environment says where."""

Job = Callable[[Path], pd.DataFrame]
"""Computes one run; the folder holds the store by which an interrupted one goes on."""


@dataclass(frozen=True)
class KeptRuns:
    """Named runs, in the order they are made.

    Attributes:
        about: what ``--help`` says.
        jobs: every run by name.
        folder: the results of finished runs, and their store.
    """

    about: str | None
    jobs: Callable[[], Mapping[str, Job]]
    folder: Path

    def done(self, name: str) -> Path:
        """The file of a finished run."""
        return self.folder / f"{name}.csv"

    def results(self, prefix: str) -> pd.DataFrame:
        """All finished runs whose name begins so, as one table; empty where there is none."""
        frames = [pd.read_csv(path) for path in sorted(self.folder.glob(f"{prefix}*.csv"))]
        return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()

    def main(self, arguments: Sequence[str] | None = None) -> None:
        """Make what is missing."""
        parser = argparse.ArgumentParser(
            description=self.about, formatter_class=argparse.RawTextHelpFormatter
        )
        parser.add_argument("prefix", nargs="?", default="", help="only runs whose name begins so")
        parser.add_argument("--minutes", type=float, default=float("inf"), help="begin nothing after so long")
        parser.add_argument("--most", type=int, default=None, help="begin at most so many")
        parser.add_argument("--list", action="store_true", help="print the names and what is done")
        options = parser.parse_args(arguments)
        jobs = {name: job for name, job in self.jobs().items() if name.startswith(options.prefix)}
        missing = [name for name in jobs if not self.done(name).is_file()]
        if options.list:
            print("\n".join(f"{'missing' if name in missing else 'done   '} {name}" for name in jobs))
            return
        torch.set_num_threads(1)
        self.folder.mkdir(parents=True, exist_ok=True)
        end = time.monotonic() + 60 * options.minutes
        for name in missing[: options.most]:
            if time.monotonic() > end:
                break
            began = time.process_time()
            whole = jobs[name](self.folder).to_csv(index=False)
            write_text(self.done(name), whole)
            print(f"{name}: {time.process_time() - began:.0f} CPU seconds", flush=True)
