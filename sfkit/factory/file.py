"""``factory.toml``: base, training sets, validation, tests and budgets.

::

    name = "garage"
    base = "base.safetensors"
    architecture = "anynet"
    module = "nets/mine.py"             # optional; the Python file that registers it, which is run
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

    [validation]                        # arguments of sfkit.open_benchmark; several as [[validation]]
    name = "eth3d"
    root = "/data/ETH3D"                # without ground truth: name = "unlabelled"

    [[tests]]
    name = "kitti2015"
    root = "/data/KITTI_2015"

    [search]                            # optional; sizes are the method's own unless given
    method = "paper"                    # or "bayesian"
    population = 50
    generations = 15
    batch = 1                           # by "bayesian": how many are proposed at a time
    evaluations = 300                   # 0 leaves Stage 2 out
    combine = "mean"                    # of several validation benchmarks, or "worst"
    seed = 0
    resamples = 0                       # of the validation pairs, whose winners are averaged; of two or more
                                        # pairs 200 by "bayesian" unless given
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from sfkit.bank.folders import FOLDERS
from sfkit.checkpoints.spec import ROWS, SOURCE_NAME
from sfkit.datasets.shipped import ensure_training_set
from sfkit.errors import InputError, ensure_known
from sfkit.files import home
from sfkit.outside import read_toml, table, text
from sfkit.search import RoutingSettings, SubsetSettings
from sfkit.search.checks import METHODS, RESAMPLES
from sfkit.settings import require_whole
from sfkit.training.settings import TrainingSettings

# What the file says is checked before what reads images and networks is imported.
if TYPE_CHECKING:
    from sfkit.datasets.benchmark_record import Benchmark
    from sfkit.datasets.training_set import TrainingSet
    from sfkit.search.plan import SearchPlan

KEYS = (
    "name",
    "base",
    "architecture",
    "module",
    "out",
    "joint",
    "options",
    "training",
    "sources",
    "validation",
    "tests",
)
SOURCE_KEYS = ("data", "root", "pairs", "training", "licence", "all", "coding")
SIZES = ("population", "generations", "evaluations", "batch", "seed", "resamples")
SEARCH_KEYS = ("method", "combine", *SIZES)
TABLES = ("options", "training", "sources", "search")
COMBINATIONS = ("mean", "worst")
JOINT, MERGED, SEARCHED = "joint", "merged", "search"
TAKEN = (*ROWS, JOINT, MERGED, SEARCHED)
"""What the tables of scores and costs call what is no source."""


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
        file: where it was read from.
        name: the pool's name.
        base: the checkpoint all sources start from.
        architecture: its name in the registry.
        code: the user's file that registered it; None for one that comes with sfkit or a package.
        options: the architecture's.
        orders: the sources, in the file's order.
        joint: the joint network, where one is wanted.
        validation: what the search looks at.
        combine: how several of them become one score.
        tests: what it does not.
        given: the arguments of all benchmarks as the file has them, validation first.
        plan: method and budgets of the search.
        out: the folder for all that is made.
    """

    file: Path
    name: str
    base: Path
    architecture: str
    code: Path | None
    options: Mapping[str, Any]
    orders: tuple[Order, ...]
    joint: Order | None
    validation: tuple[Benchmark, ...]
    combine: str
    tests: tuple[Benchmark, ...]
    given: tuple[Mapping[str, Any], ...]
    plan: SearchPlan
    out: Path

    @property
    def networks(self) -> tuple[Order, ...]:
        """Everything to be trained: the sources, and the joint network where one is wanted."""
        return (*self.orders, *([self.joint] if self.joint is not None else ()))


def read_factory(path: str | Path) -> Factory:
    """Read and check a ``factory.toml``; paths in it are relative to its folder.

    Raises:
        InputError: a key is unknown, missing or makes no sense, a data set or the base is not there, a
            test is the validation benchmark, or the architecture is not known or its code not trusted.
    """
    path = Path(path)
    values = table(read_toml(path), str(path), (*KEYS, "search"))
    for key in ("name", "base", "architecture", "sources", "validation"):
        if not values.get(key):
            raise InputError(f"{path}: the key {key} is missing, expected it")
    here = path.parent
    tables = {key: table(values.get(key, {}), f"{path}: {key}") for key in TABLES}
    name = text(values["architecture"], f"{path}: architecture")
    module = here.resolve() / home(text(values["module"], f"{path}: module")) if "module" in values else None
    common, search = tables["training"], table(tables["search"], f"[search] in {path}", SEARCH_KEYS)
    combine = search.get("combine", COMBINATIONS[0])
    ensure_known(f"combine of [search] in {path}", combine, COMBINATIONS)
    guides, tested = (_several(values.get(key, [])) for key in ("validation", "tests"))
    if combine != COMBINATIONS[0] and len(guides) == 1:
        raise InputError(
            f"combine of [search] in {path}: found {combine} and one benchmark; write several [[validation]]"
        )
    sizes = {
        key: require_whole(f"{key} of [search] in {path}", search[key], 0) for key in SIZES if key in search
    }
    method, joint = str(search.get("method", METHODS[0])), _truth(values, "joint", str(path))
    ensure_known("method", method, METHODS)
    settings = {source: _settings(path, source, entry, common) for source, entry in tables["sources"].items()}
    given = tuple(_given(path, entry) for entry in (*guides, *tested))
    from sfkit.architectures.registry import entry_for
    from sfkit.datasets.benchmark import open_benchmarks
    from sfkit.evaluation.separation import check_separation

    entry = entry_for(name, module, here.resolve())
    orders = tuple(_order(path, source, tables["sources"][source], how) for source, how in settings.items())
    # All of them now: what is wrong with the last is not to be met after the trainings.
    benchmarks = tuple(open_benchmarks(given))
    for benchmark in benchmarks:
        benchmark.ensure_scorable()
    validation, tests = benchmarks[: len(guides)], benchmarks[len(guides) :]
    seen = {guide.fingerprint(): guide.name for guide in validation}
    for test in tests:
        # By content: two names may mean the same pairs.
        if test.fingerprint() in seen:
            raise InputError(f"{path}: {test.name} is validation and test, expected other pairs to test on")
    check_separation(validation, tests)
    return Factory(
        file=path,
        name=text(values["name"], f"{path}: name"),
        base=here / home(text(values["base"], f"{path}: base")),
        architecture=name,
        code=None if entry.code is None else entry.code.path,
        options=tables["options"],
        orders=orders,
        joint=_joint(orders, common, path) if joint else None,
        validation=validation,
        combine=combine,
        tests=tests,
        given=given,
        plan=_plan(method, sizes, sum(map(len, validation))),
        out=here / home(text(values.get("out", "."), f"{path}: out")),
    )


