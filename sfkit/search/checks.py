"""Checks of arguments that every search makes before its first evaluation."""

from __future__ import annotations

from collections.abc import Iterable

from sfkit.errors import InputError, unknown_name
from sfkit.settings import require_between, require_whole

METHODS = ("paper", "bayesian")
"""Ways to search: StereoFactory's two algorithms, or a model of the score in both stages."""
RESAMPLES = 200  # of the validation pairs, where winners are averaged and no number is named
MOST_RESAMPLES = 10_000  # more take memory, and tell nothing that these did not
LARGEST_POPULATION = 100_000
"""Candidates that are held at the same time; what is far above is a slip, and would fill the memory."""


def distinct_names(argument: str, values: Iterable[str]) -> tuple[str, ...]:
    """The names as a tuple, in the order given.

    Raises:
        InputError: one string was given for a list, an entry is no string, or a name comes twice.
    """
    if isinstance(values, str):
        raise InputError(
            f"{argument}: found the text {values!r}, expected a list of names: write [{values!r}]"
        )
    names = tuple(values)
    for name in names:
        if not isinstance(name, str):
            raise InputError(f"{argument}: found the entry {name!r}, expected names")
        if names.count(name) > 1:
            raise InputError(f"{argument}: found {name!r} more than once, expected each name once")
    return names


def require_known(argument: str, names: Iterable[str], allowed: Iterable[str], kind: str) -> None:
    """Refuse names outside ``allowed``; the nearest allowed name is suggested.

    Args:
        argument: what the caller passed the names as.
        names: what the caller passed.
        allowed: every name there is.
        kind: what the names stand for, "source" or "block".

    Raises:
        InputError: naming the argument, the first unknown name and the allowed ones.
    """
    known = tuple(allowed)
    for name in names:
        if name not in known:
            raise InputError(f"{argument}: {unknown_name(kind, name, known)}")


def check_parts(subset: object | None, stage2: object | None, start: object | None) -> None:
    """Refuse a search without anything to search, or a start for sources that nobody has chosen.

    Raises:
        InputError: what was found, and what is missing.
    """
    if subset is not None and stage2 is None:
        raise InputError("found a subset and no Stage 2, expected something to search")
    if subset is None and start is not None:
        raise InputError(
            "found a recipe to start Stage 2 from and no subset, expected both: Stage 1 may find another "
            "subset than the recipe's"
        )


def check_choice(settings: object) -> None:
    """Refuse a Stage 2 that does not choose by the score alone, which is what is resampled.

    Raises:
        InputError: a hold-out, or a penalty.
    """
    for name in ("holdout", "entropy", "shrinkage"):
        if value := getattr(settings, name):
            raise InputError(
                f"resamples: found {name} {value}, by which Stage 2 chooses otherwise than by the score that "
                f"is resampled, expected one of the two: leave resamples or {name} at 0"
            )


def check_resamples(resamples: object, stage2: object | None) -> int:
    """Refuse a number of resamples that cannot be drawn, or a Stage 2 that they do not suit.

    Raises:
        InputError: what was found, and as :func:`check_choice`.
    """
    count = require_whole("resamples", resamples, 0)
    if count > MOST_RESAMPLES:
        raise InputError(f"resamples: found {count}, expected at most {MOST_RESAMPLES}")
    if count and stage2 is not None:
        check_choice(stage2)
    return count


def check_rank(rank: int | None, tied: bool) -> None:
    """Refuse a rank of routing that is tied, or that is no whole number of at least 1.

    Raises:
        InputError: what was found.
    """
    if rank is None:
        return
    require_whole("rank", rank, 1)
    if tied:
        raise InputError(f"rank: found {rank} and tied=True, expected tied=False: tied routing has one row")


def check_gamma(argument: str, gamma: tuple[float, float]) -> tuple[float, float]:
    """Bounds of the module scales, which are [low, high] with 0 <= low < 1 < high and midpoint 1.

    Raises:
        InputError: what was found, and why the midpoint matters.
    """
    if not isinstance(gamma, tuple | list) or len(gamma) != 2:
        raise InputError(f"{argument}: found {gamma!r}, expected two numbers such as (0.25, 1.75)")
    low, high = gamma
    require_between(argument, low, 0.0)
    require_between(argument, high, 0.0)
    # With tolerance: decimal bounds may miss the midpoint by a rounding.
    if not low < 1.0 < high or abs((low + high) / 2.0 - 1.0) > 1e-9:
        raise InputError(
            f"{argument}: found [{low:g}, {high:g}], expected bounds around 1 with 1 in the middle, such as "
            "[0.25, 1.75], so that x = 0 is the equal-weight merge"
        )
    return float(low), float(high)
