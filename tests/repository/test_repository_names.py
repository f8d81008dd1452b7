"""A class has a name of its own: no two unlike things of the library and its benchmarks share one."""

from __future__ import annotations

import ast
from collections import defaultdict
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).parents[2]
# A name that two files may give to a class each, and why.
PERMITTED: Mapping[str, str] = {}


def shared_names(folders: list[Path]) -> dict[str, list[str]]:
    """Class -> the files that define one so called, of classes that more than one file defines."""
    found: dict[str, set[str]] = defaultdict(set)
    for folder in folders:
        for path in folder.rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, ast.ClassDef):
                    found[node.name].add(path.relative_to(folder.parent).as_posix())
    return {name: sorted(files) for name, files in found.items() if len(files) > 1}


def test_no_two_classes_share_a_name() -> None:
    found = shared_names([ROOT / "sfkit", ROOT / "widgets" / "sfkit_widgets", ROOT / "benchmarks"])
    assert {name: files for name, files in found.items() if name not in PERMITTED} == {}
    assert set(PERMITTED) <= set(found), "a permission that nothing needs any more"


def test_a_shared_name_is_found(tmp_path: Path) -> None:
    for room, text in (("a", "class Layer: ..."), ("b", "def f():\n    class Layer: ...\nclass Block: ...")):
        (tmp_path / "kit" / room).mkdir(parents=True)
        (tmp_path / "kit" / room / "parts.py").write_text(text)
    assert shared_names([tmp_path / "kit"]) == {"Layer": ["kit/a/parts.py", "kit/b/parts.py"]}


def test_only_what_people_import_from_lists_its_names() -> None:
    listing = [
        path.relative_to(ROOT).as_posix()
        for folder in (ROOT / "sfkit", ROOT / "widgets")
        for path in folder.rglob("*.py")
        if "\n__all__ = " in path.read_text(encoding="utf-8")
    ]
    rooms = ("", "analysis/", "baselines/", "figures/", "search/")
    fronts = [f"sfkit/{room}__init__.py" for room in rooms]
    assert sorted(listing) == sorted([*fronts, "widgets/sfkit_widgets/__init__.py"])
