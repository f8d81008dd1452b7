"""``factory.toml``: base, training sets, validation, tests and budgets.

::

    name = "garage"
    base = "base.safetensors"
    architecture = "anynet"
    out = "runs/garage"                 # optional; beside the file otherwise
    joint = true                        # optional; one network on all training sets together, for comparison

    [options]                           # optional; the architecture's
    [training]                          # optional; settings of all trainings
    epochs = 10

    [sources.streets]
    data = "vkitti2"
    root = "/data/VirtualKITTI2"
    pairs = 2000                        # optional; the first so many
    [sources.streets.training]          # optional; what differs for this one

    [validation]                        # arguments of sfkit.open_benchmark
    name = "eth3d"
    root = "/data/ETH3D"

    [[tests]]
    name = "kitti2015"
    root = "/data/KITTI_2015"

    [search]                            # optional budgets; evaluations = 0 leaves Stage 2 out
    population = 30
    generations = 25
    evaluations = 300
    seed = 0
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from sfkit.bank.rendered import RenderedPair
from sfkit.datasets.benchmark import open_benchmark
from sfkit.datasets.benchmark_record import Benchmark
from sfkit.datasets.manifests import read_toml
from sfkit.datasets.synthetic import domains
from sfkit.datasets.training_set import TrainingSet
from sfkit.datasets.training_sets import open_training_set
from sfkit.errors import InputError, unknown_name
from sfkit.search import RoutingSettings, SubsetSettings
from sfkit.search.pipeline import Plan
from sfkit.training import TrainingSettings

KEYS = (
    "name",
    "base",
    "architecture",
    "out",
    "joint",
    "options",
    "training",
    "sources",
    "validation",
    "tests",
)
SOURCE_KEYS = ("data", "root", "pairs", "training", "licence", "all", "coding")
SEARCH_KEYS = ("population", "generations", "evaluations", "seed")
JOINT = "joint"


@dataclass(frozen=True)
class Order:
    """A source to be made.

    Attributes:
        name: the source's.
        data: what it learns from.
        settings: how.
        licence: of its weights; the training set's unless given.
    """

    name: str
    data: TrainingSet
    settings: TrainingSettings
    licence: str = ""


@dataclass(frozen=True)
class Factory:
    """A ``factory.toml`` as read; every data set was found, nothing was trained.

    Attributes:
        name: the pool's name.
        base: the checkpoint all sources start from.
        architecture: its name in the registry.
        options: the architecture's.
        orders: the sources, in the file's order.
        joint: the joint network, where one is wanted.
        validation: what the search looks at.
        tests: what it does not.
        plan: budgets of the search.
        out: the folder for all that is made.
    """

    name: str
    base: Path
    architecture: str
    options: Mapping[str, Any]
    orders: tuple[Order, ...]
    joint: Order | None
    validation: Benchmark
    tests: tuple[Benchmark, ...]
    plan: Plan
    out: Path


def read_factory(path: str | Path) -> Factory:
    """Read and check a ``factory.toml``; paths in it are relative to its folder.

    Raises:
        InputError: a key is unknown, missing or makes no sense, a data set or the base is not there, or a
            test is the validation benchmark.
    """
    path = Path(path)
    values = read_toml(path)
    _known(f"key of {path}", values, (*KEYS, "search"))
    for key in ("name", "base", "architecture", "sources", "validation"):
        if not values.get(key):
            raise InputError(f"{path}: the key {key} is missing, expected it")
    here = path.parent
    common = dict(values.get("training", {}))
    orders = tuple(_order(path, name, dict(entry), common) for name, entry in values["sources"].items())
    validation = _benchmark(path, "validation", values["validation"])
    tests = tuple(_benchmark(path, "tests", entry) for entry in values.get("tests", []))
    if any(test.fingerprint() == validation.fingerprint() for test in tests):
        raise InputError(f"{path}: {validation.name} is validation and test, expected other pairs to test on")
    return Factory(
        name=str(values["name"]),
        base=here / values["base"],
        architecture=str(values["architecture"]),
        options=dict(values.get("options", {})),
        orders=orders,
        joint=_joint(orders, common, path) if values.get("joint", False) else None,
        validation=validation,
        tests=tests,
        plan=_plan(path, dict(values.get("search", {}))),
        out=here / values.get("out", "."),
    )


def _order(path: Path, name: str, entry: dict[str, Any], common: Mapping[str, Any]) -> Order:
    where = f"[sources.{name}] in {path}"
    _known(f"key of {where}", entry, SOURCE_KEYS)
    if name == JOINT:
        raise InputError(f"{path}: found a source called {JOINT!r}, which names the joint network; rename it")
    data = _data(path, where, entry)
    if "pairs" in entry:
        data = data.first(int(entry["pairs"]))
    settings = TrainingSettings.from_dict({**common, **entry.get("training", {})}, where)
    return Order(name, data, settings, str(entry.get("licence", "")))


def _data(path: Path, where: str, entry: Mapping[str, Any]) -> TrainingSet:
    name = str(entry.get("data", ""))
    collection, colon, domain = name.partition(":")
    if collection == "bank" and colon:
        if domain not in domains():
            raise unknown_name("domain of the bank", domain, domains())
        pairs = tuple(RenderedPair(domain, index, "train") for index in range(int(entry.get("pairs", 160))))
        return TrainingSet(name, pairs, licence="Apache-2.0")
    if "root" not in entry:
        raise InputError(f"{where}: the key root is missing, expected the folder of {name!r}")
    root = path.parent / Path(str(entry["root"])).expanduser()
    return open_training_set(name, root, hold_out=not entry.get("all", False), coding=entry.get("coding"))


def _benchmark(path: Path, where: str, entry: Mapping[str, Any]) -> Benchmark:
    given = dict(entry)
    if "root" in given:
        given["root"] = path.parent / Path(str(given["root"])).expanduser()
    try:
        return open_benchmark(**given)
    except TypeError as error:
        raise InputError(f"{path}: {where}: {error}, expected arguments of open_benchmark") from error


def _joint(orders: tuple[Order, ...], common: Mapping[str, Any], path: Path) -> Order:
    pairs = tuple(pair for order in orders for pair in order.data.pairs)
    licence = "; ".join(dict.fromkeys(order.licence or order.data.licence for order in orders))
    data = TrainingSet(JOINT, pairs, licence=licence)
    return Order(JOINT, data, TrainingSettings.from_dict(common, f"[training] in {path}"))


def _plan(path: Path, search: dict[str, Any]) -> Plan:
    _known(f"key of [search] in {path}", search, SEARCH_KEYS)
    seed = int(search.get("seed", 0))
    first, second = SubsetSettings(seed=seed), RoutingSettings(seed=seed)
    first = replace(
        first,
        population=int(search.get("population", first.population)),
        generations=int(search.get("generations", first.generations)),
    )
    budget = int(search.get("evaluations", second.evaluations))
    return Plan(stage1=first, stage2=replace(second, evaluations=budget) if budget else None)


def _known(what: str, values: Mapping[str, Any], allowed: tuple[str, ...]) -> None:
    for key in values:
        if key not in allowed:
            raise unknown_name(what, key, allowed)
