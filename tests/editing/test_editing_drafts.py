"""Edits keep weights on the simplex, leave locked ones alone, and can all be undone."""

from __future__ import annotations

import math
from collections.abc import Callable

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sfkit.editing.drafts import LONGEST_HISTORY, EditHistory, RoutingDraft
from sfkit.errors import InputError
from sfkit.merging.recipe import Recipe, routed

SOURCES = ("a", "b", "c", "d")
BLOCKS = ("backbone", "neck", "head")

Edit = Callable[[RoutingDraft], RoutingDraft]
blocks, sources, weights = st.sampled_from(BLOCKS), st.sampled_from(SOURCES), st.floats(0, 1)
edits = st.one_of(
    st.builds(lambda b, s, w: lambda d: d.weigh(b, s, w), blocks, sources, weights),
    st.builds(lambda b, v: lambda d: d.scale(b, v), blocks, st.floats(0.25, 1.75)),
    st.builds(lambda b, s, on: lambda d: d.lock(b, s, locked=on), blocks, sources, st.booleans()),
    st.builds(lambda s: lambda d: d.without(s), sources),
    st.builds(lambda s: lambda d: d.bring_back(s), sources),
    st.builds(lambda on: lambda d: d.tie(tied=on), st.booleans()),
    st.just(lambda d: d.reset()),
)


def apply(draft: RoutingDraft, edit: Edit) -> RoutingDraft:
    """The edited draft; an edit that is refused changes nothing."""
    try:
        return edit(draft)
    except InputError:
        return draft


@st.composite
def drafts(draw: st.DrawFn) -> RoutingDraft:
    """A draft after some edits."""
    draft = RoutingDraft.equal(SOURCES, BLOCKS, tied=draw(st.booleans()))
    for edit in draw(st.lists(edits, max_size=12)):
        draft = apply(draft, edit)
    return draft


def row_of(draft: RoutingDraft, block: str) -> dict[str, float]:
    """One block's weights by source."""
    return dict(draft.recipe.of(block)[0])


@given(drafts())
def test_every_draft_is_a_routed_recipe(draft: RoutingDraft) -> None:
    for block in BLOCKS:
        row = row_of(draft, block)
        assert all(0.0 <= weight <= 1.0 + 1e-12 for weight in row.values())
        assert math.fsum(row.values()) == pytest.approx(1.0, abs=1e-9)
        assert all(row[source] == 0.0 for source in draft.gone)
    assert all(0.25 <= scale <= 1.75 for scale in draft.recipe.scales)
    assert not draft.tied or draft.recipe.tied
    assert not {source for _, source in draft.locked} & set(draft.gone)


@given(drafts(), blocks, sources, weights)
def test_a_weight_takes_what_it_is_given_and_the_free_ones_keep_their_ratios(
    draft: RoutingDraft, block: str, source: str, weight: float
) -> None:
    before = row_of(draft, block)
    try:
        after = row_of(draft.weigh(block, source, weight), block)
    except InputError:
        return
    fixed = {s for s in SOURCES if s != source and ((block, s) in draft.locked or s in draft.gone)}
    assert {s: after[s] for s in fixed} == {s: before[s] for s in fixed}
    assert after[source] == pytest.approx(min(weight, 1.0 - math.fsum(before[s] for s in fixed)), abs=1e-9)
    free = set(SOURCES) - fixed - {source}
    total, left = math.fsum(before[s] for s in free), math.fsum(after[s] for s in free)
    for s in free:
        share = before[s] / total if total > 0.0 else 1.0 / len(free)
        assert after[s] == pytest.approx(left * share, abs=1e-9)


@given(drafts(), blocks, sources, weights)
def test_an_edit_stays_in_its_block_unless_tied(
    draft: RoutingDraft, block: str, source: str, weight: float
) -> None:
    edited = apply(draft, lambda d: d.weigh(block, source, weight))
    others = [name for name in BLOCKS if name != block]
    if draft.tied:
        assert all(row_of(edited, name) == row_of(edited, block) for name in others)
    else:
        assert all(row_of(edited, name) == row_of(draft, name) for name in others)
    assert edited.recipe.scales == draft.recipe.scales


