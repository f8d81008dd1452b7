"""What of a factory is done, running, interrupted, stale or missing, and what the rest will cost."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sfkit.factory.file import Factory, Order
from sfkit.training.finetune import intended, starting_point
from sfkit.training.record import costs_of, progress_of
from sfkit.training.settings import TrainingSettings

DONE, RUNNING, INTERRUPTED, STALE, MISSING = "done", "running", "interrupted", "stale", "missing"
IGNORED = ("versions",)  # a newer sfkit or torch makes no source stale


@dataclass(frozen=True)
class Item:
    """One network of a factory.

    Attributes:
        name: the source's, or ``joint``.
        state: ``done``; ``running``, as long as the process that trains it lives; ``interrupted``, which the
            next run goes on with; ``stale`` (of another base, data or recipe); or ``missing``.
        file: where it is, or will be. Its name says what it was made from, so a stale one stays beside it.
        steps: of its training.
        done: steps behind it; of an interrupted one those that it need not take again.
        seconds: what it cost, or is expected to cost in whole; None where nothing says it.
        left: seconds that are still to be spent; None where nothing says it.
        cpu_seconds: what it cost of processors; None unless it is done here.
    """

    name: str
    state: str
    file: Path
    steps: int
    done: int
    seconds: float | None
    left: float | None
    cpu_seconds: float | None = None


def status(factory: Factory, paces: Mapping[str, float] | None = None) -> tuple[Item, ...]:
    """All networks of a factory, sources first; nothing is trained.

    What a training will cost is told by its own pace where it was begun, else by a measured one, else by
    those of the factory's that were trained or begun alike (batch, micro batch, crop, precision), else by
    those of other batches and crops, in proportion to the pixels of a step.

    Data on disk is told from other data by ids, codings and file sizes (``TrainingSet.fingerprint``): a
    million files are not read for it, and times of change, which a copy to another machine need not keep,
    play no part. A file that was edited to the very same size leaves its source ``done``.

    Args:
        factory: whose networks.
        paces: network -> measured seconds a step (:func:`~sfkit.factory.timing.time_steps`).
    """
    places = files_of(factory)
    items = [_item(name, *place) for name, place in places.items()]
    settings = {order.name: order.settings for order in factory.networks}
    # Of this machine, or of machines that are told apart from it by nothing here.
    known = [(settings[i.name], i.seconds / i.steps) for i in items if i.seconds is not None]
    given = {name: pace for name, pace in (paces or {}).items() if name in settings}
    known += [(settings[name], pace) for name, pace in given.items()]
    found = []
    for item in items:
        if item.state != DONE and item.seconds is None:
            pace = given.get(item.name) or _pace(settings[item.name], known)
            item = item if pace is None else _at(item, pace)
        found.append(item)
    return tuple(found)


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
        # In the file's name, so that what was made otherwise is another file, and is kept.
        digest = hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()[:10]
        found[order.name] = (factory.out / "sources" / f"{order.name}-{digest}.safetensors", made)
    return found


def _item(name: str, file: Path, made: Mapping[str, Any]) -> Item:
    steps = made["steps"]
    if file.exists():
        seconds, worked = costs_of(file)
        return Item(name, DONE, file, steps, steps, seconds, 0.0, worked)
    if (begun := progress_of(file)) is not None:
        state = RUNNING if begun.running else INTERRUPTED
        item = Item(name, state, file, steps, begun.step, None, None)
        return item if begun.pace is None else _at(item, begun.pace)
    # Without hyphen and digest: one source's name may begin another's.
    others = [p for p in file.parent.glob(f"{name}-*.safetensors") if p.stem[:-11] == name]
    return Item(name, STALE if others else MISSING, file, steps, 0, None, None)


def _at(item: Item, pace: float) -> Item:
    return replace(item, seconds=pace * item.steps, left=pace * (item.steps - item.done))


def _pace(settings: TrainingSettings, known: Iterable[tuple[TrainingSettings, float]]) -> float | None:
    """Seconds a step, from those of other trainings; None where none is comparable."""
    known = list(known)
    alike = [pace for other, pace in known if _kind(other) == _kind(settings)]
    if alike:
        return sum(alike) / len(alike)
    pixels = _pixels(settings)
    # By pixels, where no other is trained alike.
    scaled = [pace * pixels / size for other, pace in known if pixels and (size := _pixels(other))]
    return sum(scaled) / len(scaled) if scaled else None


def _kind(settings: TrainingSettings) -> tuple[object, ...]:
    return settings.batch, settings.micro_batch, settings.augmentation.crop, settings.precision


def _pixels(settings: TrainingSettings) -> int | None:
    """Of a step; None for whole images, whose size only the data says."""
    crop = settings.augmentation.crop
    return None if crop is None else settings.batch * crop[0] * crop[1]
