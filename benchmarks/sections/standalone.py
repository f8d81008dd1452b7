"""Networks of fetched stand-alone repositories, from opening to a tiny search."""

from __future__ import annotations

import importlib

from processes import call, shown
from sections.openstereo import rows


def section() -> str:
    """One row a network, each measured in a process of its own."""
    cases = importlib.import_module("standalone").CASES
    lines = [
        "## Networks of stand-alone repositories",
        "",
        f"`{shown('standalone.py', 'NAME')}` with `SFKIT_CHECKOUTS` naming a folder of checkouts of",
        "princeton-vl/RAFT-Stereo (March 2023), gangweiX/IGEV (December 2024) and autonomousvision/unimatch",
        "(January 2025), whose code runs as it stands, and timm 1.0; RAFT-Stereo and IGEV-Stereo run 4",
        "updates. Weights, pair, seconds and search are as in the OpenStereo section: they tell that all",
        "steps run and what they take, not how well such networks merge.",
        "",
        rows(call("standalone.py", name, "--json") for name in cases),
    ]
    return "\n".join(lines)