@given(drafts(), sources)
def test_bringing_a_source_back_restores_the_weights(draft: RoutingDraft, source: str) -> None:
    try:
        gone = draft.without(source)
    except InputError:
        return
    back = gone.bring_back(source)
    if any(cell in draft.locked for cell in ((b, s) for b in BLOCKS for s in SOURCES if s != source)):
        return  # locks may leave no room for it
    for block in BLOCKS:
        if row_of(draft, block)[source] < 1.0:
            assert row_of(back, block) == pytest.approx(row_of(draft, block), abs=1e-9)
    assert source not in back.gone


@given(drafts())
def test_a_draft_takes_on_its_own_recipe(draft: RoutingDraft) -> None:
    taken = RoutingDraft.equal(SOURCES, BLOCKS, tied=False).of(draft.recipe)
    assert taken.recipe == draft.recipe


@given(st.lists(edits, max_size=15), st.booleans())
def test_undo_and_redo_walk_the_same_way(steps: list[Edit], tied: bool) -> None:
    history = EditHistory(RoutingDraft.equal(SOURCES, BLOCKS, tied=tied))
    seen = [history.present]
    for edit in steps:
        history = history.edit(apply(history.present, edit))
        if history.present != seen[-1]:
            seen.append(history.present)
    for expected in reversed(seen):
        assert history.present == expected
        history = history.undo()
    assert history.present == seen[0]
    for expected in seen:
        assert history.present == expected
        history = history.redo()
    assert history.present == seen[-1]


def test_hand_values() -> None:
    draft = RoutingDraft.equal(("a", "b", "c"), ("head",), tied=False).of(
        routed(("a", "b", "c"), ("head",), [(0.5, 0.3, 0.2)])
    )
    assert row_of(draft.weigh("head", "a", 0.0), "head") == pytest.approx({"a": 0, "b": 0.6, "c": 0.4})
    locked = draft.lock("head", "b")
    assert row_of(locked.weigh("head", "a", 0.6), "head") == pytest.approx({"a": 0.6, "b": 0.3, "c": 0.1})
    assert row_of(locked.weigh("head", "a", 0.9), "head") == pytest.approx({"a": 0.7, "b": 0.3, "c": 0.0})
    assert row_of(draft.without("a"), "head") == pytest.approx({"a": 0, "b": 0.6, "c": 0.4})


def test_what_weighed_nothing_shares_equally() -> None:
    full = RoutingDraft.equal(SOURCES, BLOCKS).weigh("neck", "a", 1.0)
    assert row_of(full.weigh("neck", "a", 0.4), "neck") == pytest.approx(
        {"a": 0.4, "b": 0.2, "c": 0.2, "d": 0.2}
    )


def test_a_source_can_go_even_where_the_others_are_locked() -> None:
    draft = RoutingDraft.equal(("a", "b", "c"), ("head",)).lock("head", "b").lock("head", "c")
    assert row_of(draft.without("a"), "head") == pytest.approx({"a": 0.0, "b": 0.5, "c": 0.5})


def test_reset_is_exactly_the_equal_weight_merge() -> None:
    draft = RoutingDraft.equal(SOURCES, BLOCKS).weigh("neck", "a", 0.7).scale("head", 0.3).without("b")
    assert draft.reset() == RoutingDraft.equal(SOURCES, BLOCKS)
    assert draft.reset().recipe == Recipe.equal(SOURCES, BLOCKS)


def test_tying_takes_the_mean_row_and_untying_keeps_it() -> None:
    draft = RoutingDraft.equal(("a", "b"), ("neck", "head"), tied=False).weigh("neck", "a", 1.0)
    tied = draft.tie(tied=True)
    assert tied.recipe.weights == ((0.75, 0.25), (0.75, 0.25))
    assert tied.tie(tied=False).recipe == tied.recipe


def test_a_recipe_over_fewer_sources_is_taken_on() -> None:
    recipe = Recipe.equal(("c", "a"), tuple(reversed(BLOCKS)))
    taken = RoutingDraft.equal(SOURCES, BLOCKS).of(recipe)
    assert row_of(taken, "neck") == {"a": 0.5, "b": 0.0, "c": 0.5, "d": 0.0}
    assert taken.recipe.blocks == BLOCKS


