"""DisparityCompare: frames a second of zoom and pan."""

from __future__ import annotations

import importlib

from processes import shown

DOCUMENT = "benchmarks/README.md"


def section() -> str:
    """One row an image size and arrangement."""
    measured = importlib.import_module("disparity_compare_fps")
    return "\n".join(
        [
            "## DisparityCompare, zoom and pan of large images in the browser",
            "",
            f"`{shown('disparity_compare_fps.py')}`; three networks, headless Chromium without a GPU, "
            "at most 60 frames a second.",
            "",
            measured.table(measured.measure()),
        ]
    )
