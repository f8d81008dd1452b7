"""While a network is exported it computes by what exporters understand; elsewhere it stays as it is.

Fast routes call one library's kernels, write in place or run a loop of their own. Where a network asks
:func:`is_portable` it has a second way to the same values, of plain operations that every exporter knows.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar

_PORTABLE: ContextVar[bool] = ContextVar("sfkit_portable", default=False)


@contextmanager
def portable() -> Iterator[None]:
    """Let networks called in this block compute by plain operations; results agree within rounding."""
    token = _PORTABLE.set(True)
    try:
        yield
    finally:
        _PORTABLE.reset(token)


def is_portable() -> bool:
    """Whether a network should compute by plain operations now."""
    return _PORTABLE.get()
