"""The browser that draws figures as files, looked for before anything is run."""

from __future__ import annotations

import shutil
from pathlib import Path

from sfkit.errors import InputError

KINDS = ("svg", "png")
BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable", "chrome")


def check_pictures(kind: str) -> Path:
    """The Chromium that would draw, before anything is run.

    Raises:
        InputError: another kind than ``svg`` or ``png``, or no Chromium on the path.
    """
    if kind not in KINDS:
        raise InputError(f"figures: found {kind!r}, expected {' or '.join(KINDS)}")
    found = next(filter(None, map(shutil.which, BROWSERS)), None)
    if found is None:
        named = ", ".join(BROWSERS)
        raise InputError(
            f"figures: found no Chromium to draw {kind.upper()} files with, expected one of {named} on the "
            "path: install the distribution's, or leave this out; the HTML file holds every figure"
        )
    return Path(found)
