"""One self-contained text a widget from several small files, without a build step.

anywidget wants a widget's script as one ES module. Here a script may import parts that lie beside it,
or in this folder::

    import { mount, element } from "./_shared.js";

so that editors, the type checker and Node see ordinary modules. :func:`script` puts the parts before
the script, each once, and removes the imports between them and the word ``export`` in the parts. What
it understands is deliberately little, and anything else is refused when the class is defined: one form
of import, whole lines, no renaming; names declared at the top level are unique over all parts.
"""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

from sfkit.errors import InputError

FOLDER = Path(__file__).parent
SHARED_STYLE = "_shared.css"

_IMPORT = re.compile(r'^import \{\s*\w+(?:,\s*\w+)*,?\s*\} from "\./(\w+\.js)";\n', re.M)
_EXPORT = re.compile(r"^export (?=(?:async )?(?:function|class|const|let)\b)", re.M)
_DECLARED = re.compile(r"^(?:export )?(?:async )?(?:function\*?|class|const|let) (\w+)", re.M)
_LEFT_OVER = re.compile(r"^\s*import\b.*$|^export (?!default \{ render \};$).*$", re.M)


@cache
def script(name: str, folder: Path = FOLDER) -> str:
    """The ES module of the file ``name`` and of all parts it imports.

    Raises:
        InputError: a part does not exist, an import or export is of another form, or two parts declare
            one name.
    """
    parts: dict[str, str] = {}
    _collect(name, folder, parts)
    owners: dict[str, str] = {}
    for part, text in parts.items():
        for declared in _DECLARED.findall(text):
            if (owner := owners.setdefault(declared, part)) != part:
                raise InputError(f"{part}: declares {declared!r} as {owner} does, rename one of them")
    bodies = [_EXPORT.sub("", _IMPORT.sub("", text)) for text in parts.values()]
    whole = "\n".join(bodies)
    if found := _LEFT_OVER.search(whole):
        raise InputError(
            f'{name}: found {found.group().strip()!r}, expected import {{ names }} from "./part.js"; and '
            "exports of functions, classes, const or let"
        )
    return whole


@cache
def style(*names: str, folder: Path = FOLDER) -> str:
    """The shared style sheet, then the files ``names``."""
    files = (FOLDER / SHARED_STYLE, *(folder / name for name in names))
    return "\n".join(file.read_text(encoding="utf-8") for file in files)


def _collect(name: str, folder: Path, parts: dict[str, str]) -> None:
    """Add a file to ``parts`` after what it imports; files are in the order they are first needed."""
    file = next((place / name for place in (folder, FOLDER) if (place / name).is_file()), None)
    if file is None:
        raise InputError(f"{folder / name}: no such file, expected a part of a widget's script")
    text = file.read_text(encoding="utf-8")
    for imported in _IMPORT.findall(text):
        if imported not in parts:
            _collect(imported, folder, parts)
    parts.setdefault(name, text)
