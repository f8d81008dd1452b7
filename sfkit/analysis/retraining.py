"""Retraining on the union of all data against merging what is there: the paper's motivation (figure 1)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from sfkit.analysis.costs import JOINT, or_unknown
from sfkit.analysis.labels import points
from sfkit.analysis.measured import Measured
from sfkit.analysis.paired import common_unit
from sfkit.analysis.study import UNIFORM, Study
from sfkit.checkpoints.spec import Member
from sfkit.errors import InputError, ensure_known
from sfkit.evaluation.outcome import total_known
from sfkit.merging.opening import open_pool
from sfkit.merging.pool import Pool


@dataclass(frozen=True)
class Way:
    """One way to one network for all domains.

    Attributes:
        name: such as ``joint retraining``.
        score: mean over the benchmarks, lower is better.
        seconds: what it takes when data of a new source come in and all else is there; NaN where not known.
        joint: True for the network that was trained on the union of all data.
        cpu_seconds: the same of processors; NaN where not known.
    """

    name: str
    score: float
    seconds: float
    joint: bool = False
    cpu_seconds: float = math.nan


@dataclass(frozen=True)
class Retraining:
    """Ways to one network beside joint retraining.

    Attributes:
        ways: joint retraining first.
        benchmarks: what the scores are means over.
        unit: of the scores.
    """

    ways: tuple[Way, ...]
    benchmarks: tuple[str, ...]
    unit: str

    def table(self) -> pd.DataFrame:
        """A row a way: its mean, how it differs from joint retraining, its seconds, the share of wall."""
        joint = self.ways[0]
        rows = [
            {
                "way": way.name,
                f"mean ({self.unit})": way.score,
                f"to joint retraining ({points(self.unit)})": way.score - joint.score,
                "wall seconds": way.seconds,
                "CPU seconds": way.cpu_seconds,
                "of joint retraining (%)": 100.0 * way.seconds / joint.seconds,
            }
            for way in self.ways
        ]
        return pd.DataFrame(rows).set_index("way")


def retraining_against_merging(
    measured: Sequence[Measured],
    joint: str,
    seconds: Mapping[str, float],
    *,
    others: Sequence[str] = (),
    cpu_seconds: Mapping[str, float | None] | None = None,
) -> Retraining:
    """A network trained on all data at once beside networks that were merged.

    Args:
        measured: benchmarks that guided nothing, with all these networks.
        joint: the network that was trained on the union of the sources' data.
        seconds: network -> what it takes once a new source's data are there: for ``joint`` the whole
            training, for a merge the new source's fine-tuning and the search; on one kind of machine.
        others: the merged networks; all of ``seconds`` but ``joint`` unless given.
        cpu_seconds: network -> the same of processors, where that is known.

    Raises:
        InputError: no benchmark, a network that was not measured, no positive time of ``joint``, or metrics
            of different units.
    """
    if not measured:
        raise InputError("retraining: found no benchmark, expected at least one that guided nothing")
    names = (joint, *(others or [name for name in seconds if name != joint]))
    for name in names:
        ensure_known("measured network", name, measured[0].networks)
    if not seconds.get(joint, 0.0) > 0.0:
        raise InputError(f"retraining: found no positive seconds of {joint!r}, expected its training's")
    ways = tuple(
        Way(
            name,
            math.fsum(one.score(name) for one in measured) / len(measured),
            seconds.get(name, math.nan),
            name == joint,
            or_unknown((cpu_seconds or {}).get(name)),
        )
        for name in names
    )
    return Retraining(ways, tuple(one.benchmark for one in measured), common_unit(measured, None))


def open_joint(pool: Pool, file: str | Path, seconds: float | None, training: Mapping[str, float]) -> Pool:
    """A network that was trained on all sources' data at once, and whether its times are known.

    Args:
        pool: the sources; the checkpoint is of its architecture.
        file: the checkpoint.
        seconds: what its training took.
        training: source -> seconds its fine-tuning took.

    Returns:
        A pool with ``pool``'s base whose one source is the network.

    Raises:
        InputError: the checkpoint does not fit the pool, or one of the times is missing.
    """
    if not training:
        raise InputError(
            "joint: found no seconds of any fine-tuning, expected source -> seconds in training_seconds"
        )
    if seconds is None or not seconds > 0.0:
        raise InputError(
            f"joint: found {seconds} seconds of its training, expected a positive number in joint_seconds"
        )
    return open_pool(replace(pool.spec, sources=(Member("joint", Path(file)),)))


def study_against_joint(
    study: Study,
    joint: Pool,
    seconds: float,
    training: Mapping[str, float],
    *,
    training_cpu: Mapping[str, float] | None = None,
    joint_cpu: float | None = None,
) -> Retraining:
    """A study's recommended network and its equal mixture beside one trained on all sources' data at once.

    A merge is charged the longest fine-tuning, as if that source were the new one, and its own search;
    uniform needs no search.

    Args:
        study: the methods, measured.
        joint: that network, from :func:`open_joint`.
        seconds: its training's, on the machine the fine-tunings were timed on.
        training: source -> seconds its fine-tuning took.
        training_cpu: source -> CPU seconds of that, where they are known.
        joint_cpu: CPU seconds of the joint training, where they are known.

    Raises:
        InputError: as :func:`retraining_against_merging`.
    """
    pool, chosen = study.experiment.pool, study.chosen
    networks = {
        JOINT: (joint, joint.equal(*joint.names)),
        UNIFORM: (pool, pool.uniform()),
        chosen: (study.result.pool, study.result.recipe),
    }
    measured = [one for one in study.experiment.measured(networks) if not one.validation]
    longest = max(training, key=lambda source: training[source])
    new, worked = training[longest], (training_cpu or {}).get(longest)
    spent = {JOINT: seconds, UNIFORM: new, chosen: new + study.result.seconds}
    cpu = {JOINT: joint_cpu, UNIFORM: worked, chosen: total_known([worked, study.result.cpu_seconds])}
    return retraining_against_merging(measured, JOINT, spent, cpu_seconds=cpu)
