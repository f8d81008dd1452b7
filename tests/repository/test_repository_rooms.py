"""The rooms know only what stands left of them (the way the data goes), seen in their imports."""

from __future__ import annotations

import ast
from collections.abc import Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "sfkit"

# Left to right: a room may import the rooms before it, and no other.
ROOMS = (
    "on_demand",
    "errors",
    "settings",
    "files",
    "outside",
    "streams",
    "colours",
    "cards",
    "checkpoints",
    "architectures",
    "datasets",
    "merging",
    "evaluation",
    "exporting",
    "training",
    "search",
    "published",
    "baselines",
    "editing",
    "analysis",
    "figures",
    "reports",
    "bank",
    "factory",
    "__init__",
    "cli",
    "__main__",
)
# Rooms that know less than all that stands left of them.
NARROW: dict[str, set[str]] = {
    "settings": {"errors"},
    "files": {"errors"},
    "outside": {"errors", "files"},
    "streams": set(),
    "colours": set(),
    "cards": set(),
    "checkpoints": {"errors", "files", "outside"},
    "architectures": {"errors", "files"},
    "datasets": {"errors", "settings", "files", "outside", "cards"},
    # It sees no image.
    "merging": {"errors", "settings", "files", "outside", "cards", "checkpoints", "architectures"},
    "exporting": {"errors", "files", "checkpoints", "architectures", "datasets", "merging", "evaluation"},
    "search": {"errors", "settings", "files", "outside", "streams", "cards", "merging", "evaluation"},
    "published": {"errors"},
    "editing": {"errors", "datasets", "merging", "evaluation"},
    "figures": {"errors", "colours", "analysis"},  # they draw records, and compute none
    "reports": {"errors", "files"},
}
FOREIGN = {
    "merging": {"cv2"},
    "search": {"torch", "cv2", "safetensors"},  # it proposes recipes, and never touches a tensor
    "figures": {"torch", "safetensors"},
}


def imports(path: Path) -> set[str]:
    """Full names of the modules a file imports, wherever in the file."""
    found: set[str] = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path}: a relative import"
            found |= {f"{node.module}.{alias.name}" for alias in node.names}
    return found


def room_of(name: str) -> str:
    """The room of an imported ``sfkit`` name; what is no room comes from the package's front."""
    inner = name.removeprefix("sfkit").strip(".").partition(".")[0]
    return inner if inner in ROOMS else "__init__"


def files(room: str) -> list[Path]:
    """The Python files of a room: a folder, or one module."""
    folder = PACKAGE / room
    return sorted(folder.rglob("*.py")) if folder.is_dir() else [folder.with_suffix(".py")]


def test_every_room_has_its_place() -> None:
    found = {path.stem for path in PACKAGE.iterdir() if path.suffix == ".py" or any(path.glob("*.py"))}
    assert found == set(ROOMS), "say in ROOMS where a new room stands"


@pytest.mark.parametrize("room", ROOMS)
def test_a_room_knows_only_what_stands_left_of_it(room: str) -> None:
    allowed = NARROW.get(room, set(ROOMS[: ROOMS.index(room)])) | {room, "on_demand"}
    for path in files(room):
        names = imports(path)
        known = {room_of(name) for name in names if name.partition(".")[0] == "sfkit"}
        assert known <= allowed, f"{path.relative_to(ROOT)} imports {known - allowed}"
        tops = {name.partition(".")[0] for name in names}
        assert "sfkit_widgets" not in tops, f"{path.relative_to(ROOT)}: sfkit never imports its widgets"
        assert not tops & FOREIGN.get(room, set()), f"{path.relative_to(ROOT)} imports {tops}"


def modules(folder: Path) -> dict[str, Path]:
    """Name -> file of every module below a folder whose parent is on the path."""
    named = {}
    for path in folder.rglob("*.py"):
        parts = path.relative_to(folder.parent).with_suffix("").parts
        named[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = path
    return named


def known_modules(names: set[str], named: Mapping[str, Path]) -> Iterator[str]:
    """The modules that imported names stand for: ``a.b.c`` is the module, or a name out of ``a.b``."""
    for name in names:
        found = name if name in named else name.rpartition(".")[0]
        if found in named:
            yield found


def assert_no_circle(named: Mapping[str, Path]) -> None:
    """No module imports itself by way of others, wherever in the files the imports stand."""
    graph = {name: set(known_modules(imports(path), named)) - {name} for name, path in named.items()}
    try:
        TopologicalSorter(graph).prepare()
    except CycleError as error:
        pytest.fail(f"modules import each other in a circle: {' <- '.join(error.args[1])}")


@pytest.mark.parametrize("folder", [PACKAGE, ROOT / "widgets" / "sfkit_widgets"], ids=lambda path: path.name)
def test_no_module_imports_itself_by_way_of_others(folder: Path) -> None:
    assert_no_circle(modules(folder))


def test_no_benchmark_imports_itself_by_way_of_others() -> None:
    assert_no_circle({path.stem: path for path in (ROOT / "benchmarks").glob("*.py")})


def test_a_circle_for_type_checkers_alone_is_found(tmp_path: Path) -> None:
    (tmp_path / "kit").mkdir()
    (tmp_path / "kit" / "one.py").write_text("from kit.two import B")
    (tmp_path / "kit" / "two.py").write_text(
        "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    from kit import one\n"
    )
    with pytest.raises(pytest.fail.Exception, match=r"in a circle: kit\.(one|two) <- kit"):
        assert_no_circle(modules(tmp_path / "kit"))
