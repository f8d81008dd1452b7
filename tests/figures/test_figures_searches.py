"""Figures of both stages, of scores and of costs: the marks stand where the records say."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import plotly.graph_objects as go
import pytest
from figure_records import costs, evolved, grid, population, trace

from sfkit.analysis.scores import ScoreColumn, ScoreGrid
from sfkit.errors import InputError
from sfkit.figures import (
    cmaes_figure,
    cost_figure,
    evolution_figure,
    population_figure,
    routing_figure,
    scales_figure,
    scores_figure,
)
from sfkit.figures.axes import FAILED_NAME


def named(figure: go.Figure, name: str) -> list[go.scatter.Line]:
    found = [drawn for drawn in figure.data if drawn.name == name]
    assert found, f"no trace {name!r}, found {[drawn.name for drawn in figure.data]}"
    return found


def test_the_population_is_drawn_row_by_row_best_first() -> None:
    history = population()
    figure = population_figure(history)
    (members,) = named(figure, "membership")
    assert [list(row) for row in members.z] == [[1, 1, 1], [1, 0, 1], [0, 1, 1]]
    assert list(members.x) == ["a", "b", "c"]
    (share,) = named(figure, "share")
    np.testing.assert_allclose(share.z, 100.0 * np.array(history.share))
    (best,) = named(figure, "best so far")
    assert (list(best.x), list(best.y)) == ([20.0, 10.0], [0, 1])
    (scored,) = named(figure, "individual")
    assert (list(scored.x), list(scored.y)) == ([10.0, 20.0], [1, 2])
    assert "generation 1: {a, b, c} with bad-1.0 10.00 % leads" in figure.layout.title.subtitle.text


def test_sizes_diversity_and_the_archive_stand_beside_each_other() -> None:
    figure = evolution_figure(evolved(), archive=2)
    sizes = {
        name: list(named(figure, name)[0].y) for name in ("largest subset", "mean size", "smallest subset")
    }
    assert sizes == {"largest subset": [2, 3], "mean size": [2.0, 7 / 3], "smallest subset": [2, 2]}
    (diversity,) = named(figure, "diversity")
    assert list(diversity.y) == pytest.approx([2 / 3, 4 / 9])
    (archive,) = named(figure, "archive")
    assert [list(row) for row in archive.z] == [[1, 1, 1], [1, 0, 1]]
    assert list(figure.layout.yaxis2.ticktext) == ["1: bad-1.0 10.00 %", "2: bad-1.0 20.00 %"]
    assert "differ by 0.67 at first and 0.44 at the end" in figure.layout.title.subtitle.text


def test_an_archive_may_be_empty() -> None:
    figure = evolution_figure(replace(evolved(), archive=()))
    (archive,) = named(figure, "archive")
    assert len(archive.z or ()) == 0


def test_a_failed_individual_is_a_cross_beyond_all_scores() -> None:
    figure = population_figure(population())
    (failed,) = named(figure, FAILED_NAME)
    assert list(failed.y) == [3]
    assert failed.x[0] > 30.0
    assert failed.marker.symbol == "x"
    assert "failed" in failed.text[0]


def test_both_panels_of_a_column_share_their_axis() -> None:
    layout = population_figure(population()).layout
    assert layout.xaxis.matches == "x3"
    assert layout.xaxis2.matches == "x4"
    assert (layout.yaxis2.matches, layout.yaxis4.matches) == ("y", "y3")


def test_a_cut_population_says_so() -> None:
    figure = population_figure(population(), individuals=2)
    (members,) = named(figure, "membership")
    assert len(members.z) == 2
    assert "the best 2 of 3 individuals" in figure.layout.title.subtitle.text


def test_a_population_without_any_score_can_be_drawn() -> None:
    history = population()
    broken = replace(
        history,
        best=(math.inf,) * 2,
        median=(math.inf,) * 2,
        individuals=tuple(replace(one, score=math.inf) for one in history.individuals),
    )
    figure = population_figure(broken)
    assert "no individual has a score" in figure.layout.title.subtitle.text
    assert len(named(figure, FAILED_NAME)[0].x) == 3


def test_the_routing_heatmap_shows_the_best_recipe_or_the_one_asked_for() -> None:
    record = trace(tied=False)
    for figure, number in ((routing_figure(record), record.best), (routing_figure(record, evaluation=3), 3)):
        (heat,) = named(figure, "routing weight")
        np.testing.assert_array_equal(heat.z, record.weights[number])
        assert list(heat.y) == [
            f"one (× {record.scales[number, 0]:.2f})",
            f"two (× {record.scales[number, 1]:.2f})",
        ]
        (figures,) = named(figure, "weight in figures")
        assert list(figures.text) == [f"{weight:.2f}" for weight in record.weights[number].ravel()]
        assert f"evaluation {number}" in figure.layout.title.subtitle.text


def test_weights_over_time_are_candidates_and_the_best_so_far() -> None:
    record = trace(tied=False)
    figure = routing_figure(record)
    dots, line = named(figure, "b")[:2]
    np.testing.assert_array_equal(dots.y, record.weights[:, 0, 1])
    assert list(line.x) == list(range(1, len(record)))  # evaluation 0 failed: nothing leads yet
    np.testing.assert_array_equal(line.y, record.weights[record.incumbent[1:], 0, 1])
    assert len(named(figure, "b")) == 4  # dots and line, for each of two blocks


def test_tied_routing_needs_one_panel() -> None:
    assert len(named(routing_figure(trace()), "b")) == 2


def test_a_recipe_that_is_not_there_is_refused() -> None:
    record = trace()
    with pytest.raises(InputError, match="evaluation: found 12, expected 0 to 11"):
        routing_figure(record, evaluation=12)
    failed = np.full(len(record), math.inf)
    with pytest.raises(InputError, match="found no evaluation with a finite score"):
        routing_figure(replace(record, score=failed, penalised=failed))


def test_scales_stand_between_the_ends_of_their_range_with_one_marked() -> None:
    record = trace()
    figure = scales_figure(record)
    dots = named(figure, "module scale")[0]
    np.testing.assert_array_equal(dots.y, record.scales[:, 0])
    levels = [shape.y0 for shape in figure.layout.shapes]
    assert levels == [0.25, 1.0, 1.75] * 2
    solid = [shape.y0 for shape in figure.layout.shapes if shape.line.dash == "solid"]
    assert solid == [1.0, 1.0]
    assert tuple(figure.layout.yaxis.tickvals) == (0.25, 1.0, 1.75)
    low, high = figure.layout.yaxis.range
    assert low < 0.25 < 1.75 < high


def test_cmaes_scores_failures_and_axes() -> None:
    record = trace()
    figure = cmaes_figure(record)
    (dots,) = named(figure, "candidate")
    assert len(dots.x) == 10
    assert set(dots.x).isdisjoint({0, 4})
    (failed,) = named(figure, FAILED_NAME)
    assert list(failed.x) == [0, 4]
    assert failed.y[0] > max(dots.y)
    (best,) = named(figure, "best so far")
    assert list(best.y) == np.minimum.accumulate(record.score[1:]).tolist()
    (longest,) = named(figure, "longest axis")
    np.testing.assert_array_equal(longest.y, record.axes[[0, 4, 8, 11], 4])
    assert figure.layout.yaxis2.type == figure.layout.yaxis3.type == "log"


def test_cmaes_says_how_much_was_gained_over_equal_weights() -> None:
    record = trace()
    record.score[0] = record.penalised[0] = 20.5
    gained = 20.5 - record.score.min()
    assert f"{gained:.2f} below equal weights" in cmaes_figure(record).layout.title.subtitle.text


def test_the_best_of_each_panel_is_filled_and_a_failure_is_no_score() -> None:
    figure = scores_figure(grid())
    (guide,) = named(figure, "guide bad-1.0")
    assert list(guide.y) == ["base", "merged"]
    assert list(guide.marker.symbol) == ["circle-open", "circle"]
    failures = named(figure, FAILED_NAME)
    assert [list(drawn.y) for drawn in failures] == [["a"], ["merged"]]
    assert failures[0].x[0] > 40.0
    assert [shape.x0 for shape in figure.layout.shapes] == [40.0, 50.0, 3.0]


def test_columns_that_guided_the_search_bear_a_star_and_names_are_escaped() -> None:
    texts = [note.text for note in scores_figure(grid()).layout.annotations]
    assert texts == ["guide *", "test &lt;b&gt;"]
    assert "guided the search" in scores_figure(grid()).layout.title.subtitle.text


def test_no_reference_line_where_none_is_asked_for() -> None:
    assert not scores_figure(grid(), reference=None).layout.shapes


def test_benchmarks_of_one_metric_each_stand_side_by_side() -> None:
    columns = (ScoreColumn("one", "bad-1.0", "%", False), ScoreColumn("two", "d1", "%", False))
    figure = scores_figure(ScoreGrid(("a", "b"), columns, np.array([[1.0, 4.0], [2.0, 3.0]])))
    assert figure.layout.yaxis.domain == figure.layout.yaxis2.domain == (0.0, 1.0)
    assert [figure.layout[axis].title.text for axis in ("xaxis", "xaxis2")] == [
        "bad-1.0 (% of pixels)",
        "D1 (% of pixels)",
    ]


def test_costs_are_stacked_by_origin() -> None:
    figure = cost_figure(costs())
    evaluations, seconds = named(figure, "computed")
    assert (list(evaluations.x), list(evaluations.y)) == ([7, 60], ["Stage 1", "Stage 2"])
    assert list(seconds.x) == [3.5, 18.0]
    assert list(named(figure, "from the store")[0].x) == [4, 0]
    assert list(named(figure, "repeated, not evaluated")[0].x) == [29, 0]
    assert figure.layout.barmode == "stack"
    assert "67 evaluations computed in 21.5 s" in figure.layout.title.subtitle.text
