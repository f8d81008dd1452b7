"""The bench a routing is edited on: drafts, the pair they are looked at on, pins to compare with, scores."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from sfkit.analysis.previews import PairLook, PairPreview, held_score
from sfkit.analysis.routings import RoutingTrace, routing_trace, watched_routing
from sfkit.datasets.benchmark import Benchmark
from sfkit.editing import GAMMA, EditHistory, RoutingDraft, SeenByHand, mark_hand_edit, seen_by_hand
from sfkit.errors import InputError, ensure_known
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.separation import pairs_in_common
from sfkit.merging.recipe import Recipe, routed
from sfkit.search.journal import JournalledSearch, read_journal
from sfkit.search.routing import RoutingSearch

Trials = RoutingSearch | RoutingTrace | str | Path
"""A Stage 2 search that runs here, its record, or the journal of one that runs elsewhere."""

PINS = ("A", "B")


@dataclass(frozen=True, eq=False)
class Pin:
    """A recipe kept to compare with, and how it looks on the pair that is shown."""

    recipe: Recipe
    look: PairLook


class RoutingWorkbench:
    """One routing under edit, and all that is asked of it; the widget beside it only translates.

    One thread edits at a time; :meth:`score` may run in another.

    Attributes:
        evaluator: gives pool, benchmark, metric, device and the store scores go to.
        history: the draft, and where undo and redo lead.
        preview: the pair and the network it is shown to.
        look: what was seen of the recipe last.
        trace: the trials of the search, None where there are none.
        pins: "A" or "B" -> recipe and look.
        shared: benchmark a report tests on -> ids of its pairs that scores here would see.
    """

    def __init__(
        self,
        evaluator: Evaluator,
        subset: Iterable[str] | None = None,
        *,
        search: Trials | None = None,
        recipe: Recipe | None = None,
        tied: bool | None = None,
        gamma: tuple[float, float] | None = None,
        tested_on: Sequence[Benchmark] = (),
        pair: str | None = None,
    ) -> None:
        """Start from ``recipe``, else the best trial of ``search``, else Stage 1's equal weights.

        Args:
            evaluator: see above.
            subset: the sources to route among; the search's unless given, else all of the pool.
            search: whose trials can be taken on.
            recipe: what to start from.
            tied: one row of weights for all blocks; as the search has it unless given, else True.
            gamma: lowest and highest module scale; the search's unless given, else Stage 2's default.
            tested_on: benchmarks that a report will test on.
            pair: id of the pair to look at; the first unless given.

        Raises:
            InputError: an unknown source or pair, a search or recipe over other sources or blocks, or a
                recipe of other networks.
        """
        pool = evaluator.pool
        self.evaluator = evaluator
        self._search = search
        self._tested_on = tuple(tested_on)
        self.trace = _trace(search, evaluator.metric.name)
        held_tied, held_gamma = _bounds(search, self.trace)
        if subset is None:
            subset = search.sources if isinstance(search, RoutingSearch | RoutingTrace) else None
        if subset is None:
            subset = self.trace.sources if self.trace is not None else pool.names
        self._equal = RoutingDraft.equal(
            pool.subset(subset),
            pool.blocks,
            tied=held_tied if tied is None else tied,
            gamma=held_gamma if gamma is None else gamma,
        )
        self._check_trace()
        self.shared: Mapping[str, tuple[str, ...]] = pairs_in_common([evaluator.benchmark], self._tested_on)
        # Where every trial failed there is no best, and equal weights are a beginning.
        if recipe is None and self.trace is not None and self.trace.best >= 0:
            recipe = self.trial(self.trace.best)
        self.history = EditHistory(self._equal)
        if recipe is not None:
            self.history = EditHistory(self.taken(recipe))
        self.preview = PairPreview(evaluator, pair)
        self.pins: dict[str, Pin] = {}
        self.look = self.preview.look(self.recipe)

    @property
    def draft(self) -> RoutingDraft:
        """What is being edited."""
        return self.history.present

    def taken(self, recipe: Recipe) -> RoutingDraft:
        """A draft of another recipe.

        Raises:
            InputError: as :meth:`~sfkit.editing.drafts.RoutingDraft.of`, or one of its names stands for
                another network here.
        """
        draft = self.draft.of(recipe)
        self.evaluator.pool.check_networks(recipe)
        return draft

    @property
    def recipe(self) -> Recipe:
        """The draft's recipe."""
        return self.history.present.recipe

    def trial(self, number: int) -> Recipe:
        """What evaluation ``number`` of the search scored.

        Raises:
            InputError: there is no search, or it has no such evaluation.
        """
        if self.trace is None:
            raise InputError("trial: found no search that has scored anything, open with search=...")
        if not 0 <= number < len(self.trace):
            raise InputError(
                f"trial: found {number}, expected 0 to {len(self.trace) - 1}, those the search has made"
            )
        weights, scales = self.trace.weights[number].tolist(), self.trace.scales[number].tolist()
        return routed(self.trace.sources, self.trace.blocks, weights, scales)

    def refresh(self) -> None:
        """Read the search's trials anew: it may have made more."""
        self.trace = _trace(self._search, self.evaluator.metric.name)
        self._check_trace()

    def choose_pair(self, pair: str) -> None:
        """Look at another pair, with the recipe and with what is pinned.

        Raises:
            InputError: no such pair.
        """
        self.preview.choose(pair)
        self.look = self.preview.look(self.recipe)
        # Recipes are compared on one pair, so that pins follow.
        self.pins = {name: Pin(p.recipe, self.preview.look(p.recipe)) for name, p in self.pins.items()}

    def pin(self, name: str) -> None:
        """Keep the recipe as A or B.

        Raises:
            InputError: another name.
        """
        ensure_known("pin", name, PINS)
        # A pin is compared with later at full size.
        if self.look.reduction > 1:
            self.look = self.preview.look(self.recipe)
        self.pins = {**self.pins, name: Pin(self.recipe, self.look)}

    def unpin(self, name: str) -> None:
        """Let A or B go."""
        self.pins = {kept: pin for kept, pin in self.pins.items() if kept != name}

    def known_score(self, recipe: Recipe) -> float | None:
        """The benchmark score the store holds; ``inf`` where it failed, None where it is not known."""
        return held_score(self.evaluator, recipe)

    def score(self, recipe: Recipe) -> float:
        """Score a recipe on the whole benchmark; what is new is stored, and marked as edited by hand.

        The evaluator's own network is not touched, so that a search may go on with it.
        """
        # A view with an engine of its own: the network of the evaluator is not touched.
        own = self.evaluator.with_store(self.evaluator.store)
        own.release()
        (evaluation,) = own.evaluate([recipe])
        if not evaluation.cached:
            mark_hand_edit(own.store, evaluation.key, own.benchmark)
        return own.outcome(evaluation).score

    def seen_by_hand(self) -> tuple[SeenByHand, ...]:
        """Benchmarks a report tests on that hand edits, of this store, were scored on already."""
        return seen_by_hand(self.evaluator.store, self._tested_on)

    def _check_trace(self) -> None:
        if self.trace is None:
            return
        own = self._equal
        for what, found, expected in (
            ("sources", self.trace.sources, own.sources),
            ("blocks", self.trace.blocks, own.blocks),
        ):
            if not set(found) <= set(expected):
                raise InputError(
                    f"search: is over the {what} {', '.join(found)}, expected some of {', '.join(expected)}: "
                    "open it with the search's own subset and pool"
                )


def _trace(search: Trials | None, metric: str) -> RoutingTrace | None:
    """The record of a search; None where there is none, or none of its evaluations is finished."""
    if search is None or isinstance(search, RoutingTrace):
        return search
    if isinstance(search, RoutingSearch):
        return routing_trace(search, metric=metric) if search.candidates else None
    records = read_journal(search)
    found = JournalledSearch.find(records, RoutingSearch.kind)
    return watched_routing(records, metric=metric) if found and found.generations else None


def _bounds(search: Trials | None, trace: RoutingTrace | None) -> tuple[bool, tuple[float, float]]:
    """Whether the search ties its rows, and its range of scales; Stage 2's defaults without one."""
    if isinstance(search, RoutingSearch):
        return search.settings.tied, search.settings.gamma
    return (True, GAMMA) if trace is None else (trace.tied, trace.gamma)
