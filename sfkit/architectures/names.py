"""The names of what comes with sfkit, known without torch; a test holds them to what registers itself."""

from __future__ import annotations

from collections.abc import Iterable

from sfkit.architectures import code
from sfkit.errors import InputError, unknown_name

SHIPPED = (
    "aanet",
    "anynet",
    "anynet-slim",
    "anynet-wide",
    "foundation-stereo",
    "gmstereo",
    "igev-stereo",
    "nmrf-res",
    "nmrf-swint",
    "openstereo",
    "raft-stereo",
    "stereo-matching",
)


def ensure_architecture(name: str) -> None:
    """Refuse an architecture that comes neither with sfkit nor with an installed package.

    Raises:
        InputError: as :func:`sfkit.architectures.registry.architecture`.
    """
    known = {*SHIPPED, *code.declared_names()}
    if name not in known:
        raise unknown_architecture(name, known)


def unknown_architecture(name: str, known: Iterable[str]) -> InputError:
    """The error for a name that nothing is registered under."""
    error = unknown_name("architecture", name, known)
    return InputError(f"{error}; is it your own? name its code: --import FILE, or module = in pool.toml")
