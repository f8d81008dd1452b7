"""A stand-alone repository through sfkit: open, merge, evaluate on a real pair, search.

    SFKIT_CHECKOUTS=~/checkouts SFKIT_REAL_DATA=~/real python benchmarks/standalone.py RAFT-Stereo --json

The folder holds checkouts under the names of their repositories: ``RAFT-Stereo``, ``IGEV``, ``unimatch``. It
is the road of ``openstereo.py``: random weights, which tell what a pool takes and that every step runs. What
a checkout itself requires (opt_einsum, timm) must be installed.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from openstereo import REAL, walk

CHECKOUTS = "SFKIT_CHECKOUTS"
SIZE = (128, 192)  # height and width of the part of the real pair, in pixels


@dataclass(frozen=True)
class Case:
    """An architecture, its code below the folder of checkouts, and options that keep it short."""

    kind: str
    root: str
    options: Mapping[str, Any] = field(default_factory=dict)


CASES = {
    "RAFT-Stereo": Case("raft-stereo", "RAFT-Stereo", {"iterations": 4}),
    "IGEV-Stereo": Case("igev-stereo", "IGEV/IGEV-Stereo", {"iterations": 4}),
    "GMStereo": Case("gmstereo", "unimatch"),
}


def main(arguments: Sequence[str] | None = None) -> None:
    """Measure one network and print."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("name", choices=CASES)
    parser.add_argument("--json", action="store_true", help="print one JSON object")
    given = parser.parse_args(arguments)
    missing = [name for name in (CHECKOUTS, REAL) if not os.environ.get(name)]
    if missing:
        raise SystemExit(f"{' and '.join(missing)}: not set, expected the folder's path")
    checkouts, real = (Path(os.environ[name]).expanduser() for name in (CHECKOUTS, REAL))
    case = CASES[given.name]
    options = {"root": str(checkouts / case.root), **case.options}
    with redirect_stdout(sys.stderr):  # what a checkout prints is not the document
        result = {"name": given.name, **walk(case.kind, options, SIZE, real)}
    if given.json:
        json.dump(result, sys.stdout)
    else:
        print("\n".join(f"{key}: {value}" for key, value in result.items()))


if __name__ == "__main__":
    main()
