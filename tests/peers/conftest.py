"""Cross-checks against other programs, which `make peers` installs in an environment of its own.

Elsewhere these tests are not collected, instead of skipped: they belong to another run, and lack nothing.
A checkout of OpenStereo is the user's: where ``SFKIT_OPENSTEREO`` names one, its networks are run too.
"""

from __future__ import annotations

import os
from importlib.util import find_spec

if find_spec("mergekit") is None:
    collect_ignore_glob = ["test_*.py"]
elif not os.environ.get("SFKIT_OPENSTEREO"):
    collect_ignore_glob = ["test_*_openstereo.py"]
