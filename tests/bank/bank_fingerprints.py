"""Fingerprints that ship with a bank, compared with those of pairs that were rendered here."""

from __future__ import annotations

import json
from pathlib import Path

from sfkit.bank.fingerprints import Fingerprint

TOLERANCE = {"left": 1, "right": 1, "disparity": 1, "shares": 2}
"""Largest difference a machine's rounding may make: grey levels, tenths of a pixel, thousandths."""


def agree(found: Fingerprint, expected: Fingerprint) -> bool:
    """Whether two fingerprints are of the same pair, rendered on machines that round differently."""
    return all(
        len(found[key]) == len(expected[key])
        and max(abs(a - b) for a, b in zip(found[key], expected[key], strict=True)) <= allowed
        for key, allowed in TOLERANCE.items()
    )


def read_fingerprints(path: Path) -> dict[str, Fingerprint]:
    """Fingerprints by pair id."""
    return {str(key): value for key, value in json.loads(path.read_text()).items()}
