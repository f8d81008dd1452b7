"""Settings of both stages out of what was said on the command line; nothing that was said is ignored."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from sfkit.cli.groups import Group
from sfkit.cli.panels import MODEL1, MODEL2, STAGE1, STAGE2
from sfkit.errors import InputError, ensure_known
from sfkit.search import BayesianRoutingSettings, BayesianSubsetSettings, RoutingSettings, SubsetSettings
from sfkit.search.bayesian_settings import rounds
from sfkit.search.checks import METHODS
from sfkit.settings import require_whole

Said = Mapping[str, Any]
"""Field -> the value that was said for it."""

_SHARED = ("seed", "batch")  # of both stages: in use as long as one of them is
_FIRST, _SECOND = (STAGE1, MODEL1), (STAGE2, MODEL2)


def stages(
    method: str, stage1: Said, stage2: Said, *, subset: bool = False, start: bool = False
) -> tuple[SubsetSettings, RoutingSettings | None]:
    """The settings of both stages by a method; None for a Stage 2 that is left out.

    Args:
        method: one of ``METHODS``.
        stage1: what was said of Stage 1, the model's options included.
        stage2: the same of Stage 2.
        subset: whether the sources are given, which leaves Stage 1 out.
        start: whether Stage 2 starts from a recipe.

    Raises:
        InputError: a value out of its range, or an option that nothing would use: another method's, of a
            stage that is left out, or of what another option turns off.
    """
    ensure_known("method", method, METHODS)
    batch = require_whole("batch", stage1.get("batch", 1), 1)
    if method == "paper" and batch == 1:
        # One at a time is nothing to refuse.
        stage1, stage2 = (_without(said, "batch") for said in (stage1, stage2))
    for groups, said, names, why, remedy in _idle(method, stage1, stage2, subset=subset, start=start):
        for name in names:
            if name in said:
                raise InputError(f"{_flag(groups, name, said[name])}: found it {why}; {remedy}")
    if method == "paper":
        first = SubsetSettings(**stage1)
        made: type[RoutingSettings] = RoutingSettings
    else:
        first = BayesianSubsetSettings(**{"generations": rounds(batch), **stage1})
        made = BayesianRoutingSettings
    if stage2.get("evaluations") == 0:
        return first, None
    # A rank is for blocks that are not tied.
    return first, made(**{"tied": "rank" not in stage2, **stage2})


def _idle(
    method: str, stage1: Said, stage2: Said, *, subset: bool, start: bool
) -> Iterator[tuple[tuple[Group, ...], Said, Iterable[str], str, str]]:
    """Stage by stage what nothing would use: its options, what was said, fields, why, and what to do."""
    one = "leave one of the two out"
    other = next(name for name in METHODS if name != method)
    unused = {
        "paper": (MODEL1.only, MODEL2.only),
        "bayesian": (BayesianSubsetSettings.UNUSED, BayesianRoutingSettings.UNUSED),
    }[method]
    why, remedy = f"with --method {method}, which does not use it", f"leave it out or take --method {other}"
    yield _FIRST, stage1, unused[0], why, remedy
    yield _SECOND, stage2, unused[1], why, remedy
    if subset:
        yield _FIRST, stage1, _without(stage1, *_SHARED), "with --subset, which leaves Stage 1 out", one
    if stage2.get("evaluations") == 0:
        rest = _without(stage2, "evaluations", *_SHARED)
        yield _SECOND, stage2, rest, "with --evaluations 0, which leaves Stage 2 out", one
    if not start:
        yield _SECOND, stage2, ("floor",), "without --start", "leave it out or name a recipe to start from"
    if stage2.get("scaled") is False:
        yield _SECOND, stage2, ("gamma",), "with --no-scaled, which fixes all scales at 1", one
    if stage2.get("converge") is False:
        yield _SECOND, stage2, ("tolfun", "tolx"), "with --no-converge, which uses up the budget", one


def _without(said: Said, *names: str) -> dict[str, Any]:
    return {name: value for name, value in said.items() if name not in names}


def _flag(groups: Iterable[Group], name: str, value: Any) -> str:
    return next(group for group in groups if name in group.options()).flag(name, value)
