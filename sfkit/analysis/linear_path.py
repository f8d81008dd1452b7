"""Before a search: can these checkpoints be merged at all?

Two networks can be merged where the loss stays low on the straight line between them (linear mode
connectivity; Frankle et al., ICML 2020). A source may lie close to its base, at a cosine of 0.997, and still
leave the valley: its midpoint says so, its cosine does not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import pandas as pd

from sfkit.evaluation import Evaluator
from sfkit.evaluation.outcome import Outcome
from sfkit.merging import Recipe

HARM = 1.25  # times the base's score, from which on a source counts as harmful by itself
BARRIER = 1.10  # times the worse end's score, from which on the middle counts as a barrier


@dataclass(frozen=True)
class Path:
    """A straight line between two networks, scored at its ends and in its middle; lower is better.

    Attributes:
        start: the base, or a source.
        end: a source.
        scores: at start, middle and end, in the benchmark's unit; infinite where a network failed.
    """

    start: str
    end: str
    scores: tuple[float, float, float]

    @property
    def barrier(self) -> float:
        """How much the middle lies above the mean of both ends; negative where mixing helps."""
        first, middle, last = self.scores
        return middle - (first + last) / 2

    @property
    def blocked(self) -> bool:
        """True where the middle is clearly worse than the worse end."""
        return self.scores[1] > BARRIER * max(self.scores[0], self.scores[2])


@dataclass(frozen=True)
class LinearPaths:
    """The lines from the base to each source, and between sources.

    Attributes:
        paths: base to each source first.
        unit: of the scores.
    """

    paths: tuple[Path, ...]
    unit: str

    @property
    def harmful(self) -> tuple[str, ...]:
        """Sources that score clearly worse than the base, and make it worse by half of themselves."""
        return tuple(
            path.end
            for path in self.paths
            if path.start == "base"
            and path.scores[2] > HARM * path.scores[0]
            # A source that is bad by itself may still help a mixture.
            and path.scores[1] > path.scores[0]
        )

    @property
    def sentences(self) -> tuple[str, ...]:
        """What a user should know before searching; one that all is well where it is."""
        told = []
        for path in self.paths:
            first, middle, last = path.scores
            # Told once, on its line from the base: between two sources no end is to blame.
            if path.end in self.harmful and path.start == "base":
                told.append(
                    f"{path.end} harms: it scores {last:.2f} {self.unit} where the base has {first:.2f}, and "
                    f"half of it {middle:.2f}; leave it out, or find out whether it was trained otherwise "
                    "(resampling with another align_corners, other normalisation, other data)"
                )
            elif path.blocked:
                told.append(
                    f"between {path.start} and {path.end} lies a barrier: {first:.2f} and {last:.2f} "
                    f"{self.unit} at the ends, {middle:.2f} in the middle; expect a merge to be worse"
                )
        return tuple(told) or ("every straight line stays low: nothing speaks against merging these sources",)

    def beside(self, summary: pd.DataFrame) -> pd.DataFrame:
        """A pool's summary, with what the line from the base says of each source.

        Args:
            summary: of the pool (:meth:`sfkit.Pool.summary`), one row a member, indexed by names.

        Returns:
            The same rows and, beside them, ``score``: the member's own; ``half``: that of its midpoint
            with the base; ``line``: ``low``, ``barrier`` or ``harms``. The base has the first alone.
        """
        ends = {path.end: path for path in self.paths if path.start == "base"}
        # Every line from the base begins with the base's own score.
        base = next(iter(ends.values())).scores[0]
        lines = [ends.get(name) for name in summary.index]
        return summary.assign(
            score=[base if path is None else path.scores[2] for path in lines],
            half=[float("nan") if path is None else path.scores[1] for path in lines],
            line=["" if path is None else self._word(path) for path in lines],
        )

    def _word(self, path: Path) -> str:
        if path.end in self.harmful:
            return "harms"
        return "barrier" if path.blocked else "low"

    def table(self) -> pd.DataFrame:
        """One row a line."""
        rows = [
            {
                "from": path.start,
                "to": path.end,
                "start": path.scores[0],
                "middle": path.scores[1],
                "end": path.scores[2],
                "barrier": path.barrier,
            }
            for path in self.paths
        ]
        return pd.DataFrame(rows)


def linear_paths(evaluator: Evaluator, *, between: bool = True) -> LinearPaths:
    """Before a search: can these checkpoints be merged? What ``sfkit check`` shows, as a record.

        paths = analysis.linear_paths(sfkit.Evaluator(pool, benchmark))
        paths.harmful, paths.sentences, paths.beside(pool.summary())

    Scores the midpoints of all lines: 1 + 2 N evaluations, and N (N - 1) / 2 more between sources.

    Args:
        evaluator: of the pool, on a validation benchmark; a handful of pairs is enough.
        between: whether lines between sources are scored too.
    """
    pool = evaluator.pool
    # Keys say what a network is made of: () the base, a name a source, two names the middle of a line.
    recipes: dict[tuple[str, ...], Recipe] = {(): pool.base_recipe()}
    for name in pool.names:
        recipes[(name,)] = pool.equal(name)
        # Half a task vector is the middle between base and source.
        recipes["base", name] = Recipe.weighted({name: 0.5}, pool.blocks)
    pairs: Sequence[tuple[str, str]] = list(combinations(pool.names, 2)) if between else []
    # The middle of two sources is their equal merge.
    recipes |= {pair: pool.equal(*pair) for pair in pairs}
    outcomes = dict(zip(recipes, evaluator(list(recipes.values())), strict=True))
    lines = [("base", name) for name in pool.names] + list(pairs)
    return LinearPaths(tuple(_path(line, outcomes) for line in lines), evaluator.metric.unit)


def _path(line: tuple[str, str], outcomes: dict[tuple[str, ...], Outcome]) -> Path:
    start, end = line
    first = outcomes[() if start == "base" else (start,)]
    return Path(start, end, (first.score, outcomes[line].score, outcomes[(end,)].score))
