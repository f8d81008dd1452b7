"""The one way text gets onto a page."""

from __future__ import annotations

import html


def escaped(text: object) -> str:
    """Text as HTML, in a page's body or between quotes of an attribute."""
    return html.escape(str(text), quote=True)
