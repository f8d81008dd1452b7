"""PopulationView: the population of Stage 1, who descends from whom, and what the search settles on."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import traitlets

from sfkit.analysis.drawn_points import drawn_points
from sfkit.analysis.evolution import Evolution, Individual
from sfkit.analysis.labels import metric_label
from sfkit.datasets.metric import Metric
from sfkit.settings import require_whole
from sfkit_widgets._assets import script, style
from sfkit_widgets._model_state import finite, shown_predictions
from sfkit_widgets._sheet import Sheet
from sfkit_widgets._sources import SearchView, Watchable, source_of
from sfkit_widgets._still_sheets import population_sheet

GENERATIONS_DRAWN, INDIVIDUALS_DRAWN = 100, 60
"""At most so many generations, and individuals of each, best first, reach the browser."""


class PopulationView(SearchView):
    """Watches a Stage 1 search, whether a widget, a cell or another process runs it.

    Args:
        search: a :class:`~sfkit.search.subset.SubsetSearch` or its live session.
        archive: how many of the best unique subsets to list, at least 0.
        metric: what the scores are, such as ``bad-1.0``; the scorer's own metric unless given.
        settings: ``theme`` and ``layout``.

    Raises:
        InputError: something that is no Stage 1 search, or an argument of another name.
    """

    _esm = script("population_view.js")
    _css = style("charts.css", "population_view.css")

    evolution = traitlets.Dict().tag(sync=True)
    """All that is drawn, see :func:`shown_evolution`; empty before the first generation.

    - Type: `dict[str, Any]`, scores in the metric's unit, shares and diversity in [0, 1]
    - Default: `{}`
    """

    model = traitlets.Dict().tag(sync=True)
    """What a model foretold of its proposals, and what came; see :func:`shown_predictions`.

    - Type: `dict[str, Any]`, scores in the metric's unit
    - Default: `{}`: no model proposes
    """

    def __init__(
        self, search: Watchable, *, archive: int = 8, metric: str | None = None, **settings: Any
    ) -> None:
        # Before the widget begins: a refused one must not follow the search.
        require_whole("archive", archive, 0)
        self._archive = archive
        super().__init__(source_of(search, metric, kind="subset"), settings)

    def sheet(self) -> Sheet:
        """Scores, shares of sources and the best subsets so far."""
        return population_sheet(self.evolution, self.model)

    def _show(self) -> None:
        found = self._source.evolution()
        self.model = shown_predictions(self._source.predictions())
        proposed = self.model.get("number", ())  # their dots can be clicked
        self.evolution = {} if found is None else shown_evolution(found, self._archive, proposed)


def shown_evolution(found: Evolution, archive: int, also: Iterable[int] = ()) -> dict[str, Any]:
    """What the script draws, as JSON values; None stands for a score that is not finite.

    ``also`` are individuals to tell of that are in no drawn population.

    ``sources``; ``metric``, with its unit; ``generations``, the numbers of those drawn; for each of them
    ``best``, ``median``, ``share``, ``sizes``, ``diversity``, ``populations`` (numbers, best first) and
    ``totals`` (how many individuals there are); ``people`` by number: ``sources`` (positions), ``score``
    (text), ``operators``, ``parents``, ``generation`` (the first drawn one it is in, or None); ``archive``.
    """
    history = found.history
    drawn = drawn_points(history.generations, limit=GENERATIONS_DRAWN).tolist()
    populations = {g: found.populations[g][:INDIVIDUALS_DRAWN] for g in drawn}
    best = found.archive[:archive]
    named = {number for group in populations.values() for number in group} | set(best)
    named |= {number for number in also if number < len(found.individuals)}
    # Rows name parents that are not drawn themselves.
    named |= {parent for number in named for parent in found.individuals[number].parents}
    born = _first_seen(populations.items())
    position = {name: n for n, name in enumerate(history.sources)}
    return {
        "sources": list(history.sources),
        "metric": metric_label(history.metric),
        "generations": drawn,
        "best": finite((history.best[g] for g in drawn), 6),
        "median": finite((history.median[g] for g in drawn), 6),
        "share": [[round(share, 4) for share in history.share[g]] for g in drawn],
        "sizes": [[low, round(mean, 3), high] for low, mean, high in (found.sizes[g] for g in drawn)],
        "diversity": [round(found.diversity[g], 4) for g in drawn],
        "populations": [list(populations[g]) for g in drawn],
        "totals": [len(found.populations[g]) for g in drawn],
        "people": {
            str(number): _person(found.individuals[number], position, history.metric, born.get(number))
            for number in sorted(named)
        },
        "archive": list(best),
    }


def _person(
    one: Individual, position: dict[str, int], metric: str | None, generation: int | None
) -> dict[str, Any]:
    return {
        "sources": [position[name] for name in one.subset],
        "score": _score(one, metric),
        "failed": one.failed,
        "operators": list(one.operators),
        "parents": list(one.parents),
        "generation": generation,
    }


def _score(one: Individual, metric: str | None) -> str:
    """Without the metric's name, which the charts tell: rows are narrow."""
    if one.failed:
        return "failed"
    return f"{one.score:.4g}" if metric is None else f"{one.score:.2f} {Metric.parse(metric).unit}"


def _first_seen(populations: Iterable[tuple[int, Sequence[int]]]) -> dict[int, int]:
    seen: dict[int, int] = {}
    for generation, numbers in populations:
        for number in numbers:
            seen.setdefault(number, generation)
    return seen