def _settings(path: Path, name: str, entry: Any, common: Mapping[str, Any]) -> TrainingSettings:
    """How a source is trained, once all that its table says makes sense."""
    where = f"[sources.{name}] in {path}"
    table(entry, where, SOURCE_KEYS)
    if not SOURCE_NAME.fullmatch(name):
        raise InputError(f"{path}: source name {name!r}, expected letters, digits and _ . - only")
    if name in TAKEN:
        raise InputError(
            f"{path}: found a source called {name!r}, which names something else in tables; rename it"
        )
    require_whole(f"{where}: pairs", entry.get("pairs", 1), 1)
    data = text(entry.get("data", ""), f"{where}: data")
    if not _of_a_bank(data):
        ensure_training_set(data, *(f"{bank}:DOMAIN" for bank in FOLDERS))
        if "root" not in entry:
            raise InputError(f"{where}: the key root is missing, expected the folder of {data!r}")
    own = table(entry.get("training", {}), f"[sources.{name}.training] in {path}")
    return TrainingSettings.from_dict({**common, **own}, where)


def _of_a_bank(data: str) -> bool:
    collection, colon, _ = data.partition(":")
    return bool(colon) and collection in FOLDERS


def _order(path: Path, name: str, entry: Mapping[str, Any], settings: TrainingSettings) -> Order:
    where = f"[sources.{name}] in {path}"
    data = _data(path, where, entry)
    if "pairs" in entry:
        data = data.first(entry["pairs"])
    return Order(name, data, settings, text(entry.get("licence", ""), f"{where}: licence"))


def _data(path: Path, where: str, entry: Mapping[str, Any]) -> TrainingSet:
    from sfkit.bank.rendered import training_set
    from sfkit.datasets.training_sets import open_training_set

    name = str(entry["data"])
    if _of_a_bank(name):
        collection, _, domain = name.partition(":")
        return training_set(domain, entry.get("pairs", 160), of=collection)
    root = path.parent / home(text(entry["root"], f"{where}: root"))
    coding = None if "coding" not in entry else text(entry["coding"], f"{where}: coding")
    return open_training_set(name, root, hold_out=not _truth(entry, "all", where), coding=coding)


def _several(value: object) -> list[Any]:
    """The tables under ``[[key]]``, or the one under ``[key]``."""
    return value if isinstance(value, list) else [value]


def _given(path: Path, entry: Any) -> dict[str, Any]:
    """A benchmark's arguments, its folder relative to the file's."""
    if not isinstance(entry, Mapping):
        raise InputError(f"{path}: found the benchmark {entry!r}, expected a table of arguments")
    given = dict(entry)
    for key in ("root", "table"):
        if key in given:
            given[key] = path.parent / home(str(given[key]))
    return given


def _joint(orders: tuple[Order, ...], common: Mapping[str, Any], path: Path) -> Order:
    from sfkit.datasets.training_set import TrainingSet

    pairs = tuple(pair for order in orders for pair in order.data.pairs)
    licence = "; ".join(dict.fromkeys(order.licence or order.data.licence for order in orders))
    data = TrainingSet(JOINT, pairs, licence=licence)
    return Order(JOINT, data, TrainingSettings.from_dict(common, f"[training] in {path}"))


def _plan(method: str, sizes: Mapping[str, int], pairs: int) -> SearchPlan:
    """What is not said is as the method has it, guided by so many pairs."""
    from sfkit.search.averaging import FEWEST_PAIRS
    from sfkit.search.plan import SearchPlan

    seed = sizes.get("seed", 0)
    plan = SearchPlan(stage1=SubsetSettings(seed=seed), stage2=RoutingSettings(seed=seed))
    plan = plan.by(method, sizes.get("batch", 1))
    first: dict[str, Any] = {key: sizes[key] for key in ("population", "generations") if key in sizes}
    plan = replace(plan, stage1=replace(plan.stage1, **first))
    if plan.stage2 is not None:
        budget = sizes.get("evaluations", plan.stage2.evaluations)
        plan = replace(plan, stage2=replace(plan.stage2, evaluations=budget) if budget else None)
    averages = method != METHODS[0] and plan.stage2 is not None and pairs >= FEWEST_PAIRS
    return replace(plan, resamples=sizes.get("resamples", RESAMPLES if averages else 0))


def _truth(values: Mapping[str, Any], key: str, where: str) -> bool:
    """A flag that is off unless it is said."""
    value = values.get(key, False)
    if not isinstance(value, bool):
        raise InputError(f"{where}: {key}: found {value!r}, expected true or false")
    return value
