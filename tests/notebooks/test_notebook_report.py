"""The full report, run on the bank: recorded results, every table as a file, a page that says it first."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import nbformat
import numpy as np
import pandas as pd
import pytest
from nbformat import NotebookNode

from sfkit import bank
from sfkit.reports import report

if TYPE_CHECKING:
    from playwright.sync_api import Browser

NOTEBOOK = Path(__file__).parents[2] / "notebooks" / "report.ipynb"
PLOTLY = "application/vnd.plotly.v1+json"
SMALL = {
    "pool": "bank",
    "benchmark_pairs": 2,
    "report_on": [{"name": "bank:indoor-rooms", "pairs": 2}, {"name": "bank:hazy-road", "pairs": 2}],
    "population": 6,
    "generations": 2,
    "evaluations": 12,
    "seeds": 2,
    "methods": ["single_best", "uniform", "stage1", "stage1_2"],
}

# bad-3.0 in percent on two pairs of each benchmark, recorded on a CPU.
SCORES = {"base": 31.5431, "single best (validation)": 20.2403, "uniform": 25.1404}
# Cosines of two task vectors: those least alike, and those most.
LEAST, MOST = 0.086, 0.383
TABLES = (
    *("main", "differences", "strategies", "sources", "geometry", "cosines", "selection", "probes"),
    *("similarity", "recipe", "stages", "metrics", "guides", "rivals", "population", "cost", "overhead"),
    "environment",
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    place = tmp_path_factory.mktemp("report")
    report(NOTEBOOK, {**SMALL, "out": place}, place / "page.html")
    return place


@pytest.fixture(scope="module")
def executed(folder: Path) -> NotebookNode:
    return nbformat.read(folder / "page.ipynb", as_version=4)


def table(folder: Path, name: str) -> pd.DataFrame:
    return pd.read_csv(folder / "tables" / f"{name}.csv")


def test_the_main_table_holds_the_recorded_means(folder: Path) -> None:
    main = table(folder, "main").set_index("method")
    metric = "(all-valid) bad-3.0 [%]"
    shown = [f"courtyard {metric} *", f"indoor-rooms {metric}", f"hazy-road {metric}"]
    assert list(main.columns) == [*shown, "mean", "mean of the unseen"]
    for network, score in SCORES.items():
        assert main.loc[network, "mean of the unseen"] == pytest.approx(score, abs=0.01), network
    assert list(main.index)[-2:] == ["Stage 1", "Stage 1+2"]
    differences = table(folder, "differences").set_index("method")
    assert differences.loc["base", "verdict"] == "no interval: indoor-rooms has 2 images, an interval needs 5"


def test_every_table_is_a_csv_and_a_latex_file(folder: Path) -> None:
    assert {path.name for path in (folder / "tables").iterdir()} == {
        f"{name}.{ending}" for name in TABLES for ending in ("csv", "tex")
    }
    for name in TABLES:
        text = (folder / "tables" / f"{name}.tex").read_text(encoding="utf-8")
        assert text.count(r" \\") == 1 + len(table(folder, name)), name


def test_ablations_begin_with_the_search_s_own_answer(folder: Path) -> None:
    stages, metrics, guides = (table(folder, name) for name in ("stages", "metrics", "guides"))
    assert metrics["subset"][0] == guides["subset"][0]
    assert stages["mean"][1] == metrics["mean"][0] == guides["mean"][0], "Stage 1+2 of one seed"
    guided = ["courtyard bad-3.0", "indoor-rooms bad-3.0", "hazy-road bad-3.0"]
    assert guides["fitness"].tolist() == guided


def test_searches_cost_a_share_of_the_fine_tunings_they_start_from(folder: Path) -> None:
    overhead = table(folder, "overhead").set_index("method")
    trained = bank.training_seconds()
    assert overhead.loc["fine-tuning the sources", "wall seconds"] == pytest.approx(sum(trained.values()))
    spent = table(folder, "cost").set_index("method").loc["Stage 1+2", "wall seconds"]
    assert overhead.loc["Stage 1+2", "overhead [%]"] == pytest.approx(100 * spent / sum(trained.values()))


def test_task_vectors_have_the_cosines_of_the_bank(folder: Path) -> None:
    cosines = table(folder, "cosines").set_index("source")
    assert list(cosines.index) == list(cosines.columns) == list(bank.training_seconds())
    assert cosines.to_numpy().diagonal() == pytest.approx(1.0)
    between = cosines.to_numpy()[np.triu_indices(len(cosines), 1)]
    assert [between.min(), between.max()] == pytest.approx([LEAST, MOST], abs=0.005)


def test_the_page_says_first_what_to_deploy(executed: NotebookNode) -> None:
    spoken = next(cell for cell in executed.cells if cell.id == "summary").outputs
    (said,) = [output.data["text/markdown"] for output in spoken if "data" in output]
    assert said.startswith("- **Deploy single best (validation): bad-3.0 ")
    assert "It is one network of the base's size and speed" in said
    assert "mixed from haze 100 %" in said
    assert [o for o in spoken if o.output_type == "stream"] == [], "progress is for the terminal"


def test_the_page_says_whether_a_pair_was_held_out_and_that_no_test_was_seen(executed: NotebookNode) -> None:
    told = "".join(o.get("text", "") for cell in executed.cells for o in cell.get("outputs", []))
    assert "No validation pair was held out" in told
    assert "no pair of it is in the benchmarks reported as a test" in told
    assert "edited by hand" not in told


def test_every_figure_was_drawn_and_nothing_complained(executed: NotebookNode) -> None:
    outputs = [output for cell in executed.cells for output in cell.get("outputs", [])]
    assert sum(PLOTLY in output.get("data", {}) for output in outputs) == 21
    assert [output.text for output in outputs if output.get("name") == "stderr"] == []
    printed = "".join(output.get("text", "") for output in outputs)
    assert "sfkit report report -p pool bank -p benchmark_pairs 2" in printed


@pytest.mark.browser
def test_the_page_shows_every_figure_without_a_network(folder: Path, browser: Browser) -> None:
    context = browser.new_context(offline=True, viewport={"width": 1100, "height": 900})
    noise: list[str] = []
    asked: list[str] = []
    page = context.new_page()
    page.on("console", lambda message: noise.append(f"{message.type}: {message.text}"))
    page.on("pageerror", lambda error: noise.append(str(error)))
    page.on("request", lambda request: asked.append(request.url))
    address = (folder / "page.html").as_uri()
    page.goto(address)
    page.wait_for_function("[...document.querySelectorAll('.plot')].every(p => p.querySelector('.gtitle'))")
    titles = page.locator(".plot .gtitle").all_text_contents()
    assert len(titles) == 21
    assert all("?" in title for title in titles)
    assert page.locator("h1").inner_text().startswith("Deploy single best (validation)")
    assert (
        "mixed from haze 100 %"
        in page.locator(".verdict li").first.inner_text() + page.locator(".verdict li").nth(1).inner_text()
    )
    assert page.locator("nav a").count() >= 15
    assert page.locator("table").count() >= 10
    context.close()
    assert noise == []
    assert [url for url in asked if not url.startswith(("data:", "blob:"))] == [address]


@pytest.mark.browser
@pytest.mark.parametrize("width", [1280, 420])
def test_tables_fit_the_page_or_scroll_within_it_and_their_latex_is_folded(
    folder: Path, browser: Browser, width: int
) -> None:
    context = browser.new_context(offline=True, viewport={"width": width, "height": 900})
    page = context.new_page()
    page.goto((folder / "page.html").as_uri())
    assert page.evaluate("document.documentElement.scrollWidth") <= width, "no text runs out of the page"
    tables = page.evaluate(
        """() => [...document.querySelectorAll('.shown-table')].map(one => {
            const room = one.querySelector('.scroll');
            return {over: room.scrollWidth - room.clientWidth, how: getComputedStyle(room).overflowX,
                    latex: one.querySelector('details pre').checkVisibility()};
        })"""
    )
    context.close()
    assert len(tables) >= 8
    assert {table["how"] for table in tables} == {"auto"}
    assert not any(table["latex"] for table in tables)
    over = [table["over"] for table in tables]
    assert max(over) <= 1 if width == 1280 else max(over) > 100
