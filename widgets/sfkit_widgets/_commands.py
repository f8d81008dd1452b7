"""Commands: what a widget's front end may ask of its Python side, and how it is answered."""

from __future__ import annotations

import functools
import inspect
import traceback
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, TypeVar, cast

from sfkit.errors import InputError, SfkitError, ensure_known

Method = TypeVar("Method", bound=Callable[..., Any])

_MARK = "_sfkit_command"


def command(method: Method) -> Method:
    """Let the front end call a method of a widget by its name, with keyword arguments of plain JSON values.

    Nothing else can be called from the browser. The method may raise: the sentence of an
    :class:`~sfkit.errors.SfkitError`, or kind and place of any other exception, appears in the widget. Cells
    may call it, too: it takes the widget's lock, and there it raises.
    """

    @functools.wraps(method)
    def alone(widget: Any, *arguments: Any, **named: Any) -> Any:
        with widget.changing():
            return method(widget, *arguments, **named)

    setattr(alone, _MARK, True)
    return cast(Method, alone)


def commands_of(owner: type) -> tuple[str, ...]:
    """Names of the methods marked with :func:`command`."""
    members = {name: value for kind in reversed(owner.__mro__) for name, value in vars(kind).items()}
    return tuple(name for name, value in members.items() if getattr(value, _MARK, False))


def call(owner: object, content: Mapping[str, Any]) -> None:
    """Do what a message asks: ``{"command": name, "arguments": {...}}``.

    Raises:
        InputError: no such command, or arguments that do not fit it.
    """
    name = content.get("command")
    known = commands_of(type(owner))
    ensure_known("command", name, known)
    method, arguments = getattr(owner, str(name)), content.get("arguments") or {}
    signature = inspect.signature(method)
    try:
        signature.bind(**arguments)
    except TypeError as error:
        expected = ", ".join(signature.parameters) or "no argument"
        raise InputError(f"command {name!r}: {error}, expected {expected}") from error
    method(**arguments)


def sentence(error: BaseException) -> str:
    """What the widget shows of an exception: a sentence of ours as it is, else kind, message and place."""
    if isinstance(error, SfkitError):
        return str(error)
    frames = traceback.extract_tb(error.__traceback__)
    place = f" ({Path(frames[-1].filename).name}, line {frames[-1].lineno})" if frames else ""
    return f"{type(error).__name__}: {error}{place}"
