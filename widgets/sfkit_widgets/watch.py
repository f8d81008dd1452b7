"""watch: follow a search that runs elsewhere, by reading what it writes."""

from __future__ import annotations

import os
from typing import Any

import ipywidgets
import traitlets

from sfkit.errors import SfkitError, unknown_name
from sfkit.figures import Theme
from sfkit.search.following import FollowedJournal
from sfkit_widgets._base import SfkitWidget
from sfkit_widgets._publisher import PUBLISHER
from sfkit_widgets._sheet import MARGIN, Sheet
from sfkit_widgets._sources import JournalSource
from sfkit_widgets._still import STILL, Still, publish
from sfkit_widgets.population_view import PopulationView
from sfkit_widgets.routing_view import RoutingView
from sfkit_widgets.search_control import SearchControl

WAITING = "Waiting for the first record of a search in {path}."


class SearchWatch(ipywidgets.VBox):  # type: ignore[misc]  # ipywidgets has no types
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
        self._note = ipywidgets.Label()
        self._stages: dict[str, tuple[SfkitWidget, ...]] = {}
        super().__init__(children=(self._note,))
        self._still = Still(self.model_id, self.sheet)
        traitlets.dlink((self, "says"), (self._note, "value"))
        self.refresh()
        PUBLISHER.follow(self)

    def refresh(self) -> None:
        """Add the widgets of a stage that has begun."""
        try:
            begun = self._journal.searches()
            new = [kind for kind in begun if kind not in self._stages]
            for kind in new:
                self._stages[kind] = self._widgets(kind)
            self.says = "" if begun else WAITING.format(path=self._journal.path)
        except SfkitError as error:
            self.says, new = str(error), []
        if new:
            parts = [part for kind in begun for part in self._stages[kind]]
            self.children = (self._note, *parts)

    def sheet(self) -> Sheet:
        """The stages that have begun, one below the other, for notebooks that are opened without a kernel."""
        sheet = Sheet("Search that runs elsewhere")
        if self.says:
            sheet.text(MARGIN, sheet.y + 12, self.says)
            sheet.y += 20
        for part in (part for parts in self._stages.values() for part in parts):
            sheet.add(part.sheet())
        return sheet

    def _ipython_display_(self, **_: object) -> None:
        """Two outputs: the widgets, and their still."""
        publish(self._repr_mimebundle_())
        self._still.show()

    def close(self) -> None:
        """Take it away, with all in it; the search goes on."""
        self._still.close()
        PUBLISHER.leave(self)
        for child in self.children:
            child.close()
        super().close()

    def _widgets(self, kind: str) -> tuple[SfkitWidget, ...]:
        source = JournalSource(self._journal, kind, self._metric)
        view = PopulationView if kind == "subset" else RoutingView
        made = SearchControl(source, theme=self._theme), view(source, theme=self._theme)
        for part in made:
            part.still = f"{STILL}-{self.model_id}"  # they hide the one picture of all
            part.observe(lambda _: self._still.changed())
        return made


def watch(
    path: str | os.PathLike[str], *, metric: str | None = None, theme: str = Theme.AUTO.value, **unknown: Any
) -> SearchWatch:
    """Follow a search that runs elsewhere: in another notebook, a terminal, or on another machine.

    Only reads, so that it cannot disturb the search; it may be called before the search begins.

    Args:
        path: the search's folder, its journal, or its store with the journal beside it.
        metric: what the scores are, such as ``bad-1.0``, for labels.
        theme: ``light``, ``dark``, or ``auto`` to follow the host.
        unknown: none; an argument of another name is refused.

    Raises:
        InputError: no such file or folder, or an argument of another name.
    """
    for name in unknown:
        raise unknown_name("argument of watch", name, ["path", "metric", "theme"])
    return SearchWatch(FollowedJournal(path), metric, theme)
