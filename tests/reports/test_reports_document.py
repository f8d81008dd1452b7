"""A report reads as a document: the answer is its title, evidence follows, parameters stand at the end."""

from __future__ import annotations

from datetime import datetime

from nbformat.v4 import new_code_cell, new_markdown_cell, new_notebook, new_output

from sfkit.reports import Conclusion
from sfkit.reports.page import Failure, NotebookRun, render_page

ANSWER = Conclusion.of(["**Deploy <a> & b: 5 %.**", "It is one network.", "<script>alert(1)</script>"])


def page(*sources: str, answer: Conclusion | None = ANSWER, failure: Failure | None = None) -> str:
    """A notebook with a title, its parameters, an answer and chapters."""
    cells = [
        new_markdown_cell("# Which network?\n\nOne pool in."),
        new_markdown_cell("## What was asked for\n\nThe parameters."),
        new_code_cell("seed = 0", metadata={"tags": ["parameters"]}),
        new_code_cell("seed = 7", metadata={"tags": ["injected-parameters"]}),
        new_code_cell("answer"),
        *map(new_markdown_cell, sources),
    ]
    if answer is not None:
        cells[4].outputs = [new_output("display_data", data=answer._repr_mimebundle_())]
    run = NotebookRun("which.ipynb", datetime.now().astimezone(), 3.0, {"seed": 7, "pool": "<b>"}, failure)
    return render_page(new_notebook(cells=cells), run)


def test_a_conclusion_is_a_list_in_jupyter() -> None:
    bundle = ANSWER._repr_mimebundle_()
    assert bundle["text/markdown"].splitlines()[:2] == ["- **Deploy <a> & b: 5 %.**", "- It is one network."]
    assert Conclusion.of(["Only this."]) == Conclusion("Only this.")


def test_the_answer_is_the_title_and_what_it_rests_on_a_box_of_text() -> None:
    html = page("## One\n\nx", "## Two")
    assert "<title>Deploy &lt;a&gt; &amp; b: 5 %.</title>" in html
    assert html.count("<h1>") == 1
    body = html[html.index("<body>") :]
    order = [
        '<p class="question">Which network?</p>',
        "<h1>Deploy &lt;a&gt; &amp; b: 5 %.</h1>",
        "<li>It is one network.</li><li>&lt;script&gt;alert(1)&lt;/script&gt;</li>",
        '<nav aria-label="Contents">',
        "One pool in.",
        '<h2 id="One">',
        '<h2 id="Two">',
        '<h2 id="What-was-asked-for">',
        "<footer>",
        "Notebook which.ipynb",
        "Parameters given",
    ]
    places = [body.index(text) for text in order]
    assert places == sorted(places)
    assert body.count("It is one network.") == 1, "it leaves the cell that displayed it"
    assert "&lt;b&gt;" in body


def test_contents_lead_to_the_chapters() -> None:
    html = page("## Is *it* <better>?\n\n### Part", "## Two & three")
    contents = html[html.index("<nav") : html.index("</nav>")]
    assert '<a href="#Two-&amp;-three">Two &amp; three</a>' in contents
    assert ">Is it" in contents
    assert "Part" not in contents
    assert '<a href="#how-this-page-was-made">' in contents
    assert "<nav" not in page(answer=None), "one chapter needs none"


def test_without_an_answer_the_notebooks_title_stands() -> None:
    html = page("## One", answer=None, failure=Failure(None, "ValueError: no <such> thing"))
    assert "<title>Which network?</title>" in html
    assert "<h1>Which network?</h1>" in html
    assert 'class="verdict"' not in html
    top = html[html.index("<header>") : html.index("</header>")]
    assert "This run failed." in top
    assert "no &lt;such&gt; thing" in top
    assert "which.ipynb" not in top, "a page opens with what it found, not with a file's name"
