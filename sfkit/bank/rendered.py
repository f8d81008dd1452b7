"""The bank's benchmarks: pairs that are rendered from their seeds when they are first asked for."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

from sfkit.bank import sharp
from sfkit.bank.kept import keep, recall
from sfkit.bank.plan import BANK, bank_plan
from sfkit.datasets import Benchmark, Sample
from sfkit.datasets.synthetic import domains, synthetic_pair, worlds
from sfkit.datasets.synthetic.domains import HEIGHT, QUICK_PAIRS, VALIDATION, WIDTH
from sfkit.datasets.synthetic.pairs import SEED
from sfkit.datasets.training_set import TrainingSet
from sfkit.errors import InputError, ensure_known
from sfkit.files import default_folder

METRIC = "bad-3.0"
PROTOCOL = "all-valid"
RENDERER = "1"
"""Raise it whenever a rendered pair changes by more than rounding: scores of before then no longer count."""


@dataclass(frozen=True)
class RenderedPair:
    """One pair of a synthetic world, known by its seed; rendered once a process.

    Its fingerprint names world, seed and renderer instead of the pixels, because pixels may differ by
    rounding from machine to machine; ``sfkit.bank.fingerprints`` checks the pixels within a tolerance.
    """

    world: str
    index: int
    split: str = "benchmark"

    @property
    def id(self) -> str:
        """World and number, such as ``courtyard-07``."""
        return f"{self.world}-{self.index:02d}"

    def load(self) -> Sample:
        """Render the pair, or recall it; callers do not write into it."""
        return _render(self.world, self.index, self.split)

    def fingerprint(self) -> str:
        """SHA-256 (hex) of everything the pair is made from."""
        world = {**domains(), **worlds()}[self.world]
        made_from = (RENDERER, SEED, HEIGHT, WIDTH, self.split, self.index, self.id, repr(world))
        return hashlib.sha256(repr(made_from).encode()).hexdigest()


def benchmarks() -> tuple[str, ...]:
    """The names of the bank's benchmarks, the validation benchmark first."""
    return tuple(worlds())


def benchmark(name: str, quick: bool = False, *, of: str = BANK.name) -> Benchmark:
    """The benchmark ``name`` of the bank ``of``, 192 x 384; nothing is rendered before a pair is loaded.

    The banks' benchmarks are the same worlds and pairs, 40 of each, so that their networks can be compared.
    ``quick`` keeps the first 8 pairs of the validation benchmark. Scores are bad-3.0 in percent over all
    pixels with ground truth, mean over images.

    Raises:
        InputError: an unknown name, or ``quick`` for a benchmark that searches must not see.
    """
    ensure_known("benchmark of the bank", name, worlds())
    if quick and name != VALIDATION:
        raise InputError(
            f"benchmark {name!r}: found quick=True, expected it for the validation benchmark only; "
            f"use {VALIDATION!r} or all pairs"
        )
    count = bank_plan(of).pairs
    return _benchmark(name, QUICK_PAIRS if quick else count, "benchmark", count)


def held_out(name: str, pairs: int, *, of: str = BANK.name) -> Benchmark:
    """The first ``pairs`` held-out pairs of the domain ``name`` of the bank ``of``, which no training saw.

    Raises:
        InputError: an unknown domain.
    """
    if _is_sharp(name, of):
        return sharp.held_out(name, _folder(), pairs)
    return _benchmark(name, pairs, "held-out", pairs)


def training_set(name: str, pairs: int, *, of: str = BANK.name) -> TrainingSet:
    """The first ``pairs`` pairs that the source ``name`` of the bank ``of`` learns from.

    Raises:
        InputError: an unknown domain, or fewer pairs than that.
    """
    if not _is_sharp(name, of):
        drawn = tuple(RenderedPair(name, index, "train") for index in range(pairs))
        return TrainingSet(f"{of}:{name}", drawn, licence=sharp.LICENCE)
    whole = sharp.training_set(name, _folder())
    if pairs > len(whole.pairs):
        raise InputError(f"{of}:{name}: found pairs = {pairs}, expected at most {len(whole.pairs)}")
    return TrainingSet(f"{of}:{name}", whole.pairs[:pairs], licence=whole.licence)


def _is_sharp(name: str, of: str) -> bool:
    """Whether the bank ``of`` draws its domains as the sharp one does; refuses a domain that it has not."""
    names = [world.name for world in bank_plan(of).worlds]
    ensure_known("domain of the bank", name, names)
    return bank_plan(of).worlds[0] == sharp.BASE


def _benchmark(name: str, pairs: int, split: str, expected: int) -> Benchmark:
    world = {**domains(), **worlds()}[name]
    return Benchmark(
        name=name,
        family="pairs",
        pairs=tuple(RenderedPair(name, index, split) for index in range(pairs)),
        protocol=PROTOCOL,
        metric=METRIC,
        expected=expected,
        licence="Apache-2.0",
        notes=(f"rendered: {world.about}",),
    )


# All pairs of four benchmarks stay: every candidate of a search asks for them again.
@lru_cache(maxsize=256)
def _render(world: str, index: int, split: str) -> Sample:
    """One pair, from memory, from the cache on disk, or rendered and kept there (0.8 MB)."""
    pair = RenderedPair(world, index, split)
    path = _folder() / f"{pair.fingerprint()}.npz"
    names = ("left", "right", "disparity", "nonoccluded")
    # Kept, for rendering takes many times as long as reading.
    sample = recall(path, lambda held: Sample(pair.id, *(held[name] for name in names)))
    if sample is None:
        drawn = synthetic_pair({**domains(), **worlds()}[world], index, split=split)
        sample = Sample(pair.id, drawn.left, drawn.right, drawn.disparity, drawn.nonoccluded)
        keep(path, {name: np.asarray(getattr(sample, name)) for name in names})
    return sample


def _folder() -> Path:
    return default_folder() / "rendered"
