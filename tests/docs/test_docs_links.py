"""The check of links that ends a build of the documentation."""

from __future__ import annotations

from pathlib import Path

import links

PAGE = """<html><head><link rel="canonical" href="https://host/"><link rel="stylesheet" href="assets/a.css">
<script src="{script}"></script></head><body><h2 id="here">x</h2><a href="{link}">y</a>
<a href="https://elsewhere/">z</a></body></html>"""


def site(folder: Path, link: str, script: str = "assets/a.js") -> Path:
    (folder / "assets").mkdir(parents=True, exist_ok=True)
    for name in ("a.css", "a.js"):
        (folder / "assets" / name).touch()
    (folder / "other.html").write_text('<p id="there">x</p>', encoding="utf-8")
    (folder / "index.html").write_text(PAGE.format(link=link, script=script), encoding="utf-8")
    return folder


def test_links_that_lead_nowhere_are_named(tmp_path: Path) -> None:
    for sound in ("#here", "other.html", "other.html#there", "./", "mailto:a@b", "search/search_index.js"):
        assert list(links.broken(site(tmp_path, sound))) == [], sound
    for wrong, said in (
        ("#nowhere", "index.html: a href names a place that is not there: #nowhere"),
        ("other.html#here", "index.html: a href names a place that is not there: other.html#here"),
        ("gone.html", "index.html: a href leads nowhere: gone.html"),
        ("../outside/search/x", "index.html: a href leads nowhere: ../outside/search/x"),
    ):
        assert list(links.broken(site(tmp_path, wrong))) == [said]


def test_parts_of_pages_come_from_the_site_itself(tmp_path: Path) -> None:
    found = list(links.broken(site(tmp_path, "#here", "https://cdn/x.js")))
    assert found == ["index.html: script src asks another host: https://cdn/x.js"], (
        "a link may lead elsewhere"
    )
