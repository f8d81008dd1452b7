"""Who evaluates what next, without workers: any order of answers and deaths gives what one worker gives."""

from __future__ import annotations

import heapq

import pytest
from hypothesis import given
from hypothesis import strategies as st

from sfkit.evaluation.engines.schedule import TRIES, Board, ImageRange
from sfkit.evaluation.engines.worker import Result
from sfkit.evaluation.metrics import ImageErrors

COUNTS = {
    "recipes": st.integers(0, 7),
    "images": st.integers(1, 9),
    "workers": st.integers(1, 6),
}


def image(recipe: int, number: int) -> ImageErrors:
    """A record that says which image of which recipe it is."""
    return ImageErrors(f"{recipe}/{number}", (), 0, {})


def evaluated(part: ImageRange, broken: dict[int, int]) -> Result:
    """What a worker answers: it stops at the first image its recipe is broken on."""
    for number in range(part.start, part.stop):
        if number >= broken.get(part.number, part.stop):
            return Result((), f"recipe {part.number} broke on image {number}", 1.0)
    return Result(tuple(image(part.number, n) for n in range(part.start, part.stop)), None, 1.0)


def alone(recipe: int, images: int, broken: dict[int, int]) -> tuple[tuple[ImageErrors, ...], str | None]:
    """What one worker would hear of a whole recipe."""
    if recipe in broken:
        return (), f"recipe {recipe} broke on image {broken[recipe]}"
    return tuple(image(recipe, n) for n in range(images)), None


@given(**COUNTS, data=st.data())
def test_the_order_of_answers_and_deaths_changes_nothing(
    recipes: int, images: int, workers: int, data: st.DataObject
) -> None:
    broken = data.draw(st.dictionaries(st.integers(0, 6), st.integers(0, images - 1)))
    board = Board(recipes, images, workers)
    under_way: list[ImageRange] = []
    results: dict[int, Result] = {}
    while not board.complete:
        while len(under_way) < workers and (part := board.take()) is not None:
            under_way.append(part)
        assert under_way, "work is left and nobody has it"
        part = under_way.pop(data.draw(st.integers(0, len(under_way) - 1)))
        dies = part.tries < TRIES - 1 and data.draw(st.booleans())
        finished = board.died(part, "fell over") if dies else board.done(part, evaluated(part, broken))
        for number, result in finished:
            assert number not in results, "a recipe completes once"
            results[number] = result
    assert sorted(results) == list(range(recipes))
    for number, result in results.items():
        assert (result.images, result.failure) == alone(number, images, broken)


@given(**COUNTS, data=st.data())
def test_a_part_over_which_every_worker_dies_fails_its_recipe_and_no_other(
    recipes: int, images: int, workers: int, data: st.DataObject
) -> None:
    deadly = data.draw(st.sets(st.integers(0, 6)))
    board = Board(recipes, images, workers)
    deaths: dict[tuple[int, int], int] = {}
    results: dict[int, Result] = {}
    while not board.complete:
        part = board.take()
        assert part is not None
        if part.number in deadly:
            deaths[part.number, part.start] = deaths.get((part.number, part.start), 0) + 1
            results |= dict(board.died(part, "was killed by signal 9 (Killed)"))
        else:
            results |= dict(board.done(part, evaluated(part, {})))
    assert max(deaths.values(), default=0) <= TRIES
    for number, result in results.items():
        if number in deadly:
            last = "the last was killed by signal 9 (Killed)"
            assert result == Result((), f"WorkerDied: 3 workers in a row died over it, {last}", 0.0)
            assert deaths[number, 0] == TRIES
        else:
            assert result.images == alone(number, images, {})[0]


@given(**COUNTS)
def test_without_deaths_each_image_is_evaluated_once_and_workers_finish_together(
    recipes: int, images: int, workers: int
) -> None:
    """With images of equal length, no worker is idle for longer than one of them."""
    board = Board(recipes, images, workers)
    clock: list[tuple[int, int, ImageRange | None]] = [(0, worker, None) for worker in range(workers)]
    seen, end = [], 0
    while clock:
        now, worker, part = heapq.heappop(clock)
        end = max(end, now)
        if part is not None:
            list(board.done(part, evaluated(part, {})))
        part = board.take()
        if part is not None:
            seen += [(part.number, n) for n in range(part.start, part.stop)]
            heapq.heappush(clock, (now + part.stop - part.start, worker, part))
    assert board.complete
    assert sorted(seen) == [(r, n) for r in range(recipes) for n in range(images)]
    assert end <= -(-recipes * images // workers) + 1


def test_recipes_stay_whole_while_there_are_many_and_are_cut_at_the_end() -> None:
    board = Board(recipes=6, images=10, workers=2)
    sizes = []
    while (part := board.take()) is not None:
        sizes.append(part.stop - part.start)
    assert sizes == [10, 10, 10, 10, 10, 5, 3, 1, 1]


def test_one_worker_gets_whole_recipes() -> None:
    board = Board(recipes=3, images=10, workers=1)
    assert [board.take() for _ in range(4)] == [
        ImageRange(0, 0, 10),
        ImageRange(1, 0, 10),
        ImageRange(2, 0, 10),
        None,
    ]


def test_images_behind_a_failure_are_left_out() -> None:
    board = Board(recipes=1, images=8, workers=4)
    first, second = board.take(), board.take()
    assert first == ImageRange(0, 0, 2)
    assert second == ImageRange(0, 2, 4)
    assert list(board.done(second, Result((), "broke", 1.0))) == [], "the first images may fail before it"
    assert board.take() is None
    good = Result((image(0, 0), image(0, 1)), None, 1.0)
    assert list(board.done(first, good)) == [(0, Result((), "broke", 2.0))]
    assert board.complete


@pytest.mark.parametrize(("second", "total"), [(0.25, 1.0), (None, None)])
def test_workers_that_share_images_add_up_what_they_took(second: float | None, total: float | None) -> None:
    board = Board(recipes=1, images=2, workers=2)
    one, other = board.take(), board.take()
    assert one is not None
    assert other is not None
    assert list(board.done(one, Result((image(0, 0),), None, 2.0, 0.75))) == []
    ((_, whole),) = board.done(other, Result((image(0, 1),), None, 3.0, second))
    assert (whole.seconds, whole.cpu_seconds) == (5.0, total), "a part of a sum would mislead"
