"""watch: one call to see a search, here or elsewhere: its progress and its view."""

from __future__ import annotations

import os
from typing import Any

import ipywidgets
import traitlets

from sfkit.errors import SfkitError, unknown_name
from sfkit.figures import Theme
from sfkit.search import Search
from sfkit.search.following import FollowedJournal
from sfkit.search.live import LiveSearch
from sfkit_widgets._base import SfkitWidget
from sfkit_widgets._publisher import PUBLISHER
from sfkit_widgets._sheet import MARGIN, Sheet
from sfkit_widgets._sources import JournalSource, LiveSource, source_of
from sfkit_widgets._stack import WidgetStack
from sfkit_widgets.population_view import PopulationView
from sfkit_widgets.routing_view import RoutingView
from sfkit_widgets.search_control import SearchControl

WAITING = "Waiting for the first record of a search in {path}."


class SearchWatch(WidgetStack):
    """Progress and view of each stage a journal tells of; a stage appears when it begins.

    Args:
        journal: what is followed.
        metric: what the scores are, for labels.
        theme: of the widgets.
    """

    says = traitlets.Unicode("")
    """What it waits for, or what is wrong with the journal; empty where all is well.

    - Type: `str`
    - Default: `""`
    """

    def __init__(self, journal: FollowedJournal, metric: str | None, theme: str) -> None:
        self._journal, self._metric, self._theme = journal, metric, theme
        note = ipywidgets.Label()
        self._stages: dict[str, tuple[SfkitWidget, ...]] = {}
        super().__init__("Search that runs elsewhere", above=[note])
        traitlets.dlink((self, "says"), (note, "value"))
        self.refresh()
        PUBLISHER.follow(self)

    def refresh(self) -> None:
        """Add the widgets of a stage that has begun."""
        try:
            begun = self._journal.searches()
            new = [kind for kind in begun if kind not in self._stages]
            for kind in new:
                source = JournalSource(self._journal, kind, self._metric)
                self._stages[kind] = stage_widgets(source, self._theme)
            self.says = "" if begun else WAITING.format(path=self._journal.path)
        except SfkitError as error:
            self.says, new = str(error), []
        if new:
            self.arrange(part for kind in begun for part in self._stages[kind])

    def sheet(self) -> Sheet:
        """The stages that have begun, one below the other."""
        sheet = super().sheet()
        if self.says:
            sheet.text(MARGIN, sheet.y + 12, self.says)
            sheet.y += 20
        return sheet

    def close(self) -> None:
        """Take it away, with all in it; the search goes on."""
        PUBLISHER.leave(self)
        super().close()


def stage_widgets(source: LiveSource | JournalSource, theme: str) -> tuple[SfkitWidget, ...]:
    """Progress of a search, and the view that suits its stage."""
    view = PopulationView if source.kind == "subset" else RoutingView
    return SearchControl(source, theme=theme), view(source, theme=theme)


def watch(
    search: Search[Any] | LiveSearch | str | os.PathLike[str],
    *,
    metric: str | None = None,
    theme: str = Theme.AUTO.value,
    **unknown: Any,
) -> WidgetStack:
    """Watch a search of this notebook, or one that runs in another, in a terminal, or on another machine.

    A search given itself can be run, paused, stepped and stopped here. Of a path it only reads, so that it
    cannot disturb the search, and may be called before the search begins.

    Args:
        search: a search or its live session; or the folder of one, its journal, or its store with the journal
            beside it.
        metric: what the scores are, such as ``bad-1.0``, for labels; a search's own unless given.
        theme: ``light``, ``dark``, or ``auto`` to follow the host.
        unknown: none; an argument of another name is refused.

    Raises:
        InputError: no such file or folder, or an argument of another name.
    """
    for name in unknown:
        raise unknown_name("argument of watch", name, ["search", "metric", "theme"])
    if isinstance(search, Search | LiveSearch):
        return WidgetStack("Search", stage_widgets(source_of(search, metric), theme))
    return SearchWatch(FollowedJournal(search), metric, theme)
