"""The parameters of a notebook: which names it takes, and whether what is given fits."""

from __future__ import annotations

import ast
import json
import os
import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sfkit.errors import InputError, ensure_known
from sfkit.files import trouble

if TYPE_CHECKING:
    from nbformat import NotebookNode

TAG = "parameters"


def notebook_parameters(notebook: str | os.PathLike[str]) -> dict[str, Any]:
    """The parameters a notebook takes, with their defaults.

    Read from the syntax tree of the cell tagged ``parameters``, which, unlike papermill's own inspection,
    understands every assignment; a default that is no literal is given as None.

    Raises:
        InputError: the file is no notebook, or its parameters cell is no Python.
    """
    path = Path(notebook)
    return parameter_defaults(path, read_notebook(path))


def read_parameters(notebook: str | os.PathLike[str], texts: Mapping[str, str]) -> dict[str, Any]:
    """Parameter values from text, as a command line gives them.

    A parameter whose default is a string takes the text as it stands; every other is read as JSON (``750``,
    ``0.3``, ``true``, ``null``, ``["a", "b"]``), and text that is no JSON stays text.

    Raises:
        InputError: as :func:`notebook_parameters`, or a name or a kind of value the notebook does not take.
    """
    path = Path(notebook)
    source = _source_at_once(path)
    defaults = parameter_defaults(path, read_notebook(path)) if source is None else _defaults(path, source)
    values = {n: t if isinstance(defaults.get(n), str) else _from_text(t) for n, t in texts.items()}
    return check_parameters(path, defaults, values)


def report_command(
    notebook: str | os.PathLike[str], values: Mapping[str, Any], page: str = "report.html"
) -> str:
    """The command line that runs a notebook with ``values``; those that are its defaults are left out.

    ``values`` may hold more than parameters, such as a notebook's ``globals()``.

    Raises:
        InputError: as :func:`notebook_parameters`.
    """
    words = ["sfkit", "report", Path(notebook).stem]
    for name, usual in notebook_parameters(notebook).items():
        value = values.get(name, usual)
        if value != usual:
            words += ["-p", name, value if isinstance(value, str) else json.dumps(_plain(name, value))]
    return shlex.join([*words, "-o", page])


def _from_text(text: str) -> Any:
    try:
        # Python's words for JSON's.
        return json.loads({"True": "true", "False": "false", "None": "null"}.get(text, text))
    except (ValueError, RecursionError):
        return text


def read_notebook(path: Path) -> NotebookNode:
    """A Python notebook in the current format.

    Raises:
        InputError: the file cannot be read, is no notebook, or one in another language.
    """
    import nbformat  # with all of jsonschema behind it: a notebook's own kernel does without

    if path.suffix != ".ipynb":
        raise InputError(f"{path}: found the ending {path.suffix!r}, expected a notebook that ends in .ipynb")
    if why := trouble(path):
        raise InputError(f"{path}: the notebook cannot be read ({why}), expected one")
    try:
        content: NotebookNode = nbformat.read(path, as_version=4)
        nbformat.validate(content)
    except OSError as error:
        raise InputError(f"{path}: the notebook cannot be read ({error.strerror})") from error
    except (ValueError, TypeError, KeyError, AttributeError, nbformat.ValidationError) as error:
        reason = str(error).partition("\n")[0]
        raise InputError(f"{path}: not a Jupyter notebook ({reason}), expected notebook JSON") from error
    language = content.metadata.get("kernelspec", {}).get("language", "python")
    if language != "python":
        raise InputError(f"{path}: found a notebook in {language}, expected Python")
    return content


def parameter_defaults(path: Path, content: NotebookNode) -> dict[str, Any]:
    """Name -> default of every assignment in the parameters cell; empty where there is no such cell."""
    cell = next((cell for cell in content.cells if TAG in cell.metadata.get("tags", [])), None)
    return {} if cell is None else _defaults(path, cell.source)


def _source_at_once(path: Path) -> str | None:
    """The parameters cell of a plain notebook, so that a wrong name is told before nbformat is imported.

    None where anything is unusual: then :func:`read_notebook` says what.
    """
    if trouble(path):
        return None
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        cell = next(cell for cell in content["cells"] if TAG in cell["metadata"].get("tags", []))
        source = cell["source"]
        text = source if isinstance(source, str) else "".join(source)
        return text if content["nbformat"] == 4 and path.suffix == ".ipynb" else None
    # Whatever is unusual is left to who can say what is wrong with it.
    except (OSError, ValueError, LookupError, TypeError, AttributeError, RecursionError, StopIteration):
        return None


def _defaults(path: Path, source: str) -> dict[str, Any]:
    try:
        statements = ast.parse(source).body
    except SyntaxError as error:
        raise InputError(f"{path}: the cell tagged {TAG!r} is no Python ({error.msg})") from error
    found: dict[str, Any] = {}
    for statement in statements:
        if isinstance(statement, ast.Assign):
            targets = statement.targets
        elif isinstance(statement, ast.AnnAssign):
            targets = [statement.target]
        else:
            continue
        found |= {t.id: _literal(statement.value) for t in targets if isinstance(t, ast.Name)}
    return found


def _literal(node: ast.expr | None) -> Any:
    try:
        return ast.literal_eval(node) if node is not None else None
    except ValueError:
        return None


def check_parameters(path: Path, defaults: Mapping[str, Any], values: Mapping[str, Any]) -> dict[str, Any]:
    """The values as papermill can write them into a cell, after their names and kinds were checked.

    Raises:
        InputError: a name the notebook does not take, a value of another kind than its default (None fits
            every kind), or a value that is no plain one.
    """
    plain: dict[str, Any] = {}
    for name, given in values.items():
        ensure_known(f"parameter of {path.name}", name, defaults)
        value, usual = _plain(name, given), defaults[name]
        if usual is not None and value is not None and _kind(value) != _kind(usual):
            raise InputError(
                f"{path}: parameter {name!r} is the {_kind(value)} {value!r}, "
                f"expected a {_kind(usual)} such as its default {usual!r}"
            )
        plain[name] = value
    return plain


def _plain(name: str, value: Any) -> Any:
    if isinstance(value, os.PathLike):
        return os.fspath(value)
    if isinstance(value, Mapping):
        return {str(key): _plain(name, entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(name, entry) for entry in value]
    if value is None or isinstance(value, str | bool | int | float):
        return value
    raise InputError(
        f"parameter {name!r}: found a {type(value).__name__}, expected a string, number, boolean, None, "
        "path, or a list or dict of those"
    )


def _kind(value: Any) -> str:
    kinds = {bool: "boolean", int: "number", float: "number", str: "string", dict: "dict"}
    return kinds.get(type(value), "list")
