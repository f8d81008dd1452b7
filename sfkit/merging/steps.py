"""How task vectors are prepared before they are merged: small records that travel with a recipe.

TIES, DARE and Fisher merging change the task vectors themselves. Their parts are steps, done in order by
:func:`~sfkit.merging.prepare.prepare`; the prepared vectors are then routed and scaled like any others.
No step touches running statistics, but those that make one vector of several take their mean.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, ClassVar

from sfkit.errors import InputError, ensure_known


@dataclass(frozen=True)
class Trim:
    """Keep each source's entries of largest magnitude, set the others to 0 (TIES, Yadav et al. 2023, step 1).

    Attributes:
        density: the share to keep, in (0, 1]: int(density * n) entries, at least one, and every other one
            that is as large as the smallest of them, as the paper's code does.
        per: ``"vector"`` (the paper) chooses over the whole task vector, ``"tensor"`` in each tensor
            (mergekit). n counts entries of the tensors the source changed: frozen parts are no choice.
    """

    kind: ClassVar[str] = "trim"
    density: float = 0.2
    per: str = "vector"

    def __post_init__(self) -> None:
        if not (_finite(self.density) and 0.0 < self.density <= 1.0):
            raise InputError(f"trim: found density {self.density!r}, expected a number above 0 and at most 1")
        ensure_known("trim: per", self.per, ("vector", "tensor"))

    @property
    def idle(self) -> bool:
        """True where it changes nothing."""
        return self.density == 1.0

    @property
    def label(self) -> str:
        """What a source's name gets appended."""
        return f"trim={self.density:g}" + (",tensor" if self.per == "tensor" else "")


@dataclass(frozen=True)
class Drop:
    """Set entries to 0 at random and enlarge the others (DARE, Yu et al. 2024, eq. 1 and 2).

    Attributes:
        probability: p, of an entry to be dropped, in [0, 1).
        seed: of the draws; which entries go depends on it, on the source's content and on the tensor's key.
        rescale: ``"probability"`` (the paper) divides what is left by 1 - p, ``"norm"`` (mergekit) gives each
            tensor the L1 norm it had, ``"none"`` leaves it.
    """

    kind: ClassVar[str] = "drop"
    probability: float = 0.9
    seed: int = 0
    rescale: str = "probability"

    def __post_init__(self) -> None:
        if not (_finite(self.probability) and 0.0 <= self.probability < 1.0):
            raise InputError(f"drop: found probability {self.probability!r}, expected it in [0, 1)")
        if isinstance(self.seed, bool) or not isinstance(self.seed, int) or self.seed < 0:
            raise InputError(f"drop: found seed {self.seed!r}, expected a whole number of at least 0")
        ensure_known("drop: rescale", self.rescale, ("probability", "norm", "none"))

    @property
    def idle(self) -> bool:
        """True where it changes nothing."""
        return self.probability == 0.0

    @property
    def label(self) -> str:
        """What a source's name gets appended."""
        other = "" if self.rescale == "probability" else f",{self.rescale}"
        return f"drop={self.probability:g}#{self.seed}{other}"


@dataclass(frozen=True)
class Mean:
    """One task vector: the mean of several.

    Attributes:
        name: what the new source is called.
        sources: whose, by the names they were opened with; all of the pool's where empty.
    """

    kind: ClassVar[str] = "mean"
    name: str = "mean"
    sources: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        # A recipe holds its steps and is looked up by hash; JSON gives lists.
        object.__setattr__(self, "sources", tuple(self.sources))


