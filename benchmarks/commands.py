"""sfkit's own command line, run as a user runs it."""

from __future__ import annotations

import subprocess
import sys


def sfkit(*words: str) -> str:
    """Run ``sfkit WORDS`` and return its standard output; progress goes to standard error as it comes."""
    command = [sys.executable, "-m", "sfkit", *words]
    return subprocess.run(command, stdout=subprocess.PIPE, check=True, text=True).stdout
