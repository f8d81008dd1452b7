"""RoutingView: Stage 2 as it goes; routing weights, module scales, and the search distribution."""

from __future__ import annotations

import math
from typing import Any

import traitlets

from sfkit.analysis.labels import metric_label, score_text
from sfkit.analysis.routings import RoutingTrace
from sfkit.colours import SHARE, colour_at, share_position, text_on
from sfkit.figures.theme import series_style
from sfkit_widgets._assets import script, style
from sfkit_widgets._model_state import finite, shown_predictions
from sfkit_widgets._sheet import Sheet
from sfkit_widgets._sources import SearchView, Watchable, source_of
from sfkit_widgets._still_sheets import routing_sheet

SHADES = 101
"""Steps of the heatmap's colour map that reach the browser."""


class RoutingView(SearchView):
    """Watches a Stage 2 search, whether a widget, a cell or another process runs it.

    Args:
        search: a :class:`~sfkit.search.routing.RoutingSearch` or its live session.
        metric: what the scores are, such as ``bad-1.0``; the scorer's own metric unless given.
        settings: ``theme`` and ``layout``.

    Raises:
        InputError: something that is no Stage 2 search, or an argument of another name.
    """

    _esm = script("routing_view.js")
    _css = style("charts.css", "routing_view.css")

    trace = traitlets.Dict().tag(sync=True)
    """All that is drawn, see :func:`shown_trace`; empty before the first evaluation.

    - Type: `dict[str, Any]`, scores in the metric's unit, weights in [0, 1], scales as factors
    - Default: `{}`
    """

    model = traitlets.Dict().tag(sync=True)
    """What a model foretold of its proposals, and what came; see :func:`shown_predictions`.

    - Type: `dict[str, Any]`, scores in the metric's unit
    - Default: `{}`: no model proposes
    """

    def __init__(self, search: Watchable, *, metric: str | None = None, **settings: Any) -> None:
        super().__init__(source_of(search, metric, kind="routing"), settings)

    def sheet(self) -> Sheet:
        """The best recipe so far, and scores by evaluation."""
        return routing_sheet(self.trace, self.model)

    def _show(self) -> None:
        found = self._source.trace()
        self.trace = {} if found is None else shown_trace(found)
        self.model = shown_predictions(self._source.predictions())


def shown_trace(trace: RoutingTrace) -> dict[str, Any]:
    """What the script draws, as JSON values; None stands for a score that is not finite.

    ``sources``, ``blocks``, ``gamma``, ``metric`` with its unit, ``tied``, ``by_model``; ``drawn``, the
    numbers of at most 400 evaluations, and for each of them ``score``, ``text``, ``weights`` (rows of the
    blocks; one row where they are tied), ``scales`` and ``incumbent`` (position in ``drawn`` of the best so
    far, or None);
    ``iterations``, numbers of evaluations that begin one, with ``sigma`` and ``axes``; ``best`` (position in
    ``drawn``), ``colours`` of the sources' lines, ``shades`` of the heatmap as [background, text].
    """
    drawn = trace.drawn().tolist()
    place = {number: n for n, number in enumerate(drawn)}
    rows = 1 if trace.tied else len(trace.blocks)
    first = trace.iterations().tolist()
    return {
        "sources": list(trace.sources),
        "blocks": list(trace.blocks),
        "gamma": list(trace.gamma),
        "metric": metric_label(trace.metric),
        "tied": trace.tied,
        "by_model": trace.by_model,
        "drawn": drawn,
        "evaluations": len(trace),
        "score": finite(trace.score[drawn].tolist()),
        "text": [_text(trace, number) for number in drawn],
        "weights": trace.weights[drawn][:, :rows].round(4).tolist(),
        "scales": trace.scales[drawn].round(4).tolist(),
        # Every new incumbent is drawn unless they are too many; then the line holds the one before.
        "incumbent": _held([place.get(int(trace.incumbent[number])) for number in drawn]),
        "iterations": first,
        "sigma": finite(trace.sigma[first].tolist()),
        "axes": [finite(row) for row in trace.axes[first].T.tolist()],
        "best": place.get(trace.best),
        "colours": [series_style(e) for e in range(len(trace.sources))],
        "shades": [_shade(n / (SHADES - 1)) for n in range(SHADES)],
    }


def _text(trace: RoutingTrace, number: int) -> str:
    score = float(trace.score[number])
    return score_text(trace.metric, score) if math.isfinite(score) else "failed"


def _held(places: list[int | None]) -> list[int | None]:
    held: int | None = None
    kept = []
    for place in places:
        held = held if place is None else place
        kept.append(held)
    return kept


def _shade(position: float) -> list[str]:
    colour = colour_at(SHARE, share_position(position))
    return [f"rgb({colour[0]} {colour[1]} {colour[2]})", text_on(colour)]
