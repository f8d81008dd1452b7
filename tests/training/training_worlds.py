"""What the tests train on: a few tiny rendered pairs, and settings for a training of seconds."""

from __future__ import annotations

from sfkit.datasets.pairs import MemoryPair, Sample
from sfkit.datasets.synthetic import domains, synthetic_pair
from sfkit.datasets.training_set import TrainingSet
from sfkit.training import Augmentation, TrainingSettings

SETTINGS = TrainingSettings(
    epochs=3,
    batch=4,
    rate=1e-3,
    augmentation=Augmentation(crop=(32, 64)),
    seed=3,
    save_every=2,
    workers=0,
)


def tiny_set(count: int = 8) -> TrainingSet:
    """Pairs of the plain world, 48 x 96 pixels."""
    return TrainingSet("tiny", tuple(MemoryPair(s.id, s) for s in map(tiny_sample, range(count))))


def tiny_sample(index: int) -> Sample:
    """One rendered pair."""
    drawn = synthetic_pair(domains()["plain"], index, height=48, width=96)
    return Sample(f"tiny-{index}", drawn.left, drawn.right, drawn.disparity, drawn.nonoccluded)
