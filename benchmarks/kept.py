"""Runs that take hours together: each is kept as a CSV file as soon as it is finished.

``--record`` writes those of the folder into ``benchmarks/recorded``, from where another machine goes on.
"""

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

RECORDED = Path(__file__).parent / "recorded"
"""Finished runs that are part of the repository: ``SET-KIND.csv``, a run's name before its rows."""

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
        """The file of a run that finished here."""
        return self.folder / f"{name}.csv"

    def finished(self) -> set[str]:
        """The names of all finished runs, here and recorded."""
        return set(self._frames())

    def results(self, prefix: str) -> pd.DataFrame:
        """All finished runs whose name begins so, as one table; empty where there is none."""
        frames = [frame for name, frame in self._frames().items() if name.startswith(prefix)]
        return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()

    def record(self) -> None:
        """Add the runs that finished here to the repository's, a file for each kind of run."""
        kinds: dict[str, dict[str, pd.DataFrame]] = {}
        for name, frame in self._frames().items():
            kinds.setdefault(name.partition("-")[0], {})[name] = frame
        for kind, frames in kinds.items():
            rows = pd.concat(frames, names=["run"]).reset_index("run")
            # Six digits are more than any table shows.
            text = rows.to_csv(index=False, float_format="%.6g", lineterminator="\n")
            write_text(RECORDED / f"{self.folder.name}-{kind}.csv", text)

    def _frames(self) -> dict[str, pd.DataFrame]:
        """Name -> rows of every finished run, by name; one that was made again here counts once."""
        found: dict[str, pd.DataFrame] = {}
        for path in RECORDED.glob(f"{self.folder.name}-*.csv"):
            found |= {str(name): rows.drop(columns="run") for name, rows in pd.read_csv(path).groupby("run")}
        found |= {path.stem: pd.read_csv(path) for path in self.folder.glob("*.csv")}
        return dict(sorted(found.items()))

    def main(self, arguments: Sequence[str] | None = None) -> None:
        """Make what is missing."""
        parser = argparse.ArgumentParser(
            description=self.about, formatter_class=argparse.RawTextHelpFormatter
        )
        parser.add_argument("prefix", nargs="?", default="", help="only runs whose name begins so")
        parser.add_argument("--minutes", type=float, default=float("inf"), help="begin nothing after so long")
        parser.add_argument("--most", type=int, default=None, help="begin at most so many")
        parser.add_argument(
            "--record", action="store_true", help="write what finished here into benchmarks/recorded"
        )
        parser.add_argument("--list", action="store_true", help="print the names and what is done")
        options = parser.parse_args(arguments)
        jobs = {name: job for name, job in self.jobs().items() if name.startswith(options.prefix)}
        if options.record:
            self.record()
            return
        finished = self.finished()
        missing = [name for name in jobs if name not in finished]
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
