"""How far a factory's search is, and what it will cost."""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from sfkit.errors import InputError
from sfkit.factory.file import SEARCHED, Factory
from sfkit.factory.outputs import COSTS, RECORD, SCORES, SEARCH
from sfkit.factory.standing import DONE, INTERRUPTED, MISSING, RUNNING, STALE
from sfkit.files import is_held, write_text
from sfkit.search.run_folder import LOCK
from sfkit.search.run_folder import SEARCH as BEGUN
from sfkit.search.runs import read_run


@dataclass(frozen=True)
class SearchItem:
    """The search of a factory, with the scores that come after it.

    Attributes:
        state: as of a network: ``done``, ``running``, ``interrupted``, ``stale`` (of other networks,
            benchmarks or budgets) or ``missing``.
        evaluations: the most it can ask for, as the search itself says before it starts. What the store
            knows costs nothing.
        each: seconds an evaluation; None where nothing says it.
        seconds: what it cost, or is expected to cost at most; None where nothing says it.
    """

    state: str
    evaluations: int
    each: float | None
    seconds: float | None


def search_status(factory: Factory, files: Mapping[str, Path], measured: float | None = None) -> SearchItem:
    """The search of a factory; nothing is evaluated.

    Args:
        factory: whose search.
        files: where each of its networks lies, from :func:`~sfkit.factory.standing.status`.
        measured: seconds an evaluation, where nothing here has taken one
            (:func:`~sfkit.factory.timing.time_evaluation`).
    """
    folder, most = factory.out / SEARCH, most_evaluations(factory)
    made = _made_of(factory)
    # A lock goes with its process, however that ends.
    if is_held(folder / LOCK):
        state = RUNNING
    elif made == identity(factory, files):
        state = DONE
    elif made is None and (folder / BEGUN).is_file():
        # Without a record, but with scores: a version that kept no record finished it.
        state = STALE if (factory.out / SCORES).is_file() else INTERRUPTED
    else:
        state = MISSING if made is None else STALE
    took, each = _last(factory)
    each = each or _of_journal(folder) or measured
    expected = None if each is None else each * most
    return SearchItem(state, most, each, took if state == DONE else expected)


def most_evaluations(factory: Factory) -> int:
    """The most evaluations the search can ask for, as the search itself says before it starts."""
    return factory.plan.evaluations([order.name for order in factory.orders], ("all",))


def identity(factory: Factory, files: Mapping[str, Path]) -> str:
    """A digest of all that decides what the search finds and what is scored after it.

    The files' names say what the networks were made from.
    """
    measured = [
        [(one.fingerprint(), one.protocol, one.metric) for one in some]
        for some in (factory.validation, factory.tests)
    ]
    values = [
        {name: file.name for name, file in files.items()},
        *measured,
        factory.combine,
        factory.plan.method,
        factory.plan.describe(),
    ]
    return hashlib.sha256(json.dumps(values, sort_keys=True, default=str).encode()).hexdigest()


def begin(factory: Factory, files: Mapping[str, Path]) -> None:
    """What another search was made of is no longer said: from now on this one is not done."""
    if _made_of(factory) != identity(factory, files):
        (factory.out / RECORD).unlink(missing_ok=True)


def end(factory: Factory, files: Mapping[str, Path]) -> None:
    """The search, the scores and the costs are those of what the factory's file says now."""
    write_text(factory.out / RECORD, json.dumps({"identity": identity(factory, files)}) + "\n")


def _made_of(factory: Factory) -> str | None:
    try:
        return str(json.loads((factory.out / RECORD).read_text(encoding="utf-8"))["identity"])
    except (OSError, ValueError, KeyError, TypeError):
        return None


def _last(factory: Factory) -> tuple[float | None, float | None]:
    """Seconds of the last search, and of an evaluation on as many pairs as there are now."""
    table = factory.out / COSTS
    if not table.is_file():
        return None, None
    rows = csv.DictReader(table.read_text(encoding="utf-8").splitlines())
    row = next((row for row in rows if row["part"] == SEARCHED), None)
    if row is None:
        return None, None
    seconds, passes = float(row["seconds"]), int(row["passes"])
    pairs = sum(len(guide) for guide in factory.validation)
    # By the pair: the guides may have others now.
    return seconds, seconds / passes * pairs if passes else None


def _of_journal(folder: Path) -> float | None:
    """Seconds an evaluation of a search that has begun."""
    try:
        stages = read_run(folder).stages
    except InputError:  # no journal yet
        return None
    # With what the store saved: that is what an evaluation takes where nothing is known.
    taken = [(s.counts["seconds"] + s.counts["seconds_saved"], s.counts["distinct"]) for s in stages]
    seconds, count = (sum(column) for column in zip(*taken, strict=True)) if taken else (0.0, 0)
    return seconds / count if count and seconds else None
