"""RoutingInspector: edit a routing by hand and see at once what it does to a disparity map."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

from sfkit.analysis.previews import PairLook
from sfkit.analysis.workbench import RoutingWorkbench, Trials
from sfkit.datasets.benchmark import Benchmark
from sfkit.editing import EditHistory, RoutingDraft
from sfkit.evaluation.evaluator import Evaluator
from sfkit.merging.recipe import Recipe
from sfkit.merging.saving import save_merged
from sfkit_widgets import _routing_state as state
from sfkit_widgets._assets import script, style
from sfkit_widgets._commands import command
from sfkit_widgets._latest import Latest
from sfkit_widgets._pictures import share_colours
from sfkit_widgets._routing_traits import RoutingTraits
from sfkit_widgets._sheet import Sheet
from sfkit_widgets._still_sheets import inspector_sheet

SETTLE_SECONDS = 0.15
"""After a reduced look the full one waits this long for the next edit: it would hold a drag up."""


class RoutingInspector(RoutingTraits):
    """Routing weights, module scales, and what the merged network sees, under one's hands.

    The weights are a grid of blocks and sources: drag a cell or type into it, and its row stays on the
    simplex. Beside it are the chosen pair, the disparity of the edited merge, its error map and its scores.
    ``inspector.recipe`` is the recipe as it stands; a Stage 2 search starts from it with
    ``RoutingSearch(..., start=inspector.recipe)``.

    Example::

        inspector = RoutingInspector(scorer, which.subset, search=stage2)
        inspector
    """

    _esm = script("routing_inspector.js")
    _css = style("routing_inspector.css", "inspector_pictures.css")

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
        **settings: Any,
    ) -> None:
        """Open on ``recipe``, else on the best trial of ``search``, else on Stage 1's equal weights.

        Args:
            evaluator: gives pool, benchmark, metric, device and the store that scores go to.
            subset: the sources to route among; those of the search unless given, else all of the pool.
            search: whose trials can be scrubbed: a Stage 2 search, its record, or the path of its journal.
            recipe: what to show first.
            tied: one row of weights for all blocks; as the search has it unless given, else True.
            gamma: lowest and highest module scale; the search's unless given, else (0.25, 1.75).
            tested_on: benchmarks a report will test on, to flag edits that are scored on pairs of theirs.
            pair: id of the pair to show; the first unless given.
            settings: ``theme``, ``layout``.

        Raises:
            InputError: an unknown source, pair or setting, a search or recipe over other sources or
                blocks, or a recipe of other networks.
        """
        self._looks, self._scores = Latest(SETTLE_SECONDS), Latest()
        self._scoring: Recipe | None = None
        self.refuse_unknown(settings, also=("search", "recipe", "tied", "gamma", "tested_on", "pair"))
        bench = self._bench = RoutingWorkbench(
            evaluator,
            subset,
            search=search,
            recipe=recipe,
            tied=tied,
            gamma=gamma,
            tested_on=tested_on,
            pair=pair,
        )
        best = bench.trace.best if bench.trace is not None and recipe is None else -1
        super().__init__(
            settings,
            blocks=list(bench.draft.blocks),
            sources=list(bench.draft.sources),
            gamma=list(bench.draft.gamma),
            metric=state.metric_state(evaluator),
            pairs=list(evaluator.benchmark.ids),
            shades=share_colours(),
            trials=state.trials_state(bench.trace),
            trial=best if best >= 0 else None,
            scores=state.benchmark_state(bench, None),
            flag=state.flag_text(bench, bench.seen_by_hand()),
            **state.draft_state(bench.history, evaluator.pool),
            **state.pair_state(bench.preview),
            **state.look_state(bench.look, bench.preview),
        )

    def sheet(self) -> Sheet:
        """Weights, scales, pictures and scores as they stand."""
        return inspector_sheet(self)

    @property
    def recipe(self) -> Recipe:
        """The recipe as it stands; assign another to load it, as an edit that can be undone.

        Raises:
            InputError: on assignment, a recipe over other sources or blocks, or out of range.
        """
        return self._bench.recipe

    @recipe.setter
    def recipe(self, recipe: Recipe) -> None:
        with self.changing():
            self._edit(self._bench.taken(recipe))

    @property
    def pair_score(self) -> float:
        """The recipe's score on the pair on show, in the metric's unit; ``inf`` where it is not finite."""
        with self.changing():
            score = self._bench.look.score
            if score is None:  # only a reduced look so far
                look = self._bench.preview.look(self.recipe)
                self._draw(look)
                score = look.score
            return math.inf if score is None else score

    def close(self) -> None:
        """Forget what is not begun, and leave the page."""
        self._looks.cancel()
        self._scores.cancel()
        super().close()

    def settle(self) -> None:
        """Wait until pictures are at full size and scores that were asked for are there."""
        self._looks.join()
        self._scores.join()

    @command
    def weigh(self, block: str, source: str, weight: float, gesture: str | None = None) -> None:
        """Set one routing weight; the rest of its row follows."""
        self._edit(self._bench.draft.weigh(block, source, weight), gesture)

    @command
    def scale(self, block: str, value: float, gesture: str | None = None) -> None:
        """Set one module scale."""
        self._edit(self._bench.draft.scale(block, value), gesture)

    @command
    def lock(self, block: str, source: str, locked: bool) -> None:
        """Keep a weight as it is while others move, or let it go."""
        self._edit(self._bench.draft.lock(block, source, locked=locked))

    @command
    def remove(self, source: str) -> None:
        """What if this source were gone?"""
        self._edit(self._bench.draft.without(source))

    @command
    def bring_back(self, source: str) -> None:
        """Let a removed source take part again, with what it weighed."""
        self._edit(self._bench.draft.bring_back(source))

    @command
    def tie(self, tied: bool) -> None:
        """One row of weights for all blocks, or one for each."""
        self._edit(self._bench.draft.tie(tied=tied))

    @command
    def reset(self) -> None:
        """Back to Stage 1's equal weights and scales of 1."""
        self._edit(self._bench.draft.reset())

    @command
    def undo(self) -> None:
        """Take the last edit back."""
        self._go(self._bench.history.undo())

    @command
    def redo(self) -> None:
        """Make an edit again that was undone."""
        self._go(self._bench.history.redo())

    @command
    def load(self, text: str) -> None:
        """Take on a recipe from its JSON text."""
        self._edit(self._bench.taken(Recipe.from_json(text, where="the pasted text")))

    @command
    def scrub(self, trial: int, gesture: str | None = None) -> None:
        """Take on what one trial of the search scored."""
        self._edit(self._bench.draft.of(self._bench.trial(trial)), gesture)
        self.trial = trial

    @command
    def refresh(self) -> None:
        """Read the search's trials anew: it may have made more."""
        self._bench.refresh()
        self.trials = state.trials_state(self._bench.trace)

    @command
    def show_pair(self, pair: str) -> None:
        """Look at another pair of the benchmark."""
        self._looks.cancel()
        self._bench.choose_pair(pair)
        self._set(**state.pair_state(self._bench.preview))
        self._draw(self._bench.look)
        self._show_pins()

    @command
    def pin(self, name: str) -> None:
        """Keep the recipe as A or B, to compare with."""
        self._bench.pin(name)
        self._draw(self._bench.look)
        self._show_pins()

    @command
    def unpin(self, name: str) -> None:
        """Let A or B go."""
        self._bench.unpin(name)
        self._show_pins()

    @command
    def score(self) -> None:
        """Score the recipe on the whole benchmark, beside everything else; the store keeps it."""
        recipe = self._scoring = self.recipe
        self._show_scores()
        self._scores.submit(lambda: self._score(recipe))

    @command
    def save(self, path: str | Path) -> None:
        """Write the merged network with its recipe; a file that exists is left alone.

        Raises:
            InputError: the target is refused.
        """
        self.saved = str(save_merged(self._bench.evaluator.pool, self.recipe, path))

    def _edit(self, draft: RoutingDraft, gesture: str | None = None) -> None:
        self._go(self._bench.history.edit(draft, gesture))

    def _go(self, history: EditHistory) -> None:
        """Show another draft: its numbers first, so that a network that fails hides none of them."""
        bench = self._bench
        moved = history.present.recipe != bench.recipe
        bench.history = history
        self._set(**state.draft_state(history, bench.evaluator.pool))
        if moved:
            self._set(trial=None, saved="")
            self._show_scores()
            self._draw(bench.preview.quick_look(bench.recipe))

    def _draw(self, look: PairLook) -> None:
        self._bench.look = look
        self._set(**state.look_state(look, self._bench.preview))
        if look.reduction > 1:
            self._looks.submit(self._look_fully)

    def _look_fully(self) -> None:
        """The full size after a reduced look, unless the recipe has changed meanwhile."""
        recipe = self.recipe
        try:
            look = self._bench.preview.look(recipe)
        except Exception as error:  # whatever a network raises
            self.report(error)
            return
        with self.reporting():
            if recipe == self.recipe:
                self._draw(look)

    def _score(self, recipe: Recipe) -> None:
        """In a thread of its own, so that editing goes on."""
        try:
            self._bench.score(recipe)
        except Exception as error:  # whatever a network or a disk raises
            self.report(error)
        with self.reporting():
            self._scoring = None
            self._show_scores()
            self.flag = state.flag_text(self._bench, self._bench.seen_by_hand())

    def _show_pins(self) -> None:
        self.pin_pictures = state.pin_pictures(self._bench)
        self._show_scores()

    def _show_scores(self) -> None:
        self.scores = state.benchmark_state(self._bench, self._scoring)
        self.pins = state.pins_state(self._bench)

    def _set(self, **values: Any) -> None:
        for name, value in values.items():
            setattr(self, name, value)
