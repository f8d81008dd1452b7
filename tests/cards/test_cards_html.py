"""What a notebook shows of an object: well formed, escaped, in the page's own colours."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from pathlib import Path

from tiny import write_pairs, write_pool

import sfkit
from sfkit.cards import MOST_ROWS, card
from sfkit.merging.recipe import Recipe
from sfkit.search import SubsetSearch, SubsetSettings


def texts(html: str) -> list[str]:
    """The texts of a card, in order; what a parser of XML finds. No colour but the page's."""
    assert "color: #" not in html
    assert "rgb(" not in html
    return [text for text in ET.fromstring(f"<all>{html}</all>").itertext() if text]


def test_names_never_become_markup() -> None:
    shown = texts(
        card("<b>a</b>", {"<i>": "&amp;", "none": None, "empty": ""}, columns=["<u>"], rows=[["<s>"]])
    )
    assert shown == ["<b>a</b>", "<i>: &amp;", "<u>", "<s>"]


def test_a_long_table_says_how_much_is_left_out() -> None:
    shown = texts(card("t", {}, columns=["n"], rows=[[n] for n in range(MOST_ROWS + 3)]))
    assert shown[-2:] == [str(MOST_ROWS - 1), "and 3 more"]


def test_pool_benchmark_search_candidate_and_recipe_have_cards(tmp_path: Path) -> None:
    pool = sfkit.open_pool(write_pool(tmp_path / "pool"))
    benchmark = sfkit.open_benchmark("pairs", write_pairs(tmp_path / "pairs"), metric="bad-2.0")
    search = SubsetSearch(
        pool.names,
        pool.blocks,
        sfkit.Evaluator(pool, benchmark),
        SubsetSettings(population=4, generations=1),
    )
    assert "generation -1, goes on" in " ".join(texts(search._repr_html_()))
    best = search.run()
    shown = texts(pool._repr_html_())
    assert shown[0] == "Pool tiny"
    assert {"base", "a", "b", "c", "licence of a", "CC0-1.0"} <= set(shown)
    shown = texts(benchmark._repr_html_())
    assert shown[:2] == ["Benchmark pairs", "pairs: 2 pairs: pair0, pair1"]
    assert "metric: bad-2.0, under protocol all-valid" in shown
    shown = texts(search._repr_html_())
    assert shown[0] == "Subset search"
    assert {"metric: bad-2.0", f"{best.score:.2f}", ", ".join(best.subset)} <= set(shown)
    assert texts(best._repr_html_())[:2] == [f"Candidate {best.number}", f"score: {best.score:.2f}"]


def test_a_recipe_shows_one_row_where_all_blocks_are_alike() -> None:
    tied = texts(Recipe.equal(("a", "<b>"), ("x", "y"))._repr_html_())
    assert tied == ["Recipe", "block", "a", "<b>", "scale", "all blocks", "0.50", "0.50", "× 1.00"]
    routed = Recipe(("a",), ("x", "y"), ((1.0,), (1.0,)), (1.0, 0.5))
    assert texts(routed._repr_html_())[-6:] == ["x", "1.00", "× 1.00", "y", "1.00", "× 0.50"]
    assert texts(Recipe.base(("x",))._repr_html_()) == ["Recipe", "sources: none: the base itself"]
