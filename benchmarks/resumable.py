"""Long measurements as named jobs: each finished one is a CSV file, and what is missing goes on."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pandas as pd
import torch

Job = Callable[[Path], pd.DataFrame]
"""Folder where it may keep an evaluation store -> its table."""


def done(folder: Path, name: str) -> Path:
    """The file of a finished job."""
    return folder / f"{name}.csv"


def results(folder: Path, prefix: str = "") -> pd.DataFrame:
    """All finished jobs whose name begins so, as one table; empty where none is."""
    frames = [pd.read_csv(path) for path in sorted(folder.glob(f"{prefix}*.csv"))]
    return pd.concat(frames, ignore_index=True) if frames else pd.DataFrame()


def go_on(text: str | None, jobs: Mapping[str, Job], folder: Path, arguments: Sequence[str] | None) -> None:
    """A command line that runs what is missing, in order, on one thread.

    Args:
        text: what ``--help`` says.
        jobs: by name.
        folder: of the CSV files.
        arguments: of the command line; None for the process's own.
    """
    parser = argparse.ArgumentParser(description=text, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("--minutes", type=float, default=float("inf"), help="begin nothing after so long")
    parser.add_argument("--only", default="", help="jobs whose name begins so")
    parser.add_argument("--list", action="store_true", help="print the names and what is done")
    options = parser.parse_args(arguments)
    torch.set_num_threads(1)
    folder.mkdir(parents=True, exist_ok=True)
    chosen = [name for name in jobs if name.startswith(options.only)]
    end = time.monotonic() + 60 * options.minutes
    for name in chosen:
        path = done(folder, name)
        if options.list:
            print(f"{'done   ' if path.is_file() else 'missing'} {name}")
        elif not path.is_file() and time.monotonic() < end:
            began = time.process_time()
            table = jobs[name](folder)
            fresh = path.with_suffix(".part")
            table.to_csv(fresh, index=False)
            fresh.replace(path)
            print(f"{name}: {time.process_time() - began:.0f} s of processor time", flush=True)
