"""The documentation: its pages are in the navigation, and what its reference names exists."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
CONFIG = yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))


def pages(entries: object) -> set[str]:
    """All files a navigation names, at any depth."""
    if isinstance(entries, str):
        return {entries}
    values = entries.values() if isinstance(entries, dict) else entries
    assert isinstance(values, list) or hasattr(values, "__iter__")
    return set().union(*(pages(entry) for entry in values))


def test_every_page_is_in_the_navigation() -> None:
    found = {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    assert found <= pages(CONFIG["nav"]), "add a new page to nav in mkdocs.yml"


def test_pages_made_from_other_files_have_their_file() -> None:
    generated = pages(CONFIG["nav"]) - {path.relative_to(DOCS).as_posix() for path in DOCS.rglob("*.md")}
    hooks = (DOCS / "site.py").read_text(encoding="utf-8")
    for page in generated:
        assert f'"{page}": "' in hooks, f"{page} is in nav and no hook makes it"


@pytest.mark.parametrize("page", sorted((DOCS / "reference").glob("*.md")), ids=lambda path: path.stem)
def test_every_reference_page_documents_all_public_names(page: Path) -> None:
    name = page.read_text(encoding="utf-8").split(":::")[1].strip()
    module = importlib.import_module(name)
    for public in module.__all__:
        documented = getattr(module, public)
        assert callable(documented) is False or documented.__doc__, f"{name}.{public} has no docstring"