@dataclass(frozen=True)
class Elect:
    """One task vector: per entry the sign of the sum, then the mean of those that have it (TIES, 2 and 3).

    Attributes:
        name: what the new source is called.
        sources: as for :class:`Mean`.
        zero: what a sum of 0 elects: ``"majority"`` (the paper's code) the sign that most entries of the
            vector elect, ``"plus"`` (mergekit) plus.
        combine: ``"mean"`` (the paper) or ``"sum"`` (fusion_bench) of the entries that agree.
        weights: one a source, which multiply before the election (mergekit) and weigh the mean; the paper has
            none.
    """

    kind: ClassVar[str] = "elect"
    name: str = "ties"
    sources: tuple[str, ...] = ()
    zero: str = "majority"
    combine: str = "mean"
    weights: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        object.__setattr__(self, "sources", tuple(self.sources))
        object.__setattr__(self, "weights", tuple(map(float, self.weights)))
        ensure_known("elect: zero", self.zero, ("majority", "plus"))
        ensure_known("elect: combine", self.combine, ("mean", "sum"))
        if self.weights and len(self.weights) != len(self.sources):
            raise InputError(
                f"elect: found {len(self.weights)} weights for {len(self.sources)} sources, "
                "expected one each: name the sources they are for"
            )
        if not all(math.isfinite(weight) and weight > 0 for weight in self.weights):
            raise InputError(f"elect: found weights {self.weights}, expected finite numbers above 0")


@dataclass(frozen=True)
class FisherMean:
    """One task vector: the mean weighted by Fisher information (Matena and Raffel 2022, eq. 3).

    Attributes:
        measured: digest of the information; it comes from images, so a pool alone cannot rebuild it.
        on: what it was measured on, for people.
        name: what the new source is called.
        sources: as for :class:`Mean`.
        floor: information below it counts as this much.
    """

    kind: ClassVar[str] = "fisher"
    measured: str
    on: str = ""
    name: str = "fisher"
    sources: tuple[str, ...] = ()
    floor: float = 1e-6

    def __post_init__(self) -> None:
        object.__setattr__(self, "sources", tuple(self.sources))
        if not (_finite(self.floor) and self.floor > 0):
            raise InputError(f"fisher: found floor {self.floor!r}, expected a finite number above 0")


Sparse = Trim | Drop
"""Steps that change each task vector by itself."""
Fused = Mean | Elect | FisherMean
"""Steps that make one task vector of several."""
Step = Sparse | Fused

_KINDS: dict[str, type[Step]] = {kind.kind: kind for kind in (Trim, Drop, Mean, Elect, FisherMean)}


def as_dicts(steps: Sequence[Step]) -> list[dict[str, Any]]:
    """Plain values; :func:`from_dicts` reads them back."""
    return [{"step": step.kind, **settings(step)} for step in steps]


def settings(step: Step) -> dict[str, Any]:
    """A step's settings as JSON has them."""
    values = {f.name: getattr(step, f.name) for f in fields(step)}
    return {key: list(value) if isinstance(value, tuple) else value for key, value in values.items()}


def from_dicts(values: object, where: str = "recipe") -> tuple[Step, ...]:
    """Read what :func:`as_dicts` wrote.

    Raises:
        InputError: an unknown step, a setting it does not have, or a value out of its range.
    """
    if not isinstance(values, list) or not all(isinstance(entry, Mapping) for entry in values):
        raise InputError(f"{where}: found the preparation {values!r}, expected a list of steps")
    return tuple(_step(dict(entry), where) for entry in values)


def _step(entry: dict[str, Any], where: str) -> Step:
    kind = entry.pop("step", None)
    ensure_known(f"{where}: preparation step", kind, _KINDS)
    known = {field.name for field in fields(_KINDS[kind])}
    for key in entry:
        ensure_known(f"{where}: setting of step {kind!r}", key, known)
    try:
        return _KINDS[kind](**entry)
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    except (TypeError, ValueError) as error:
        raise InputError(f"{where}: the step {kind!r} is malformed ({error})") from error


def describe(steps: Sequence[Step]) -> str:
    """The steps for people, on one line."""
    return ", then ".join(
        f"{step.kind} ({', '.join(f'{key} {_text(value)}' for key, value in settings(step).items())})"
        for step in steps
    )


def _text(value: object) -> str:
    return "+".join(map(str, value)) or "all" if isinstance(value, list) else str(value)


def _finite(value: object) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)
