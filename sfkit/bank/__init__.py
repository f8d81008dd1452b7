"""The embedded bank: a base network and 11 sources, really trained, and four benchmarks to merge for.

Everything comes from seeds: ``sfkit bank build`` makes it again (see :mod:`sfkit.bank.build`).
"""

from pathlib import Path

from sfkit.bank.build import build
from sfkit.bank.rendered import benchmark, benchmarks, held_out
from sfkit.datasets.synthetic.domains import VALIDATION, domains

__all__ = ["VALIDATION", "benchmark", "benchmarks", "build", "domains", "held_out", "pool_path"]


def pool_path() -> Path:
    """The ``pool.toml`` of the bank that ships with sfkit; base and sources lie beside it."""
    return Path(__file__).parent / "data" / "pool.toml"
