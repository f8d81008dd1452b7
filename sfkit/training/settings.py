"""How a network is fine-tuned: one frozen record, which its source file carries on."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from enum import StrEnum
from functools import partial
from typing import Any

from sfkit.errors import InputError, member_of
from sfkit.outside import table
from sfkit.settings import Check, setting, settle

EPOCHS, MAX_STEPS, BATCH = 10, 31_250, 8
"""The paper's epochs and batch, and the length its authors' toolbox runs; whichever of the two ends first."""


class Precision(StrEnum):
    """Of the forward and backward pass; weights and the optimiser's state stay float32."""

    FLOAT32 = "float32"
    BFLOAT16 = "bfloat16"  # autocast


def _whole(least: int) -> Check:
    def check(name: str, value: Any) -> Any:
        # As text and TOML have it: True is no count, and 8.0 is not 8.
        if type(value) is not int or value < least:
            raise InputError(f"{name} is {value!r}, expected a whole number of at least {least}")
        return value

    return check


def _share(name: str, value: Any) -> Any:
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0 <= value <= 1:
        raise InputError(f"{name} is {value!r}, expected a number from 0 to 1")
    return value


def _positive(name: str, value: Any) -> Any:
    if not value > 0:
        raise InputError(f"{name} is {value!r}, expected a positive number")
    return value


def _at_least_0(name: str, value: Any) -> Any:
    if not value >= 0:
        raise InputError(f"{name} is {value!r}, expected a number of at least 0")
    return value


def _crop(name: str, value: Any) -> Any:
    crop = None if value is None else tuple(value)
    if crop is not None and (len(crop) != 2 or not all(type(v) is int and v > 0 for v in crop)):
        raise InputError(f"{name} is {crop!r}, expected height and width in pixels, such as 256, 512")
    return crop


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

    crop: tuple[int, int] | None = setting(
        (384, 768), help="Height x width, such as 256x512, or none.", check=_crop
    )
    brightness: float = setting(0.4, help="Factors are drawn from 1 - this to 1 + this.", check=_share)
    contrast: float = setting(0.4, help="The same about the mean grey.", check=_share)
    saturation: float = setting(0.4, help="The same about each pixel's grey.", check=_share)
    hue: float = setting(0.159, help="Turns by up to this share of the colour circle.", check=_share)
    asymmetric: float = setting(0.2, help="How often each view gets colours of its own.", check=_share)
    erase: float = setting(0.5, help="How often boxes of the right view are painted.", check=_share)

    @classmethod
    def none(cls) -> Augmentation:
        """Whole images as they are."""
        return cls(None, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)

    def __post_init__(self) -> None:
        settle(self)


@dataclass(frozen=True)
class TrainingSettings:
    """One fine-tuning. The defaults are the paper's; where it is silent, docs/how_to/fine_tuning.md
    says whose.

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

    epochs: int = setting(EPOCHS, help="Passes over the training set.", check=_whole(1))
    max_steps: int = setting(MAX_STEPS, help="No more steps than this.", check=_whole(1))
    batch: int = setting(BATCH, help="Pairs a step, over all processes.", check=_whole(1))
    micro_batch: int | None = setting(
        None,
        help="Pairs in one forward pass; gradients add up. The process's share unless given.",
        check=_whole(1),
    )
    rate: float | None = setting(
        None, help="Peak learning rate; the architecture's own unless given.", check=_positive
    )
    warm_up: float = setting(0.05, help="Share of the steps until the peak.", check=_share)
    weight_decay: float = setting(1e-5, help="AdamW's.", check=_at_least_0)
    clip: float = setting(1.0, help="Largest norm of the gradient; 0 leaves it as it is.", check=_at_least_0)
    limit: float | None = setting(
        None,
        help="Truth of so many pixels and more does not count; the architecture's own unless given.",
        check=_positive,
    )
    freeze_batch_norm: bool = setting(
        True,
        "--freeze-batch-norm/--train-batch-norm",
        help="Running statistics stay the base's, or change.",
    )
    augmentation: Augmentation = field(default_factory=Augmentation)
    precision: Precision = setting(
        Precision.FLOAT32, help="float32 or bfloat16.", check=partial(member_of, Precision)
    )
    seed: int = setting(0, help="Of order, crops and colours.", check=_whole(0))
    save_every: int = setting(200, help="Steps between two saved states.", check=_whole(1))
    broken_share: float = setting(
        0.02, help="More unreadable pairs than this share of the set end the run.", check=_share
    )
    workers: int = setting(2, help="Threads that read pairs ahead; they change no result.", check=_whole(0))

    def __post_init__(self) -> None:
        settle(self)

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
