"""Hook: every link of the built pages leads somewhere, and no page asks another host for its parts."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

from mkdocs.config.defaults import MkDocsConfig

LOG = logging.getLogger("mkdocs.hooks.links")  # in strict mode a warning ends the build
PARTS = {("script", "src"), ("link", "href"), ("img", "src"), ("source", "src"), ("iframe", "src")}
MADE_LAST = "search/"  # its index is written when all pages are


@dataclass
class Page(HTMLParser):
    """What one page has that can be linked to, and what it links to."""

    anchors: set[str] = field(default_factory=set)
    links: list[tuple[str, str]] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Note ids and links of an element."""
        for name, value in attrs:
            if name in ("id", "name") and value:
                self.anchors.add(value)
            if name in ("href", "src") and value and (tag, dict(attrs).get("rel")) != ("link", "canonical"):
                self.links.append((f"{tag} {name}", value))


def broken(site: Path) -> Iterator[str]:
    """Each link of a built site that leads nowhere, and each part from another host, as a sentence."""
    pages = {}
    for file in sorted(site.rglob("*.html")):
        pages[file.resolve()] = page = Page()
        page.feed(file.read_text(encoding="utf-8"))
    for file, page in pages.items():
        here = file.relative_to(site.resolve())
        if here.name == "404.html":  # is shown under any address
            continue
        for where, link in page.links:
            parts = urlsplit(link)
            if parts.scheme in ("data", "mailto", "javascript"):
                continue
            if parts.scheme or parts.netloc:
                if tuple(where.split()) in PARTS:
                    yield f"{here}: {where} asks another host: {link}"
                continue
            target = (file.parent / unquote(parts.path)).resolve() if parts.path else file
            target = target / "index.html" if target.is_dir() else target
            inside = target.is_relative_to(site.resolve())
            if not target.exists() and not (inside and MADE_LAST in link):
                yield f"{here}: {where} leads nowhere: {link}"
            elif parts.fragment and target in pages and unquote(parts.fragment) not in pages[target].anchors:
                yield f"{here}: {where} names a place that is not there: {link}"


def on_post_build(config: MkDocsConfig) -> None:
    """Warn of every link that is broken."""
    for sentence in broken(Path(config.site_dir)):
        LOG.warning(sentence)
