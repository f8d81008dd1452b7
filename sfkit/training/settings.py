"""How a network is fine-tuned: one frozen record, which its source file carries on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from enum import StrEnum
from typing import Any

from sfkit.errors import InputError, unknown_name
from sfkit.outside import table

EPOCHS, MAX_STEPS, BATCH = 10, 31_250, 8
"""The paper's epochs and batch, and the length its authors' toolbox runs; whichever of the two ends first."""


class Precision(StrEnum):
    """Of the forward and backward pass; weights and the optimiser's state stay float32."""

    FLOAT32 = "float32"
    BFLOAT16 = "bfloat16"  # autocast


@dataclass(frozen=True)
class Augmentation:
    """What is changed about a pair before a network learns from it (RAFT-Stereo, 3DV 2021).

    Attributes:
        crop: height and width in pixels, limited to the image and to the network's divisor; None for all.
        brightness: factors are drawn from 1 - b to 1 + b.
        contrast: the same about the mean grey.
        saturation: the same about each pixel's grey.
        hue: turns by up to this share of the colour circle.
        asymmetric: probability that each view gets colours of its own.
        erase: probability that boxes of the right view are painted in its mean colour.
    """

    crop: tuple[int, int] | None = (384, 768)
    brightness: float = 0.4
    contrast: float = 0.4
    saturation: float = 0.4
    hue: float = 0.159
    asymmetric: float = 0.2
    erase: float = 0.5

    @classmethod
    def none(cls) -> Augmentation:
        """Whole images as they are."""
        return cls(None, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        if self.crop is not None:
            object.__setattr__(self, "crop", tuple(self.crop))
            if len(self.crop) != 2 or not all(type(v) is int and v > 0 for v in self.crop):
                raise InputError(
                    f"crop is {self.crop!r}, expected height and width in pixels, such as 256, 512"
                )
        for name in ("brightness", "contrast", "saturation", "hue", "asymmetric", "erase"):
            _share(name, getattr(self, name))


@dataclass(frozen=True)
class TrainingSettings:
    """One fine-tuning. The defaults are the paper's, and where it is silent docs/training.md's.

    Attributes:
        epochs: passes over the training set.
        max_steps: no more steps than this, however many epochs that is.
        batch: pairs a step, over all processes.
        micro_batch: pairs in one forward pass; gradients add up. None: the process's whole share.
        rate: peak learning rate; None for the architecture's own (:mod:`sfkit.training.objectives`).
        warm_up: share of the steps until the peak.
        weight_decay: AdamW's.
        clip: largest norm of the gradient; 0 leaves it as it is.
        limit: truth of so many pixels and more does not count; None for the architecture's own.
        freeze_batch_norm: running statistics stay the base's.
        augmentation: see :class:`Augmentation`.
        precision: see :class:`Precision`.
        seed: of order, crops and colours; with the step it decides everything random.
        save_every: steps between two saved states.
        broken_share: more unreadable pairs than this share of the set end the run.
        workers: threads that read pairs ahead; they change no result.
    """

    epochs: int = EPOCHS
    max_steps: int = MAX_STEPS
    batch: int = BATCH
    micro_batch: int | None = None
    rate: float | None = None
    warm_up: float = 0.05
    weight_decay: float = 1e-5
    clip: float = 1.0
    limit: float | None = None
    freeze_batch_norm: bool = True
    augmentation: Augmentation = field(default_factory=Augmentation)
    precision: Precision = Precision.FLOAT32
    seed: int = 0
    save_every: int = 200
    broken_share: float = 0.02
    workers: int = 2

    def __post_init__(self) -> None:
        for name in ("epochs", "max_steps", "batch", "save_every"):
            _whole(name, getattr(self, name), 1)
        _whole("workers", self.workers, 0)
        _whole("seed", self.seed, 0)
        if self.micro_batch is not None:
            _whole("micro_batch", self.micro_batch, 1)
        for name in ("warm_up", "broken_share"):
            _share(name, getattr(self, name))
        for name in ("rate", "limit"):
            value = getattr(self, name)
            if value is not None and not value > 0:
                raise InputError(f"{name} is {value!r}, expected a positive number")
        for name in ("clip", "weight_decay"):
            if not getattr(self, name) >= 0:
                raise InputError(f"{name} is {getattr(self, name)!r}, expected a number of at least 0")
        if self.precision not in list(Precision):
            raise unknown_name("precision", str(self.precision), [p.value for p in Precision])

    def steps(self, pairs: int) -> int:
        """How many steps a training on so many pairs has."""
        return max(1, min(self.max_steps, pairs * self.epochs // self.batch))

    def describe(self) -> dict[str, Any]:
        """What decides the result, as plain values: all but how often is saved and how pairs are read."""
        values = asdict(self)
        return {
            key: value
            for key, value in values.items()
            if key not in ("save_every", "workers", "broken_share")
        }

    @classmethod
    def from_dict(cls, values: Mapping[str, Any], where: str) -> TrainingSettings:
        """Settings from a file's table; ``augmentation`` may be a table or false.

        Raises:
            InputError: an unknown key, or a value that makes no sense; ``where`` is named.
        """
        given = table(values, where, _names(cls))
        change = given.get("augmentation")
        if change is False:
            given["augmentation"] = Augmentation.none()
        elif isinstance(change, Mapping):
            changed = table(change, f"{where}.augmentation", _names(Augmentation))
            if changed.get("crop") is False:
                changed["crop"] = None
            given["augmentation"] = _built(Augmentation, changed, f"{where}.augmentation")
        built: TrainingSettings = _built(cls, given, where)
        return built


def _names(cls: type[Any]) -> list[str]:
    return [f.name for f in fields(cls)]


def _built(cls: type[Any], values: Mapping[str, Any], where: str) -> Any:
    try:
        return cls(**values)
    except (InputError, TypeError) as error:
        raise InputError(f"{where}: {error}") from error


def _whole(name: str, value: Any, least: int) -> None:
    if type(value) is not int or value < least:
        raise InputError(f"{name} is {value!r}, expected a whole number of at least {least}")


def _share(name: str, value: Any) -> None:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= 1:
        raise InputError(f"{name} is {value!r}, expected a number from 0 to 1")
