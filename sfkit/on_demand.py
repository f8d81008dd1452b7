"""Packages whose public names are imported when they are asked for (PEP 562).

``import sfkit`` and the command line's ``--help`` need none of torch, pandas and scipy, which take seconds of
a processor. A package says its names once, to type checkers and to this module alike::

    if TYPE_CHECKING:
        from sfkit.merging.recipe import Recipe, routed
    else:
        __getattr__, __dir__ = on_demand(__name__)
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any


def on_demand(package: str) -> tuple[Callable[[str], Any], Callable[[], list[str]]]:
    """A package's ``__getattr__`` and ``__dir__``: its names as the file imports them, and its modules.

    A public name must not be that of a module of the package, which would take its place once imported.

    Args:
        package: the full name of the package that is being imported.
    """
    module = sys.modules[package]
    places = dict(_imports(Path(str(module.__file__))))

    def get(name: str) -> Any:
        if places.get(name, package) != package:
            value = getattr(importlib.import_module(places[name]), name)
        elif not name.startswith("_") and importlib.util.find_spec(f"{package}.{name}") is not None:
            value = importlib.import_module(f"{package}.{name}")
        else:
            raise AttributeError(f"module {package!r} has no attribute {name!r}", name=name, obj=module)
        # From now on an attribute like any other.
        setattr(module, name, value)
        return value

    return get, lambda: sorted({*vars(module), *places})


def _imports(file: Path) -> Iterator[tuple[str, str]]:
    """Each name that a file imports for type checkers, and the module that has it."""
    for block in ast.parse(file.read_text(encoding="utf-8")).body:
        if isinstance(block, ast.If) and isinstance(block.test, ast.Name):
            for node in block.body:
                if isinstance(node, ast.ImportFrom) and node.module is not None:
                    yield from ((alias.name, node.module) for alias in node.names)
