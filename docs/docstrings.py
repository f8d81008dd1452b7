"""Docstrings for the documentation: what they write as ``:class:`~a.b.C``` becomes a link to C."""

from __future__ import annotations

import re
from typing import Any

import griffe

ROLE = re.compile(r":(?:class|func|meth|mod|attr|data):`(~?)([\w.]+)`")
CODE = re.compile(r"``([^`]+)``")


def _link(found: re.Match[str]) -> str:
    short, target = found.groups()
    text = target.rsplit(".", 1)[-1] if short else target.removeprefix("sfkit.")
    if "." not in target:  # a member of the same class, which has no page of its own
        return f"`{text}`"
    return f'<autoref identifier="{target}" optional><code>{text}</code></autoref>'


class Roles(griffe.Extension):
    """Rewrites every docstring once, when it has been read."""

    def on_object(self, *, obj: griffe.Object, **_: Any) -> None:
        """Roles become links, double backquotes single ones."""
        if obj.docstring is not None:
            text = ROLE.sub(_link, obj.docstring.value)
            obj.docstring.value = re.sub(r"::$", ":", CODE.sub(r"`\1`", text), flags=re.MULTILINE)
