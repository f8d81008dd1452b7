"""Hooks of the documentation: pages that live elsewhere in the repository, links, and equations."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import nbformat
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

ROOT = Path(__file__).parents[1]
ELSEWHERE = {  # page -> the file it is made from
    "benchmarks.md": "benchmarks/README.md",
    "contributing.md": "CONTRIBUTING.md",
    "changelog.md": "CHANGELOG.md",
}
PAGE_OF = {path: page for page, path in ELSEWHERE.items()}
REPORTS = ROOT / "build" / "notebooks"

SEARCH = '<div class="md-search" data-md-component="search" role="dialog"'
LINK = re.compile(r"(?<!`)\]\(([^)\s]+)\)")
DISPLAY = re.compile(r"^\$\$\n?(.+?)\n?\$\$$", re.MULTILINE | re.DOTALL)
INLINE = re.compile(r"(?<![\\$`\w])\$([^$\n`]+?)\$(?![\w$])")
FENCE = re.compile(r"(^```.*?^```$|`[^`\n]+`)", re.MULTILINE | re.DOTALL)


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pages that stand elsewhere, their pictures, and what `make docs` made of the notebooks."""
    for page, path in ELSEWHERE.items():
        files.append(File.generated(config, page, content=(ROOT / path).read_text(encoding="utf-8")))
    for picture in sorted((ROOT / "benchmarks" / "images").glob("*.png")):
        files.append(File.generated(config, f"images/{picture.name}", abs_src_path=str(picture)))
    for report in sorted(REPORTS.glob("*.html")):
        files.append(File.generated(config, f"notebooks/{report.name}", abs_src_path=str(report)))
    return files


def on_page_markdown(markdown: str, page: Page, **_: Any) -> str:
    """Links to files of the repository become links to their pages; equations become MathML."""
    if page.file.src_uri == "notebooks.md":
        markdown = f"{markdown}\n{_notebooks()}"
    home = home_of(page)
    folder = (ROOT / home).parent if home else (ROOT / "docs" / page.file.src_uri).parent
    markdown = LINK.sub(lambda found: f"]({_target(found[1], folder, page)})", markdown)
    parts = FENCE.split(markdown)
    parts[::2] = [_equations(part) for part in parts[::2]]
    return "".join(parts)


def on_post_page(output: str, **_: Any) -> str:
    """The search that the theme opens as a dialog has no name of its own."""
    return output.replace(SEARCH, f'{SEARCH} aria-label="Search"')


def home_of(page: Page) -> str | None:
    """The file a page is made from; None for one of docs/."""
    return ELSEWHERE.get(page.file.src_uri)


def _target(link: str, folder: Path, page: Page) -> str:
    path, mark, anchor = link.partition("#")
    if not path or "://" in path or path.startswith("mailto:"):
        return link
    file = (folder / path).resolve()
    if not file.is_relative_to(ROOT):
        return link
    inside = file.relative_to(ROOT).as_posix()
    up = "../" * page.file.src_uri.count("/")
    if inside in PAGE_OF:
        return f"{up}{PAGE_OF[inside]}{mark}{anchor}"
    if inside.startswith("benchmarks/images/"):
        return f"{up}images/{file.name}"
    if home_of(page) and inside.startswith("docs/"):
        return f"{up}{inside.removeprefix('docs/')}{mark}{anchor}"
    if inside == "README.md":
        return f"{up}index.md{mark}{anchor}"
    return link


def _equations(text: str) -> str:
    shown = DISPLAY.sub(lambda found: _displayed(found[1]), text)
    # In a span: Markdown takes a line that begins with <math> for a block of its own.
    return INLINE.sub(lambda found: f"<span>{convert(found[1])}</span>", shown)


def _displayed(equation: str) -> str:
    """An equation of its own line; one that is too wide scrolls, which takes the keyboard as well."""
    return convert(equation.strip(), display="block").replace("<math ", '<math tabindex="0" ', 1)


def _notebooks() -> str:
    """A row a notebook: its title, and its page if it was executed."""
    rows = []
    for path in sorted((ROOT / "notebooks").glob("*.ipynb")):
        title, _, rest = nbformat.read(path, as_version=4).cells[0].source.partition("\n")
        story = next((line for line in rest.splitlines() if line.strip()), "")
        made = (REPORTS / f"{path.stem}.html").exists()
        name = f"[`{path.stem}`](notebooks/{path.stem}.html)" if made else f"`{path.stem}`"
        rows.append(f"### {title.lstrip('# ')}\n\n{name}: {story}\n")
    return "\n".join(rows)
