"""Who evaluates what next: recipes are cut by images where workers would run out of work.

While there is plenty, a worker takes a whole recipe. At the end of a generation what is left is cut into
ever smaller parts, so that all workers finish together (guided self-scheduling, Polychronopoulos and
Kuck 1987). How the cuts fall, and in which order parts return, changes no result.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

from sfkit.evaluation.engines.worker import Result
from sfkit.evaluation.metrics import ImageErrors
from sfkit.evaluation.outcome import total_known

TRIES = 3  # how often a part is given to a worker that dies over it


@dataclass(frozen=True)
class ImageRange:
    """Images ``start..stop`` of the recipe with that number.

    Attributes:
        number: the recipe's place in what an engine was asked to run.
        start: the first image.
        stop: one past the last image.
        tries: how many workers died over it.
    """

    number: int
    start: int
    stop: int
    tries: int = 0


class Board:
    """The work of one call: what waits, what came back, and which recipes that completes.

    Args:
        recipes: how many there are.
        images: of the benchmark, at least one.
        workers: how many take parts.
    """

    def __init__(self, recipes: int, images: int, workers: int) -> None:
        self._recipes, self._images, self._workers = recipes, images, workers
        self._next = 0  # images handed out so far, recipe after recipe
        self._again: deque[ImageRange] = deque()
        self._results: dict[int, dict[int, Result]] = {n: {} for n in range(recipes)}
        self._end = [images] * recipes  # images from here on no longer matter: one before them failed
        self._complete = 0

    @property
    def complete(self) -> bool:
        """True once every recipe has its result."""
        return self._complete == self._recipes

    def take(self) -> ImageRange | None:
        """The next part to evaluate; None where the rest is under way already.

        A part over which a worker died comes last: what is well gets done while a new worker starts.
        """
        while self._next < self._recipes * self._images:
            part = self._cut()
            if self._matters(part):
                return part
        while self._again:
            part = self._again.popleft()
            if self._matters(part):
                return part
        return None

    def done(self, part: ImageRange, result: Result) -> Iterator[tuple[int, Result]]:
        """Note a part's result; yields its recipe's number and result where that is now complete."""
        if not self._matters(part):
            return
        results = self._results[part.number]
        results[part.start] = result
        if result.failure is not None:
            # What lies behind a failure no longer matters; what lies before may fail earlier still.
            self._end[part.number] = part.start
        whole = self._whole(part.number)
        if whole is not None:
            self._complete += 1
            self._results[part.number] = {}
            # Parts of it that are under way no longer matter.
            self._end[part.number] = 0
            yield part.number, whole

    def died(self, part: ImageRange, how: str) -> Iterator[tuple[int, Result]]:
        """Note that a worker died over a part: it is given out again, until that has been tried enough."""
        if part.tries + 1 < TRIES:
            self._again.append(replace(part, tries=part.tries + 1))
            return
        failure = f"WorkerDied: {TRIES} workers in a row died over it, the last {how}"
        yield from self.done(part, Result((), failure, 0.0))

    def _cut(self) -> ImageRange:
        """The next images in order: an even share of all that is left, within one recipe."""
        number, start = divmod(self._next, self._images)
        left = self._recipes * self._images - self._next
        # Rounded up: a share of no image would be handed out for ever.
        stop = min(self._images, start - (-left // self._workers))
        self._next += stop - start
        return ImageRange(number, start, stop)

    def _matters(self, part: ImageRange) -> bool:
        return part.start < self._end[part.number]

    def _whole(self, number: int) -> Result | None:
        """A recipe's result once its parts reach from the first image to the last, or to a failed one.

        A failure counts when all images before it are known to be well, so that its message is the one a
        single worker would have met first.
        """
        results, reached = self._results[number], 0
        parts: list[Result] = []
        images: list[ImageErrors] = []
        while reached < self._images:
            if reached not in results:
                return None
            result = results[reached]
            parts.append(result)
            if result.failure is not None:
                return Result((), result.failure, *_took(parts))
            images += result.images
            reached += len(result.images)
        return Result(tuple(images), None, *_took(parts))


def _took(parts: Sequence[Result]) -> tuple[float, float | None]:
    """Wall and CPU seconds of all parts together."""
    return sum(part.seconds for part in parts), total_known(part.cpu_seconds for part in parts)
