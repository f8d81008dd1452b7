"""Where is one network better than another? The signed map of two error maps."""

from __future__ import annotations

ADVANTAGE_SPAN = 4.0
"""A map of differences runs from -4 to 4 times the threshold."""
