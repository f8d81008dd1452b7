"""Run a factory: train what is missing, open the pool, search, score; killed anywhere it goes on."""

from __future__ import annotations

import json
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import pandas as pd

from sfkit.analysis.networks import measure_files
from sfkit.analysis.trust import Trust, trust_of
from sfkit.datasets.benchmark_record import Benchmark
from sfkit.datasets.pairs import Pair, StereoPair
from sfkit.errors import SfkitWarning
from sfkit.evaluation import Compute, EvaluationStore, Evaluator
from sfkit.evaluation.combining import combined
from sfkit.evaluation.outcome import total_known
from sfkit.factory.file import JOINT, MERGED, SEARCHED, Factory
from sfkit.factory.outputs import COSTS, MADE_BY, POOL, SCORES, SEARCH, STORE, ensure_own
from sfkit.factory.searching import begin, end
from sfkit.factory.standing import Item, files_of, status
from sfkit.factory.training import Say, train_missing
from sfkit.files import write_text
from sfkit.merging import Pool, open_pool
from sfkit.outside import toml_value
from sfkit.search.pipeline import SearchResult, search_pool
from sfkit.search.progress import generation_note
from sfkit.search.records import Generation


@dataclass(frozen=True)
class Cost:
    """What one part of a factory took, in all sittings together.

    Attributes:
        part: a source's name, ``joint``, or ``search``.
        passes: of a training, pairs shown forward and backward; of the search, forward alone.
        seconds: on the clock; of the search, of its evaluations when they were computed.
        cpu_seconds: the same of processors, workers' included; None where nobody measured one of them.
    """

    part: str
    passes: int
    seconds: float
    cpu_seconds: float | None = None


@dataclass(frozen=True)
class FactoryResult:
    """What a factory made.

    Attributes:
        items: its networks as they now are.
        pool: the pool's file.
        found: what the search found.
        scores: network -> benchmark -> score in the benchmark's metric, lower is better.
        costs: of the sources, the joint network and the search.
        trained: the networks that this call trained.
        evaluated: how many evaluations the store gained.
        trust: how far a guide without ground truth may be trusted; None where every guide has labels.
    """

    items: tuple[Item, ...]
    pool: Path
    found: SearchResult
    scores: dict[str, dict[str, float]]
    costs: tuple[Cost, ...]
    trained: tuple[str, ...]
    evaluated: int
    trust: Trust | None = None

    def overhead(self) -> dict[str, float]:
        """The search's seconds in percent of the sources' training, and of the joint network's where it is.

        The paper's table of costs has the latter. Both are seconds of one factory; they mean little where its
        trainings and its search ran on different machines.
        """
        seconds = {cost.part: cost.seconds for cost in self.costs}
        search, joint = seconds.pop(SEARCHED), seconds.pop(JOINT, None)
        total = math.fsum(seconds.values())
        found = {"sources": 100.0 * search / total} if total else {}  # records of trainings may be gone
        return {**found, JOINT: 100.0 * search / joint} if joint else found


def run(
    factory: Factory,
    *,
    devices: Sequence[str] = ("cpu",),
    compute: Compute | None = None,
    say: Say = lambda _: None,
) -> FactoryResult:
    """Make what a factory lacks; a second call finds all of it done, a new source costs its own share.

    Writes below ``factory.out``: ``sources/``, ``pool.toml``, ``evaluations.sqlite``, ``search/``,
    ``scores.json``, ``costs.csv`` and ``factory.json``.

    Args:
        factory: from :func:`~sfkit.factory.file.read_factory`.
        devices: where networks are trained, one on each at a time.
        compute: where the search evaluates; its first device unless given. With the engine ``ray`` the
            trainings are spread over the cluster too.
        say: told how it goes.

    Warns (:class:`~sfkit.errors.SfkitWarning`) where a guide without ground truth is not to be trusted.

    Raises:
        InputError: files that no factory made would be replaced, another process trains one of the networks
            or searches, and what :func:`~sfkit.training.finetune.finetune` and the search refuse.
        SfkitError: a training failed.
    """
    compute = compute or Compute(devices[0])
    # Before hours of training, which a refusal at the end would have cost.
    ensure_own(factory)
    warn_of_seen_pairs(factory)
    trained = train_missing(factory, devices=devices, ray=compute.engine == "ray", say=say)
    pool_file = write_text(factory.out / POOL, pool_toml(factory))
    pool = open_pool(pool_file)
    files = {item.name: item.file for item in status(factory)}
    begin(factory, files)
    with EvaluationStore(factory.out / STORE) as store:
        before = len(store)
        guides = [Evaluator(pool, guide, store=store, compute=compute) for guide in factory.validation]
        scorer = combined(guides, factory.combine)
        # A source that was added makes another search, whose result is to take the former one's place.
        most = factory.plan.candidates(pool)

        def advance(stage: str, generation: Generation[Any]) -> None:
            done = generation.counts.candidates  # more than a model may propose, where it knew many before
            of = f" of {most[stage]}" if done <= most[stage] else ""
            say(f"{stage}: {done}{of}, {generation_note(generation)}")

        found = search_pool(pool, scorer, factory.plan, factory.out / SEARCH, force=True, progress=advance)
        tests = [Evaluator(pool, test, store=store, compute=compute) for test in factory.tests]
        scores = _scores(factory, pool, found, guides, tests, compute)
        trusted = trust_of(pool, guides, found.recipe, tests)
        evaluated = len(store) - before
    write_text(factory.out / SCORES, json.dumps(scores, indent=2) + "\n")
    items = status(factory)
    costs = (*_training_costs(factory, items), _search_cost(factory, found))
    table = pd.DataFrame([asdict(cost) for cost in costs])
    write_text(factory.out / COSTS, table.to_csv(index=False))
    end(factory, files)
    return FactoryResult(items, pool_file, found, scores, costs, trained, evaluated, trusted)


