"""The embedded bank: a base network and 11 sources, really trained, and four benchmarks to merge for.

``bank-slim`` has the same domains and names, of another architecture: what one pool found can be tried there.

Everything comes from seeds: ``sfkit bank build`` makes it again (see :mod:`sfkit.bank.build`).
"""

import json
from pathlib import Path

from sfkit.bank.build import build
from sfkit.bank.plan import BANK, bank_plan, banks
from sfkit.bank.rendered import benchmark, benchmarks, held_out
from sfkit.datasets.benchmark import register_benchmarks
from sfkit.datasets.synthetic.domains import BASE, VALIDATION, domains
from sfkit.merging.opening import register_pool

__all__ = [
    "VALIDATION",
    "banks",
    "benchmark",
    "benchmarks",
    "build",
    "domains",
    "held_out",
    "pool_path",
    "training_seconds",
]


def pool_path(name: str = BANK.name) -> Path:
    """The ``pool.toml`` of a bank that ships with sfkit; base and sources lie beside it.

    Raises:
        InputError: no bank of that name.
    """
    return Path(__file__).parent / bank_plan(name).folder / "pool.toml"


def training_seconds(name: str = BANK.name) -> dict[str, float]:
    """Source -> CPU seconds of the one thread that fine-tuned it, as recorded when the bank was built.

    Raises:
        InputError: no bank of that name.
    """
    records = json.loads((pool_path(name).parent / "trainings.json").read_text(encoding="utf-8"))
    return {source: float(r["cpu_seconds"]) for source, r in records.items() if source != BASE.name}


for _name in banks():
    register_pool(_name, pool_path(_name))
register_benchmarks(BANK.name, benchmarks(), benchmark)
