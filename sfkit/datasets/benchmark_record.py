"""The benchmark record: stereo pairs with ground truth, and what to measure on them."""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sfkit.cards import card
from sfkit.datasets.metric import Metric, metrics_of
from sfkit.datasets.pairs import MemoryPair, Pair, Sample, StereoPair, is_labelled
from sfkit.datasets.protocols import Rule, default_metric, rule
from sfkit.errors import InputError, unknown_name


@dataclass(frozen=True)
class Benchmark:
    """Pairs with ground truth, a protocol that says which pixels count, and the metric to report.

    Attributes:
        name: the data set's name, or the caller's for folders and rendered pairs.
        family: which of a protocol's rules applies: ``eth3d``, ``kitti``, ``middlebury`` or ``pairs``.
        pairs: at least one; the order is the order of all per-image results.
        protocol: see :mod:`sfkit.datasets.protocols`.
        metric: ``epe`` (pixels), ``d1``, ``bad-T`` (percent) or a registered one, in its one spelling.
        resolution: ``F``, ``H`` or ``Q`` for Middlebury, else None.
        own_metric: what the data set itself reports; that of ``metric`` where it has none.
        expected: how many pairs the whole data set has, None where that is not known.
        root: the folder the files lie in, None for pairs in memory.
        citation: what to cite where results are shown.
        licence: the terms of the data.
        notes: what a reader of results should know, such as grey images in the place of colour.
    """

    name: str
    family: str
    pairs: tuple[Pair, ...]
    protocol: str
    metric: str
    resolution: str | None = None
    own_metric: str = ""
    expected: int | None = None
    root: Path | None = None
    citation: str = ""
    licence: str = ""
    notes: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        allowed = self.rule.resolutions
        if allowed and self.resolution not in allowed:
            raise InputError(
                f"benchmark {self.name!r}: found resolution {self.resolution}, protocol {self.protocol!r} "
                f"expected {' or '.join(allowed)}; change the resolution or the protocol"
            )
        # One spelling, by which keys, tables and comparisons go.
        object.__setattr__(self, "metric", Metric.parse(self.metric).name)
        object.__setattr__(self, "own_metric", Metric.parse(self.own_metric or self.metric).name)
        if not self.pairs:
            raise InputError(f"benchmark {self.name!r}: found no pair, expected at least one")
        ids = [pair.id for pair in self.pairs]
        if twice := sorted({i for i in ids if ids.count(i) > 1}):
            raise InputError(f"benchmark {self.name!r}: found the ids {twice} twice, expected each once")

    def __len__(self) -> int:
        return len(self.pairs)

    @property
    def ids(self) -> tuple[str, ...]:
        """The pairs' names, in order."""
        return tuple(pair.id for pair in self.pairs)

    @property
    def rule(self) -> Rule:
        """What its protocol says about its family: which pixels count, and how images become one number."""
        return rule(self.protocol, self.family)

    @property
    def labelled(self) -> bool:
        """Whether every pair has ground truth, which metrics other than ``census`` compare with."""
        return all(is_labelled(pair) for pair in self.pairs)

    def measurable(self, metrics: Iterable[str | Metric]) -> tuple[Metric, ...]:
        """Those of some metrics that its pairs can be measured by: without ground truth, what needs none."""
        asked = metrics_of(*metrics)
        return tuple(asked) if self.labelled else tuple(one for one in asked if not one.needs_truth)

    def ensure_measurable(self, metrics: Iterable[str | Metric]) -> None:
        """Refuse metrics that its pairs cannot be measured by.

        Raises:
            InputError: there is no ground truth, which a metric needs.
        """
        measured = self.measurable(metrics)
        lost = [one.name for one in metrics_of(*metrics) if one not in measured]
        if lost:
            raise InputError(
                f"benchmark {self.name!r}: {', '.join(lost)} needs ground truth and its pairs have none, "
                "expected census"
            )

    @property
    def coverage(self) -> str:
        """How much of the data set is here, such as ``1 of 27 pairs``."""
        total = "" if self.expected is None else f" of {self.expected}"
        return f"{len(self)}{total} pair{'s' if (self.expected or len(self)) != 1 else ''}"

    def samples(self) -> Iterator[Sample]:
        """Load the pairs one after another; nothing is kept."""
        for pair in self.pairs:
            yield pair.load()

    def first(self, n: int) -> Benchmark:
        """A benchmark of the first ``n`` pairs (all of them where there are fewer).

        Raises:
            InputError: ``n`` is below 1.
        """
        if n < 1:
            raise InputError(f"benchmark {self.name!r}: found n = {n}, expected at least 1 pair")
        return replace(self, pairs=self.pairs[:n])

    def select(self, ids: Iterable[str]) -> Benchmark:
        """A benchmark of the named pairs, in this benchmark's order.

        Raises:
            InputError: an id that is not here, or none at all.
        """
        wanted = set(ids)
        for name in sorted(wanted - set(self.ids)):
            raise unknown_name(f"pair of benchmark {self.name!r}", name, self.ids)
        return replace(self, pairs=tuple(pair for pair in self.pairs if pair.id in wanted))

    def measured_by(self, *, protocol: str | None = None, metric: str | None = None) -> Benchmark:
        """The same pairs under another protocol or metric.

        Without ``metric``, the protocol's own metric replaces that of the protocol before; a metric that
        was chosen otherwise stays.

        Raises:
            InputError: an unknown protocol or metric, or a protocol that does not fit the resolution.
        """
        protocol = protocol or self.protocol
        # A default gives way to the new protocol's; a metric that somebody chose stays.
        if metric is None and self.metric == default_metric(self.protocol, self.family, self.own_metric):
            metric = default_metric(protocol, self.family, self.own_metric)
        return replace(self, protocol=protocol, metric=metric or self.metric)

    def ensure_scorable(self) -> None:
        """Check before long work that every pair on disk has what the protocol asks for.

        Raises:
            InputError: ground truth or an occlusion mask that the protocol needs is missing.
        """
        if not Metric.parse(self.metric).needs_truth:
            return
        for pair in self.pairs:
            if isinstance(pair, StereoPair) and pair.disparity is None:
                raise InputError(
                    f"{pair.id}: found no ground truth for {pair.left}, expected a disparity file for "
                    f"{self.metric}, or the metric census, which needs none"
                )
            masked = pair.mask if isinstance(pair, StereoPair) else True
            # What is in memory has its mask with it, or none.
            if isinstance(pair, MemoryPair):
                masked = pair.sample.nonoccluded is not None
            if self.rule.visible_only and not masked:
                raise self.rule.mask_missing(
                    pair.id, pair.disparity if isinstance(pair, StereoPair) else None
                )

    def fingerprint(self) -> str:
        """SHA-256 (hex) over the content, ids and codings of all pairs, in order; paths do not matter."""
        digest = hashlib.sha256()
        for pair in self.pairs:
            digest.update(pair.fingerprint().encode())
        return digest.hexdigest()

    def describe(self) -> dict[str, Any]:
        """Plain values: what is measured, on how much of the data set, and whose data it is."""
        return {
            "name": self.name,
            "family": self.family,
            "pairs": len(self),
            "expected": self.expected,
            "protocol": self.protocol,
            "metric": self.metric,
            "unit": Metric.parse(self.metric).unit,
            "resolution": self.resolution,
            "citation": self.citation,
            "licence": self.licence,
            "notes": list(self.notes),
        }

    def _repr_html_(self) -> str:
        shown = ", ".join(self.ids[:4]) + (", …" if len(self) > 4 else "")
        facts = {
            "pairs": f"{self.coverage}: {shown}",
            "metric": f"{self.metric}, under protocol {self.protocol}",
            "resolution": self.resolution,
            "licence": self.licence,
            "to cite": self.citation,
            "note": "; ".join(self.notes),
        }
        return card(f"Benchmark {self.name}", facts)

    def __str__(self) -> str:
        size = f", resolution {self.resolution}" if self.resolution else ""
        return f"{self.name}: {self.coverage}{size}, {self.metric} under protocol {self.protocol}"