def pool_toml(factory: Factory) -> str:
    """The text of the pool's file; its paths are absolute."""
    root = factory.out.resolve()
    options = "".join(f"{key} = {toml_value(value)}\n" for key, value in factory.options.items())
    lines = [
        f"name = {toml_value(factory.name)}",
        f"architecture = {toml_value(factory.architecture)}",
        *([] if factory.code is None else [f"module = {toml_value(str(factory.code))}"]),
        # Sources lie in the factory's folder, the base anywhere.
        'root = "/"',
        f"\n[options]\n{options}" if options else "",
        f"[base]\nfile = {toml_value(str(factory.base.resolve()))}",
    ]
    files = files_of(factory, factory.orders)
    for order in factory.orders:
        file, made = files[order.name]
        lines.append(
            f"\n[sources.{toml_value(order.name)}]\nfile = {toml_value(str(root / file.resolve()))}\n"
            + (f"licence = {toml_value(made['licence'])}" if made["licence"] else "")
        )
    return MADE_BY + "\n".join(lines) + "\n"


def warn_of_seen_pairs(factory: Factory) -> None:
    """A source that learned validation's or a test's ground truth looks better there than it is."""
    for order in factory.networks:
        learned = {_identity(pair) for pair in order.data.pairs}
        for benchmark in (*factory.validation, *factory.tests):
            shared = sum(_identity(pair) in learned for pair in benchmark.pairs)
            if shared:
                warnings.warn(
                    f"{factory.file}: {order.name} is trained on {shared} of {len(benchmark)} pairs of "
                    f"{benchmark.name}, which then prefers it for what it has seen; train on other pairs, or "
                    "validate and test elsewhere",
                    SfkitWarning,
                    stacklevel=3,
                )


def _identity(pair: Pair) -> object:
    # By image: whatever ground truth is read with it, the pair was seen.
    return pair.left.resolve() if isinstance(pair, StereoPair) else pair.fingerprint()


def _scores(
    factory: Factory,
    pool: Pool,
    found: SearchResult,
    guides: Sequence[Evaluator],
    tests: Sequence[Evaluator],
    compute: Compute,
) -> dict[str, dict[str, float]]:
    recipes = {"base": pool.base_recipe(), "uniform": pool.uniform(), MERGED: found.recipe}
    recipes |= {name: pool.equal(name) for name in pool.names}
    scores: dict[str, dict[str, float]] = {name: {} for name in recipes}
    joint = None if factory.joint is None else files_of(factory, [factory.joint])[JOINT][0]
    for evaluator in (*guides, *tests):
        benchmark = evaluator.benchmark
        for name, outcome in zip(recipes, evaluator(list(recipes.values())), strict=True):
            scores[name][benchmark.name] = outcome.score
        evaluator.release()  # one network in memory at a time
        if joint is not None:
            scores.setdefault(JOINT, {})[benchmark.name] = _joint_score(factory, joint, benchmark, compute)
    return scores


def _joint_score(factory: Factory, file: Path, benchmark: Benchmark, compute: Compute) -> float:
    """The joint network is no member of the pool: merging knows nothing of it."""
    measured = measure_files(
        {JOINT: file},
        benchmark,
        architecture=factory.architecture,
        options=factory.options,
        compute=compute,
    )
    return measured.score(JOINT)


def _training_costs(factory: Factory, items: Sequence[Item]) -> list[Cost]:
    batches: Mapping[str, int] = {order.name: order.settings.batch for order in factory.networks}
    return [
        Cost(i.name, i.steps * batches[i.name], i.seconds, i.cpu_seconds)
        for i in items
        if i.seconds is not None
    ]


def _search_cost(factory: Factory, found: SearchResult) -> Cost:
    """Of every recipe once, whatever the store held already."""
    images = sum(len(guide) for guide in factory.validation)
    files = [found.folder / name for name in ("stage1.csv", "stage2.csv")]
    rows = pd.concat([pd.read_csv(path) for path in files if path.exists()])
    # What both stages scored stands in both tables.
    seconds: dict[str, float] = dict(zip(rows["key"], rows["seconds"], strict=True))
    worked = {
        # An empty cell is read as NaN, which differs from itself.
        key: None if value != value else value
        for key, value in zip(rows["key"], rows["cpu_seconds"], strict=True)
    }
    if found.averaged is not None:
        last = found.averaged.outcome
        seconds.setdefault(last.key, last.seconds)
        worked.setdefault(last.key, last.cpu_seconds)
    took = math.fsum(seconds.values()), total_known(worked.values())
    return Cost(SEARCHED, len(seconds) * images, *took)
