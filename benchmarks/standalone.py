"""A stand-alone repository through sfkit: open, merge, evaluate on a real pair, search.

    SFKIT_CHECKOUTS=~/checkouts SFKIT_REAL_DATA=~/real python benchmarks/standalone.py RAFT-Stereo --json

The folder holds checkouts under the names of their repositories: ``RAFT-Stereo``, ``IGEV``, ``unimatch``. It
is the road of ``openstereo.py``: random weights, which tell what a pool takes and that every step runs. What
a checkout itself requires (opt_einsum, timm) must be installed.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

from openstereo import table, walk
from processes import answered, call, folder_of, shown

CHECKOUTS = "SFKIT_CHECKOUTS"
SIZE = (128, 192)  # height and width of the part of the real pair, in pixels


@dataclass(frozen=True)
class CheckoutCase:
    """An architecture, its code below the folder of checkouts, and options that keep it short."""

    kind: str
    root: str
    options: Mapping[str, Any] = field(default_factory=dict)


CASES = {
    "RAFT-Stereo": CheckoutCase("raft-stereo", "RAFT-Stereo", {"iterations": 4}),
    "IGEV-Stereo": CheckoutCase("igev-stereo", "IGEV/IGEV-Stereo", {"iterations": 4}),
    "GMStereo": CheckoutCase("gmstereo", "unimatch"),
}


def measure(name: Literal["RAFT-Stereo", "IGEV-Stereo", "GMStereo"]) -> dict[str, Any]:
    """Walk one network's road."""
    case = CASES[name]
    options = {"root": str(folder_of(CHECKOUTS) / case.root), **case.options}
    return {"name": name, **walk(case.kind, options, SIZE)}


def section() -> str:
    """One row a network, each measured in a process of its own."""
    return f"""## Networks of stand-alone repositories

`{shown("standalone.py", "NAME")}` with `SFKIT_CHECKOUTS` naming a folder of checkouts of
princeton-vl/RAFT-Stereo (March 2023), gangweiX/IGEV (December 2024) and autonomousvision/unimatch
(January 2025), whose code runs as it stands, and timm 1.0; RAFT-Stereo and IGEV-Stereo run 4
updates. Weights, pair, seconds and search are as in the OpenStereo section: they tell that all
steps run and what they take, not how well such networks merge.

{table(call("standalone.py", name, "--json") for name in CASES)}"""


if __name__ == "__main__":
    answered(measure)
