"""The smallest widget there is, to test what all widgets share."""

from __future__ import annotations

from pathlib import Path

import traitlets
from sfkit_widgets._assets import script, style
from sfkit_widgets._base import SfkitWidget
from sfkit_widgets._commands import command

from sfkit.errors import InputError


class Probe(SfkitWidget):
    """Adds numbers; refuses negative ones, and breaks at zero."""

    _esm = script("browser_probe.js", Path(__file__).parent)
    _css = style()

    start = traitlets.Int(0).tag(setting=True)
    total = traitlets.Int(0).tag(sync=True)

    def __init__(self, **settings: object) -> None:
        super().__init__(settings)
        self.total = self.start

    @command
    def add(self, number: int) -> None:
        """Add to the total."""
        if number < 0:
            raise InputError(f"number: found {number}, expected at least 0")
        self.total += number + 0 // number
