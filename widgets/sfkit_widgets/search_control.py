"""SearchControl: run, pause, one step and stop for a search that runs while the notebook goes on."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

import traitlets

from sfkit.analysis.labels import score_text
from sfkit.errors import InputError
from sfkit.search.live import LiveSearch
from sfkit.search.progress import Phase, Progress
from sfkit_widgets._assets import script, style
from sfkit_widgets._base import SfkitWidget
from sfkit_widgets._commands import command
from sfkit_widgets._publisher import PUBLISHER
from sfkit_widgets._sheet import Sheet
from sfkit_widgets._sources import LiveSource, Watchable, source_of
from sfkit_widgets._still_sheets import control_sheet

QUESTIONS = {"Stage 1": "Stage 1: which sources?", "Stage 2": "Stage 2: how much of each, and where?"}

ALLOWED: dict[Phase, tuple[str, ...]] = {
    Phase.READY: ("run", "step"),
    Phase.RUNNING: ("pause", "stop"),
    Phase.PAUSING: ("run", "stop"),
    Phase.PAUSED: ("run", "step", "stop"),
    Phase.STOPPING: (),
    Phase.STOPPED: ("run", "step"),
    Phase.FINISHED: (),
    Phase.FAILED: ("run", "step"),
    Phase.OPEN: (),
}
"""What can be asked for in each phase."""


class SearchControl(SfkitWidget):
    """Buttons and figures of a search; see :class:`~sfkit.search.live.LiveSearch` for what they do.

    The search runs in a thread of its own: closing the browser, reloading the page or interrupting the
    kernel does it no harm, and other cells run meanwhile.

    Args:
        search: a :class:`~sfkit.search.subset.SubsetSearch` or
            :class:`~sfkit.search.routing.RoutingSearch`, or its live session.
        metric: what the scores are, such as ``bad-1.0``; the scorer's own metric unless given.
        settings: ``theme`` and ``layout``.

    Raises:
        InputError: something that is no search, or an argument of another name.
    """

    _esm = script("search_control.js")
    _css = style("charts.css", "search_control.css")

    progress = traitlets.Dict().tag(sync=True)
    """How far the search is, as it is shown; see :func:`shown_progress`.

    - Type: `dict[str, Any]`, times in seconds
    """

    def __init__(self, search: Watchable, *, metric: str | None = None, **settings: Any) -> None:
        self._source = source_of(search, metric)
        self._shown_error: str | None = None
        now = self._source.progress()
        super().__init__(settings, progress=self._shown(now))
        self.refresh()
        PUBLISHER.follow(self)

    @property
    def live(self) -> LiveSearch:
        """The live session the buttons command.

        Raises:
            InputError: the search runs elsewhere.
        """
        if not isinstance(self._source, LiveSource):
            raise InputError("this search runs elsewhere and is only watched here: stop it where it runs")
        return self._source.live

    @command
    def run(self) -> None:
        """Go on until the search is done, or another command comes."""
        self.live.run()
        self.refresh()

    @command
    def pause(self) -> None:
        """Hold after the evaluation under way."""
        self.live.pause()
        self.refresh()

    @command
    def step(self) -> None:
        """Finish the generation under way, or do the next one, then pause."""
        self.live.step()
        self.refresh()

    @command
    def stop(self) -> None:
        """End after the evaluation under way."""
        self.live.stop()
        self.refresh()

    def wait(self, timeout: float | None = None) -> Progress:
        """Block until the search is paused, stopped, finished or failed; the buttons work meanwhile.

        All widgets that watch searches then show their last state, also in a notebook run without a screen.

        Args:
            timeout: seconds; None waits as long as it takes.

        Returns:
            How far the search is.

        Raises:
            SfkitError: it did not come to that in time.
            InputError: the search runs elsewhere.
        """
        settled = self.live.wait(timeout=timeout)
        PUBLISHER.send_again()
        return settled

    def refresh(self) -> None:
        """Show how far the search is now."""
        with self.reporting():
            now = self._source.progress()
            self.progress = self._shown(now)
            # Only what is new: what a command has said since stays.
            if now.error != self._shown_error:
                self._shown_error = now.error
                self.error = now.error or ""

    def close(self) -> None:
        """Take the widget away; the search goes on."""
        PUBLISHER.leave(self)
        super().close()

    def sheet(self) -> Sheet:
        """How far the search is."""
        return control_sheet(self.progress)

    def _shown(self, now: Progress) -> dict[str, Any]:
        return shown_progress(now, self._source.metric, watched=not isinstance(self._source, LiveSource))


def shown_progress(now: Progress, metric: str | None, *, watched: bool = False) -> dict[str, Any]:
    """What the script draws: ``title``, ``phase``, ``says``, ``done``, ``total``, ``allowed``, ``figures``
    (label and value), ``best`` (score, candidate, sources; None where there is none) and ``watched``.
    """
    counts, best = now.counts, now.best
    figures = [
        ["generation", _generation(now)],
        ["running", _duration(now.running)],
        ["left at most", "" if now.phase is Phase.FINISHED or now.left is None else _duration(now.left)],
        ["evaluations", str(counts.distinct)],
        ["from the store", str(counts.cached)],
        ["failed", str(counts.failed)],
        ["repeated", str(counts.candidates - counts.distinct)],
    ]
    return {
        "title": QUESTIONS[now.stage],
        "phase": now.phase.value,
        "says": _says(now),
        "done": now.candidates,
        "total": now.total,
        "allowed": list(() if watched else ALLOWED[now.phase]),
        "figures": [[label, value or "–"] for label, value in figures],
        "best": None
        if best is None
        else {
            "score": score_text(metric, best.score),
            "candidate": best.number,
            "sources": list(best.subset),
        },
        "watched": watched,
    }


def _generation(now: Progress) -> str:
    if now.generation < 0:
        return ""
    return str(now.generation) if now.generations is None else f"{now.generation} of {now.generations}"


def _says(now: Progress) -> str:
    words = {
        Phase.READY: "Ready. Run goes on to the end; One step does one generation.",
        Phase.RUNNING: "Running. Other cells can run meanwhile.",
        Phase.PAUSING: "Pausing after the evaluation under way.",
        Phase.PAUSED: "Paused.",
        Phase.STOPPING: "Stopping after the evaluation under way.",
        Phase.STOPPED: "Stopped. Run goes on; what was evaluated is not computed again.",
        Phase.FINISHED: f"Finished: {now.reason}.",
        Phase.FAILED: "An error ended it. Mend the cause, then Run tries again.",
        Phase.OPEN: f"Runs elsewhere, or was interrupted. {_written(now.written)}",
    }
    return words[now.phase]


def _written(when: datetime | None) -> str:
    if when is None:
        return ""
    return f"Last heard of at {when.astimezone(UTC):%H:%M:%S} UTC."


def _duration(seconds: float) -> str:
    whole = round(seconds)
    if whole < 60:
        return f"{whole} s"
    if whole < 3600:
        return f"{whole // 60} min {whole % 60} s"
    return f"{whole // 3600} h {whole % 3600 // 60} min"
