"""What of a factory is done, running, stale or missing, and what the rest will cost."""

from __future__ import annotations

import csv
import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sfkit.factory.file import SEARCHED, Factory, Order
from sfkit.factory.outputs import COSTS
from sfkit.training.finetune import intended, starting_point
from sfkit.training.places import training_folder

DONE, RUNNING, STALE, MISSING = "done", "begun", "stale", "missing"
IGNORED = ("versions",)  # a newer sfkit or torch makes no source stale


@dataclass(frozen=True)
class Item:
    """One network of a factory.

    Attributes:
        name: the source's, or ``joint``.
        state: ``done``, ``begun`` (running, or stopped and going on with the next run), ``stale`` (of
            another base, data or recipe) or ``missing``.
        file: where it is, or will be. Its name says what it was made from, so a stale one stays beside it.
        steps: of its training.
        seconds: what it cost, or is expected to cost by the pace of those done; None where none is done.
        cpu_seconds: what it cost of processors; None unless it is done here.
    """

    name: str
    state: str
    file: Path
    steps: int
    seconds: float | None
    cpu_seconds: float | None = None


def status(factory: Factory) -> tuple[Item, ...]:
    """All networks of a factory, sources first; nothing is trained.

    Data on disk is told from other data by ids, codings and file sizes (``TrainingSet.fingerprint``): a
    million files are not read for it, and times of change, which a copy to another machine need not keep,
    play no part. A file that was edited to the very same size leaves its source ``done``.
    """
    items = [_item(name, *place) for name, place in files_of(factory).items()]
    # Of those that are done here: machines differ.
    paces = [item.seconds / item.steps for item in items if item.seconds is not None]
    pace = sum(paces) / len(paces) if paces else None
    return tuple(
        item
        if item.seconds is not None or pace is None
        else Item(item.name, item.state, item.file, item.steps, pace * item.steps)
        for item in items
    )


def most_evaluations(factory: Factory) -> int:
    """The most evaluations the search can ask for, as the search itself says before it starts."""
    return factory.plan.evaluations([order.name for order in factory.orders], ("all",))


def search_seconds(factory: Factory) -> float | None:
    """What the factory's last search took, as its table of costs says; None before the first."""
    table = factory.out / COSTS
    if not table.is_file():
        return None
    rows = csv.DictReader(table.read_text(encoding="utf-8").splitlines())
    return next((float(row["seconds"]) for row in rows if row["part"] == SEARCHED), None)


def files_of(
    factory: Factory, orders: Iterable[Order] | None = None
) -> dict[str, tuple[Path, Mapping[str, Any]]]:
    """Where each network lies, and what it says about itself, by name; the base is read once for all.

    Args:
        factory: whose networks.
        orders: those that are asked for; all unless given.
    """
    start = starting_point(factory.base, name=factory.architecture, options=factory.options)
    found: dict[str, tuple[Path, Mapping[str, Any]]] = {}
    for order in factory.networks if orders is None else orders:
        made = intended(start, order.data, settings=order.settings, licence=order.licence)
        told = {key: value for key, value in made.items() if key not in IGNORED}
        digest = hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:10]
        found[order.name] = (factory.out / "sources" / f"{order.name}-{digest}.safetensors", made)
    return found


def _item(name: str, file: Path, made: Mapping[str, Any]) -> Item:
    record = training_folder(file) / "training.json"
    if file.exists():
        took = json.loads(record.read_text()) if record.exists() else {}
        seconds, worked = (
            None if took.get(key) is None else float(took[key]) for key in ("seconds", "cpu_seconds")
        )
        return Item(name, DONE, file, made["steps"], seconds, worked)
    if any(training_folder(file).glob("state-*.pt")):
        return Item(name, RUNNING, file, made["steps"], None)
    others = [p for p in file.parent.glob(f"{name}-*.safetensors") if p.stem[:-11] == name]
    return Item(name, STALE if others else MISSING, file, made["steps"], None)
