"""The worlds, network and trainings of ``bank-sharp``, fixed before the first of its trainings ran.

Every number here was chosen before any training: no world is softened for what its source turns out to do,
and a source that harms is kept. The training data are rendered when they are first read.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sfkit.bank.kept import keep, recall
from sfkit.datasets.benchmark_record import Benchmark
from sfkit.datasets.pairs import Sample
from sfkit.datasets.synthetic import synthetic_pair
from sfkit.datasets.synthetic.domains import BASE as FORMER_BASE
from sfkit.datasets.synthetic.domains import SOURCES as FORMER_SOURCES
from sfkit.datasets.synthetic.domains import Domain
from sfkit.datasets.synthetic.pairs import SEED
from sfkit.datasets.training_set import TrainingSet
from sfkit.training.settings import MAX_STEPS, Augmentation, TrainingSettings

JOINT = "joint"
"""The network of all sources' scenes together: what merging is to be compared with."""

CROP = (128, 256)  # px of 192 x 384: all processor time goes into pixels, and a random window wastes none
LICENCE = "Apache-2.0"
BASE_SCENES, SOURCE_SCENES, HELD_OUT = 3000, 400, 24

# Richer than the first bank's in geometry and surfaces, still in good light: what real pre-training sets are.
BASE = replace(
    FORMER_BASE,
    about="things of every surface at all depths, some thin, tilted or between walls, good light",
    objects=(4, 12),
    thin=(0, 3),
    slant=0.15,
    curved=0.3,
    ground=0.4,
    walls=0.15,
    textures={"cloud": 3.0, "grain": 2.0, "print": 3.0, "bricks": 1.0, "paint": 2.0, "stripes": 0.5},
)

# The first bank's worlds; those that were softened so that no source did harm are sharp again.
_SHARP: dict[str, dict[str, Any]] = {
    "far-scene": {"disparity": (0.5, 6.0)},
    "bare-paint": {"textures": {"paint": 1.0}, "contrast": (0.3, 0.7)},
    "uneven-exposure": {"exposure": 0.8, "brightness": (0.5, 1.3)},
    "sensor-noise": {"noise": (14.0, 30.0), "brightness": (0.4, 0.9), "haze": (0.0, 0.0)},
    "haze": {"haze": (0.8, 2.0)},
    "scanned-street": {"scan_density": (0.05, 0.1)},
}
SOURCES: tuple[Domain, ...] = tuple(replace(d, **_SHARP.get(d.name, {})) for d in FORMER_SOURCES)

BASE_SETTINGS = TrainingSettings(
    epochs=1000,
    max_steps=20_000,
    batch=4,
    rate=2e-3,
    weight_decay=1e-4,
    freeze_batch_norm=False,
    augmentation=replace(Augmentation.none(), crop=CROP),
    seed=1,
    save_every=100,
    workers=0,
)
# The paper's epochs and batch, in the colours of their world: a world's camera is what a source learns, and
# jitter would teach every source the same.
SOURCE_SETTINGS = replace(
    BASE_SETTINGS,
    epochs=10,
    max_steps=MAX_STEPS,
    batch=8,
    rate=5e-4,
    weight_decay=1e-5,
    freeze_batch_norm=True,
)


@dataclass(frozen=True)
class DrawnPair:
    """One pair of a world, rendered when it is first read and kept in ``folder`` from then on (0.7 MB)."""

    world: Domain
    index: int
    split: str
    folder: Path

    @property
    def id(self) -> str:
        """World and number, such as ``haze-0007``."""
        return f"{self.world.name}-{self.index:04d}"

    def load(self) -> Sample:
        """Read the pair, or render it."""
        path = self.folder / f"{self.fingerprint()}.npz"
        names = ("left", "right", "disparity")
        sample = recall(path, lambda held: Sample(self.id, *(held[name] for name in names)))
        if sample is None:
            drawn = synthetic_pair(self.world, self.index, split=self.split)
            sample = Sample(self.id, drawn.left, drawn.right, drawn.disparity)
            keep(path, {name: getattr(drawn, name) for name in names})
        return sample

    def fingerprint(self) -> str:
        """SHA-256 (hex) of everything the pair is made from."""
        return hashlib.sha256(repr((SEED, self.split, self.index, self.world)).encode()).hexdigest()


def training_set(name: str, folder: Path) -> TrainingSet:
    """The pairs that the network of a world learns from; ``joint`` for all sources' together."""
    count = BASE_SCENES if name == BASE.name else SOURCE_SCENES
    pairs = tuple(DrawnPair(each, index, "train", folder) for each in _worlds(name) for index in range(count))
    return TrainingSet(name, pairs, expected=len(pairs), licence=LICENCE)


def held_out(name: str, folder: Path, pairs: int = HELD_OUT) -> Benchmark:
    """Pairs of a world that no training sees, so many of each; ``joint`` for all sources' worlds."""
    drawn = tuple(
        DrawnPair(each, index, "held-out", folder) for each in _worlds(name) for index in range(pairs)
    )
    return Benchmark(name, "pairs", drawn, "all-valid", "bad-3.0", licence=LICENCE)


def _worlds(name: str) -> tuple[Domain, ...]:
    return SOURCES if name == JOINT else tuple(each for each in (BASE, *SOURCES) if each.name == name)
