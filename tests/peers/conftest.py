"""Cross-checks against other programs, which `make peers` installs in an environment of its own.

Elsewhere these tests are not collected, instead of skipped: they belong to another run, and lack nothing.
"""

from __future__ import annotations

from importlib.util import find_spec

collect_ignore_glob = ["test_*.py"] if find_spec("mergekit") is None else []