def test_a_tied_draft_becomes_untied_with_a_routed_recipe() -> None:
    recipe = routed(("a", "b"), ("neck", "head"), [(1.0, 0.0), (0.0, 1.0)])
    assert not RoutingDraft.equal(("a", "b"), ("neck", "head"), tied=True).of(recipe).tied


EQUAL = RoutingDraft.equal(SOURCES, BLOCKS)


@pytest.mark.parametrize(
    ("edit", "message"),
    [
        (lambda: RoutingDraft.equal((), BLOCKS), "expected at least one to route"),
        (lambda: RoutingDraft.equal(SOURCES, BLOCKS, gamma=(1.0, 2.0)), "gamma: found"),
        (lambda: EQUAL.weigh("neck", "a", 1.5), "weight of 'a': found 1.5, expected a number from 0 to 1"),
        (lambda: EQUAL.weigh("neck", "a", math.nan), "found nan"),
        (lambda: EQUAL.weigh("nek", "a", 0.5), "unknown block 'nek'.*did you mean 'neck'"),
        (lambda: EQUAL.weigh("neck", "x", 0.5), "unknown source 'x'"),
        (lambda: EQUAL.lock("neck", "a").weigh("head", "a", 0.5), "is locked, unlock it first"),
        (lambda: EQUAL.without("a").weigh("neck", "a", 0.5), "bring it back first"),
        (lambda: EQUAL.without("a").lock("neck", "a"), "bring it back first"),
        (lambda: EQUAL.without("a").without("a"), "is taken out already"),
        (lambda: EQUAL.without("a").without("b").without("c").without("d"), "is the last one left"),
        (lambda: EQUAL.bring_back("a"), "is not taken out"),
        (
            lambda: EQUAL.lock("neck", "b").lock("neck", "c").lock("neck", "d").weigh("neck", "a", 0.5),
            "all others are locked or taken out",
        ),
        (lambda: EQUAL.scale("neck", 2.0), "scale of 'neck': found 2, expected it from 0.25 to 1.75"),
        (lambda: EQUAL.of(Recipe.equal(("a", "e"), BLOCKS)), "recipe: holds the source 'e'"),
        (lambda: EQUAL.of(Recipe.equal(("a",), ("neck",))), "recipe: has the blocks neck"),
        (lambda: EQUAL.of(Recipe.weighted({"a": 0.5}, BLOCKS)), "sum to 0.5, expected 1"),
        (lambda: EQUAL.of(Recipe.weighted({"a": 1.0}, BLOCKS, scale=3.0)), "found 3, expected it from 0.25"),
    ],
)
def test_what_is_refused(edit: Callable[[], object], message: str) -> None:
    with pytest.raises(InputError, match=message):
        edit()


def test_the_edits_of_one_gesture_are_undone_as_one() -> None:
    start = EditHistory(EQUAL)
    dragged = start
    for weight in (0.3, 0.4, 0.5):
        dragged = dragged.edit(dragged.present.weigh("neck", "a", weight), "drag 1")
    assert dragged.undo().present == EQUAL
    second = dragged.edit(dragged.present.weigh("neck", "a", 0.9), "drag 2")
    assert second.undo().present == dragged.present


def test_an_edit_after_undo_forgets_what_was_undone() -> None:
    history = EditHistory(EQUAL).edit(EQUAL.weigh("neck", "a", 0.5)).undo()
    assert history.future
    assert not history.edit(EQUAL.without("b")).future


def test_an_edit_that_changes_nothing_leaves_no_trace() -> None:
    assert EditHistory(EQUAL).edit(EQUAL.reset()) == EditHistory(EQUAL)


def test_a_history_does_not_grow_without_end() -> None:
    history = EditHistory(EQUAL)
    for number in range(LONGEST_HISTORY + 50):
        history = history.edit(EQUAL.weigh("neck", "a", number / 1000))
    assert len(history.past) == LONGEST_HISTORY
