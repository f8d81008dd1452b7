"""Stage 1: evolutionary subset search (StereoFactory, Algorithm 1).

Which sources take part? A genetic algorithm over subsets; every candidate is scored as the equal-weight
merge of its subset (eq. 4), and the best of everything ever evaluated is the pool of Stage 2.

Every candidate is evaluated on all images, losers too: bounds that could stop one early and change nothing
save 2.9 % of image passes on the embedded bank, 9.2 % at the very best (every comparison decided as soon as
it can be, hard images first; five seeds of 750 evaluations), too little to keep scores that are no scores.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

import pandas as pd

from sfkit.errors import InputError
from sfkit.evaluation.outcome import Scorer
from sfkit.merging.recipe import Recipe
from sfkit.search.base import Search, SearchState
from sfkit.search.breeding import Draft, Rank, SubsetSettings, bred, initial, survivors
from sfkit.search.checks import distinct_names, require_known
from sfkit.search.constraints import Constraints, subset_of
from sfkit.search.journal import Journal
from sfkit.search.operators import Chromosome, SubsetSpace
from sfkit.search.records import SubsetCandidate, subset_history
from sfkit.search.scoring import score_once
from sfkit.streams import Stream, generator


@dataclass(frozen=True)
class SubsetState(SearchState[SubsetCandidate]):
    """State of Stage 1.

    Attributes:
        populations: for each generation t the numbers of the candidates in P_t; one can be in it more
            than once.
    """

    populations: tuple[tuple[int, ...], ...] = ()


class SubsetSearch(Search[SubsetCandidate]):
    """Stage 1 over named sources; see :class:`SubsetSettings` for the defaults and what they settle.

    Generation t draws from ``numpy.random.default_rng([seed, 1, t])`` and from nothing else.
    """

    kind: ClassVar[str] = "subset"

    def __init__(
        self,
        sources: Iterable[str],
        blocks: Iterable[str],
        scorer: Scorer,
        settings: SubsetSettings | None = None,
        *,
        constraints: Constraints | None = None,
        start: Recipe | Iterable[Recipe | Iterable[str]] = (),
        journal: Journal | None = None,
    ) -> None:
        """Check everything; nothing is scored before the first step.

        Args:
            sources: names of the pool's sources, at least two.
            blocks: names of the blocks, in the partition's order; recipes name them.
            scorer: takes recipes, returns outcomes.
            settings: population size and the like.
            constraints: which subsets may be proposed.
            start: recipes or subsets that take the first places of the initial population; of a recipe
                only the subset counts.
            journal: where to write what happens, for viewers.

        Raises:
            InputError: fewer than two sources, an unknown or repeated name, constraints that leave
                nothing, or a start that breaks them.
        """
        super().__init__(scorer, journal)
        self.sources = distinct_names("sources", sources)
        self.blocks = distinct_names("blocks", blocks)
        self.settings = settings or SubsetSettings()
        self.constraints = constraints or Constraints()
        if not self.blocks:
            raise InputError("blocks: found none, expected the names of at least one block")
        # Before the starts, which it judges.
        self.space: SubsetSpace = self.constraints.space(self.sources, self.blocks)
        self._starts = self._read_starts(start)
        self._state = SubsetState()

    @property
    def state(self) -> SubsetState:
        """The current state; frozen."""
        return self._state

    @property
    def reason(self) -> str | None:
        """Why no step is left, None where one is."""
        over = self._state.generation >= self.settings.generations
        return f"all {self.settings.generations} generations are done" if over else None

    @property
    def initial(self) -> int:
        """Candidates of generation 0."""
        return self.settings.population

    @property
    def most(self) -> int:
        """The most candidates there will be."""
        return self.initial + self.settings.generations * self.settings.offspring

    @property
    def population(self) -> tuple[SubsetCandidate, ...]:
        """The current population P_t; empty before the first step."""
        return _members(self._state)

    @property
    def history(self) -> pd.DataFrame:
        """One row a candidate; the columns are described at :func:`sfkit.search.records.subset_history`."""
        return subset_history(self._state.candidates, self._state.populations, self.predicted)

    def recipe(self, chromosome: Chromosome) -> Recipe:
        """The equal-weight merge a chromosome stands for (eq. 4), its sources in the pool's order."""
        # Sorted: order is for crossover alone, and one subset is one recipe, scored once.
        return Recipe.equal((self.sources[gene] for gene in sorted(chromosome)), self.blocks)

    def _advance(self) -> None:
        state, settings = self._state, self.settings
        generation = state.generation + 1
        # Anew for each generation: a step that was interrupted draws the same when it is done again.
        rng = generator(settings.seed, Stream.SUBSET_SEARCH, generation)
        if generation == 0:
            drafts = initial(settings, self.space, self._starts, rng)
        else:
            drafts = bred(self._ranked(_members(state)), settings, self.space, rng)
        offspring = self._scored(drafts, generation)
        if generation == 0:
            population = tuple(candidate.number for candidate in offspring)
        else:
            # Parents compete with their offspring: a good one is not lost to a worse generation.
            pool = self._ranked((*_members(state), *offspring))
            population = tuple(number for _, number in survivors(pool, settings, rng))
        self._state = SubsetState(
            generation, (*state.candidates, *offspring), (*state.populations, population)
        )

    def _ranked(self, candidates: Iterable[SubsetCandidate]) -> list[tuple[Chromosome, Rank]]:
        index = {name: i for i, name in enumerate(self.sources)}
        return [(tuple(index[name] for name in c.chromosome), c.rank) for c in candidates]

    def _scored(self, drafts: Sequence[Draft], generation: int) -> tuple[SubsetCandidate, ...]:
        past = self._state.candidates
        recipes = [self.recipe(draft.chromosome) for draft in drafts]
        found = score_once(past, recipes, self._scorer)
        return tuple(
            SubsetCandidate(
                number=len(past) + i,
                generation=generation,
                recipe=recipe,
                outcome=answer.outcome,
                repeated=answer.repeated,
                chromosome=tuple(self.sources[gene] for gene in draft.chromosome),
                parents=draft.parents,
                operators=draft.operators,
            )
            for i, (draft, recipe, answer) in enumerate(zip(drafts, recipes, found, strict=True))
        )

    def _read_starts(self, start: Recipe | Iterable[Recipe | Iterable[str]]) -> tuple[Chromosome, ...]:
        if isinstance(start, str):
            raise InputError(f"start: found the text {start!r}, expected a list of recipes or of subsets")
        entries = (start,) if isinstance(start, Recipe) else tuple(start)
        if len(entries) > self.settings.population:
            raise InputError(
                f"start: found {len(entries)} entries, expected at most {self.settings.population}, "
                "the size of the population"
            )
        return tuple(self._read_start(entry) for entry in entries)

    def _read_start(self, entry: Recipe | Iterable[str]) -> Chromosome:
        if isinstance(entry, str):
            raise InputError(f"start: found the name {entry!r}, expected subsets: write [[{entry!r}, ...]]")
        names = subset_of(entry)
        require_known("start", names, self.sources, "source")
        chromosome = tuple(self.sources.index(name) for name in names)
        if not self.space.holds(chromosome):
            raise InputError(
                f"start: found the subset {list(names)}, expected {self.space.smallest} to "
                f"{self.space.largest} sources with all of include and none of exclude"
            )
        return chromosome

    def _description(self) -> dict[str, Any]:
        return {
            "sources": self.sources,
            "blocks": self.blocks,
            "settings": self.settings,
            "constraints": self.constraints,
            "start": [[self.sources[gene] for gene in chromosome] for chromosome in self._starts],
            "subsets": self.space.subsets,
            "most": self.most,
        }

    def _details(self) -> dict[str, Any]:
        return {"population": self._state.populations[-1]}


def _members(state: SubsetState) -> tuple[SubsetCandidate, ...]:
    numbers = state.populations[-1] if state.populations else ()
    return tuple(state.candidates[number] for number in numbers)
