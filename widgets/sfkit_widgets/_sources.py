"""Where the search widgets get what they show: a search of this process, or the journal of another."""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, TypeAlias

from sfkit.analysis.evolution import Evolution, evolution, watched_evolution
from sfkit.analysis.predictions import Predictions, predictions, watched_predictions
from sfkit.analysis.routings import RoutingTrace, routing_trace, watched_routing
from sfkit.errors import InputError
from sfkit.search.base import Search
from sfkit.search.following import FollowedJournal
from sfkit.search.live import LiveSearch
from sfkit.search.progress import Progress, watched_progress
from sfkit.search.routing import RoutingSearch
from sfkit.search.subset import SubsetSearch
from sfkit_widgets._base import SfkitWidget
from sfkit_widgets._publisher import PUBLISHER


class LiveSource:
    """A search of this process."""

    def __init__(self, live: LiveSearch, metric: str | None = None) -> None:
        self.live = live
        self.kind = live.search.kind
        self.metric = metric or live.metric

    def progress(self) -> Progress:
        """How far it is."""
        return self.live.progress()

    def version(self) -> object:
        """The search's frozen state."""
        return self.live.search.state

    def evolution(self) -> Evolution | None:
        """Stage 1 so far; None before its first generation."""
        search = self.live.search
        if not isinstance(search, SubsetSearch) or not search.state.populations:
            return None
        return evolution(search, metric=self.metric)

    def trace(self) -> RoutingTrace | None:
        """Stage 2 so far; None before its first evaluation."""
        search = self.live.search
        if not isinstance(search, RoutingSearch) or not search.state.candidates:
            return None
        return routing_trace(search, metric=self.metric)

    def predictions(self) -> Predictions | None:
        """What a model foretold so far."""
        return predictions(self.live.search, metric=self.metric)


class JournalSource:
    """A search that runs elsewhere; one of a journal's two stages."""

    def __init__(self, journal: FollowedJournal, kind: str, metric: str | None = None) -> None:
        self.journal = journal
        self.kind = kind
        self.metric = metric

    def progress(self) -> Progress:
        """How far it is."""
        return watched_progress(self.journal.records(), self.kind)

    def version(self) -> object:
        """The records so far."""
        return self.journal.records()

    def evolution(self) -> Evolution | None:
        """Stage 1 so far; None before its first generation."""
        begun = self.kind == SubsetSearch.kind and self._begun()
        return watched_evolution(self.journal.records(), metric=self.metric) if begun else None

    def trace(self) -> RoutingTrace | None:
        """Stage 2 so far; None before its first evaluation."""
        begun = self.kind == RoutingSearch.kind and self._begun()
        return watched_routing(self.journal.records(), metric=self.metric) if begun else None

    def predictions(self) -> Predictions | None:
        """What a model foretold so far; None before the search has begun."""
        begun = self._begun()
        return watched_predictions(self.journal.records(), self.kind, metric=self.metric) if begun else None

    def _begun(self) -> bool:
        return watched_progress(self.journal.records(), self.kind).generation >= 0


Watchable: TypeAlias = Search[Any] | LiveSearch | LiveSource | JournalSource
"""What a search widget can be made for."""


def source_of(
    search: Watchable, metric: str | None, *, kind: str | None = None
) -> LiveSource | JournalSource:
    """The source of what was given.

    Args:
        search: a search, its live session, or a source itself.
        metric: what the scores are, for labels; the scorer's own unless given.
        kind: the stage the widget is for; None for both.

    Raises:
        InputError: something else, or a search of the other stage.
    """
    if isinstance(search, LiveSource | JournalSource):
        found: LiveSource | JournalSource = search
    elif isinstance(search, Search | LiveSearch):
        found = LiveSource(search if isinstance(search, LiveSearch) else LiveSearch.of(search), metric)
    else:
        raise InputError(
            f"search: found a {type(search).__name__}, expected a SubsetSearch, RoutingSearch or LiveSearch"
        )
    if kind is not None and found.kind != kind:
        other = {"subset": "PopulationView", "routing": "RoutingView"}[found.kind]
        raise InputError(f"search: found a {found.kind} search, expected a {kind} search: use {other}")
    return found


class SearchView(SfkitWidget):
    """A widget that shows what a search has found so far, and brings it up to date as the search goes on."""

    def __init__(self, source: LiveSource | JournalSource, settings: dict[str, Any]) -> None:
        self._source = source
        self._version: object = None
        super().__init__(settings)
        self.refresh()
        PUBLISHER.follow(self)

    @abstractmethod
    def _show(self) -> None:
        """Bring the traits up to date with the source."""

    def refresh(self) -> None:
        """Show what is new since the last call, where there is something."""
        with self.reporting():
            version = self._source.version()
            # Versions are frozen: another one is another object, however large it is.
            if version is not self._version:
                self._show()
                self._version = version

    def close(self) -> None:
        """Take the widget away; the search goes on."""
        PUBLISHER.leave(self)
        super().close()
