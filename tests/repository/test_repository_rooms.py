"""The rooms know only what stands left of them (the way the data goes), seen in their imports."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
PACKAGE = ROOT / "sfkit"

# Left to right: a room may import the rooms before it, and no other.
ROOMS = (
    "errors",
    "files",
    "streams",
    "checkpoints",
    "architectures",
    "datasets",
    "merging",
    "evaluation",
    "search",
    "published",
    "baselines",
    "analysis",
    "figures",
    "inspection",
    "bank",
    "places",
    "reports",
    "demo",
    "__init__",
    "cli",
    "__main__",
)
# Rooms that know less than all that stands left of them.
NARROW: dict[str, set[str]] = {
    "files": set(),
    "streams": set(),
    "checkpoints": {"errors", "files"},
    "architectures": {"errors"},
    "datasets": {"errors", "files"},
    "merging": {"errors", "files", "checkpoints", "architectures"},  # it never sees an image
    "search": {"errors", "files", "streams", "merging", "evaluation"},
    "published": {"errors"},
    "figures": {"errors", "analysis"},  # they draw records, and compute none
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
    allowed = NARROW.get(room, set(ROOMS[: ROOMS.index(room)])) | {room}
    for path in files(room):
        names = imports(path)
        known = {room_of(name) for name in names if name.partition(".")[0] == "sfkit"}
        assert known <= allowed, f"{path.relative_to(ROOT)} imports {known - allowed}"
        tops = {name.partition(".")[0] for name in names}
        assert "sfkit_widgets" not in tops, f"{path.relative_to(ROOT)}: sfkit never imports its widgets"
        assert not tops & FOREIGN.get(room, set()), f"{path.relative_to(ROOT)} imports {tops}"
