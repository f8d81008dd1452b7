"""The registry of baselines: a typed function becomes a method that is called, listed and run with others.

A method gets :class:`~sfkit.baselines.trials.Trials` and its settings, and returns what it chose::

    @baseline("uniform", label="uniform", paper="Wortsman et al., ICML 2022")
    def uniform(trials: Trials) -> Choice:
        recipe = trials.pool.uniform()
        trials.score([recipe])
        return Choice(recipe)
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, Concatenate, Generic, ParamSpec

import pandas as pd

from sfkit.baselines.trials import Trials, Validation
from sfkit.errors import ensure_known
from sfkit.merging.pool import Pool
from sfkit.merging.recipe import Recipe

P = ParamSpec("P")


@dataclass(frozen=True)
class Network:
    """One merged network: a recipe, and the pool it belongs to."""

    pool: Pool
    recipe: Recipe


@dataclass(frozen=True)
class Choice:
    """What a method chose.

    Attributes:
        recipe: the network it would deploy.
        pool: the recipe's pool where task vectors were prepared; None for the pool as it was read.
        settings: what was chosen for the method's own settings, such as ``{"lambda": 0.3}``.
        draws: all draws of a random method, the chosen network first; empty where there is one network.
        note: a sentence for tables, empty where there is nothing to say.
    """

    recipe: Recipe
    pool: Pool | None = None
    settings: Mapping[str, Any] = field(default_factory=dict)
    draws: tuple[Network, ...] = ()
    note: str = ""


@dataclass(frozen=True)
class BaselineResult:
    """A method's network, how it was found and what that cost.

    Attributes:
        name: the method's.
        label: what tables call it.
        pool: the recipe's pool: as read, or with prepared task vectors.
        recipe: the network the method would deploy.
        score: on validation, in the metric's unit.
        settings: what was chosen, such as ``{"lambda": 0.3}``.
        evaluations: distinct recipes scored on validation, from the store or not.
        image_passes: image pairs those take through a network, with gradients or not.
        seconds: what all this takes without a store: evaluations and preparing task vectors.
        history: what was tried, one row a candidate.
        draws: all draws of a random method, the chosen network first.
        oracle: True where more than validation was seen.
        tuned_on_validation: True where validation chose among candidates.
        note: a sentence for tables.
        cpu_seconds: what all that takes of processors, workers' included; None where nobody measured one of
            its evaluations.
    """

    name: str
    label: str
    pool: Pool
    recipe: Recipe
    score: float
    settings: Mapping[str, Any]
    evaluations: int
    image_passes: int
    seconds: float
    history: pd.DataFrame
    draws: tuple[Network, ...] = ()
    oracle: bool = False
    tuned_on_validation: bool = True
    note: str = ""
    cpu_seconds: float | None = None


@dataclass(frozen=True)
class Baseline(Generic[P]):
    """A method of the registry; call it with a pool, an evaluator on validation, and its settings.

    Attributes:
        name: what ``run_baselines`` calls it.
        label: what tables call it.
        paper: where it comes from.
        tuned_on_validation: True where validation chooses among candidates.
        oracle: True where it sees the benchmarks one reports on.
        on_request: True where it runs only when it is named.
        function: the method itself.
    """

    name: str
    label: str
    paper: str
    tuned_on_validation: bool
    oracle: bool
    on_request: bool
    function: Callable[Concatenate[Trials, P], Choice]

    @property
    def parameters(self) -> tuple[str, ...]:
        """The names of its settings."""
        return tuple(inspect.signature(self.function).parameters)[1:]

    @property
    def summary(self) -> str:
        """The first line of its documentation."""
        return (inspect.getdoc(self.function) or "").partition("\n")[0]

    def __call__(
        self, pool: Pool, validation: Validation, *args: P.args, **kwargs: P.kwargs
    ) -> BaselineResult:
        """Run the method.

        Raises:
            InputError: the pool, the validation benchmark or a setting does not suit it.
        """
        trials = Trials(pool, validation)
        choice = self.function(trials, *args, **kwargs)
        chosen = choice.pool or pool
        (outcome,) = validation.with_pool(chosen)([choice.recipe])  # from the store: it was scored before
        return BaselineResult(
            name=self.name,
            label=self.label,
            pool=chosen,
            recipe=choice.recipe,
            score=outcome.score,
            settings=dict(choice.settings),
            evaluations=trials.evaluations,
            image_passes=trials.image_passes,
            seconds=trials.seconds,
            history=trials.history(),
            draws=choice.draws,
            oracle=self.oracle,
            tuned_on_validation=self.tuned_on_validation,
            note=choice.note,
            cpu_seconds=trials.cpu_seconds,
        )


_REGISTRY: dict[str, Baseline[Any]] = {}
"""By name, in the order tables list them; what others register comes after sfkit's own."""


def baseline(
    name: str,
    *,
    label: str,
    paper: str,
    tuned_on_validation: bool = True,
    oracle: bool = False,
    on_request: bool = False,
) -> Callable[[Callable[Concatenate[Trials, P], Choice]], Baseline[P]]:
    """Register a method; the attributes are those of :class:`Baseline`. A name again replaces its entry."""

    def decorate(function: Callable[Concatenate[Trials, P], Choice]) -> Baseline[P]:
        entry = Baseline(name, label, paper, tuned_on_validation, oracle, on_request, function)
        # In the place of one of that name: a cell that is run again replaces its method.
        _REGISTRY[name] = entry
        return entry

    return decorate


def baseline_named(name: str) -> Baseline[Any]:
    """The method called ``name``.

    Raises:
        InputError: no such method; the nearest name is suggested.
    """
    ensure_known("baseline", name, _REGISTRY)
    return _REGISTRY[name]


def baselines() -> tuple[str, ...]:
    """The names of all registered methods, in the order tables show them."""
    return tuple(_REGISTRY)


def arrange(*entries: Baseline[Any]) -> None:
    """Let tables list these methods in this order, before all others."""
    # In place: whoever holds the registry sees the order as well.
    rest = {name: entry for name, entry in _REGISTRY.items() if entry not in entries}
    _REGISTRY.clear()
    _REGISTRY.update({entry.name: entry for entry in entries} | rest)


def catalogue() -> pd.DataFrame:
    """One row a method: label, what it does, its paper, what it is tuned on."""
    rows = [
        {
            "name": entry.name,
            "label": entry.label,
            "what": entry.summary,
            "paper": entry.paper,
            "sees": "the report's benchmarks" if entry.oracle else "validation",
            "tuned": entry.tuned_on_validation,
            "settings": ", ".join(entry.parameters),
        }
        for entry in map(baseline_named, baselines())
    ]
    return pd.DataFrame(rows).set_index("name")
