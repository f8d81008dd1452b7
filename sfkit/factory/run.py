"""Run a factory: train what is missing, open the pool, search, score; killed anywhere it goes on."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import torch

from sfkit.datasets.benchmark_record import Benchmark
from sfkit.evaluation import EvaluationStore, Evaluator
from sfkit.factory.file import JOINT, Factory
from sfkit.factory.status import DONE, Item, file_of, status
from sfkit.files import write_text
from sfkit.merging import Pool, open_pool
from sfkit.merging.network import load_network
from sfkit.search.pipeline import Found, search_pool
from sfkit.training.finetune import finetune
from sfkit.training.loop import Course
from sfkit.training.scoring import scorer_of

Say = Callable[[str], None]


@dataclass(frozen=True)
class Made:
    """What a factory made.

    Attributes:
        items: its networks as they now are.
        pool: the pool's file.
        found: what the search found.
        scores: network -> benchmark -> score in the benchmark's metric, lower is better.
        trained: the networks that this call trained.
        evaluated: how many evaluations the store gained.
    """

    items: tuple[Item, ...]
    pool: Path
    found: Found
    scores: dict[str, dict[str, float]]
    trained: tuple[str, ...]
    evaluated: int


def run(factory: Factory, *, device: str = "cpu", say: Say = lambda _: None) -> Made:
    """Make what a factory lacks; a second call finds all of it done, a new source costs its own share.

    Writes below ``factory.out``: ``sources/``, ``pool.toml``, ``evaluations.sqlite``, ``search/`` and
    ``scores.json``.

    Raises:
        InputError: what :func:`~sfkit.training.finetune.finetune` and the search refuse.
    """
    trained = _train(factory, device, say)
    pool_file = write_text(factory.out / "pool.toml", pool_toml(factory))
    pool = open_pool(pool_file)
    store = EvaluationStore(factory.out / "evaluations.sqlite")
    before = len(store)
    scorer = Evaluator(pool, factory.validation, store=store)
    # A source that was added makes another search, whose result is to take the former one's place.
    found = search_pool(pool, scorer, factory.plan, factory.out / "search", force=True)
    scores = _scores(factory, pool, found, store, device)
    write_text(factory.out / "scores.json", json.dumps(scores, indent=2) + "\n")
    return Made(status(factory), pool_file, found, scores, trained, len(store) - before)


def _train(factory: Factory, device: str, say: Say) -> tuple[str, ...]:
    orders = {order.name: order for order in (*factory.orders, *([factory.joint] if factory.joint else ()))}
    trained = []
    for item in status(factory):
        if item.state == DONE:
            continue
        order = orders[item.name]
        say(f"{item.name}: {item.state}, {order.data.coverage}, {item.steps} steps")
        finetune(
            factory.base,
            order.data,
            item.file,
            name=factory.architecture,
            options=factory.options,
            settings=order.settings,
            device=device,
            licence=order.licence,
            listen=_listener(item.name, say),
        )
        trained.append(item.name)
    return tuple(trained)


def _listener(name: str, say: Say) -> Callable[[Course], None]:
    def hear(course: Course) -> None:
        if course.done % 50 == 0 or course.done == course.steps:
            left = course.seconds / course.done * (course.steps - course.done)
            say(f"{name}: step {course.done} of {course.steps}: {left:.0f} s left")

    return hear


def pool_toml(factory: Factory) -> str:
    """The text of the pool's file; its paths are absolute."""
    root = factory.out.resolve()
    options = "".join(f"{key} = {json.dumps(value)}\n" for key, value in factory.options.items())
    lines = [
        f"name = {json.dumps(factory.name)}",
        f"architecture = {json.dumps(factory.architecture)}",
        'root = "/"',
        f"\n[options]\n{options}" if options else "",
        f"[base]\nfile = {json.dumps(str(factory.base.resolve()))}",
    ]
    for order in factory.orders:
        file, made = file_of(factory, order)
        lines.append(
            f"\n[sources.{order.name}]\nfile = {json.dumps(str(root / file.resolve()))}\n"
            + (f"licence = {json.dumps(made['licence'])}" if made["licence"] else "")
        )
    return "\n".join(lines) + "\n"


def _scores(
    factory: Factory, pool: Pool, found: Found, store: EvaluationStore, device: str
) -> dict[str, dict[str, float]]:
    recipes = {"base": pool.base_recipe(), "uniform": pool.uniform(), "merged": found.recipe}
    recipes |= {name: pool.equal(name) for name in pool.names}
    scores: dict[str, dict[str, float]] = {name: {} for name in recipes}
    for benchmark in (factory.validation, *factory.tests):
        outcomes = Evaluator(pool, benchmark, store=store)(list(recipes.values()))
        for name, outcome in zip(recipes, outcomes, strict=True):
            scores[name][benchmark.name] = outcome.score
        if factory.joint is not None:
            scores.setdefault(JOINT, {})[benchmark.name] = _joint_score(factory, benchmark, device)
    return scores


def _joint_score(factory: Factory, benchmark: Benchmark, device: str) -> float:
    """The joint network is no member of the pool: merging knows nothing of it."""
    assert factory.joint is not None
    loaded = load_network(
        file_of(factory, factory.joint)[0], name=factory.architecture, options=factory.options
    )
    place = torch.device(device)
    return scorer_of(benchmark, loaded.inputs, place)(loaded.network.to(place))[0]
