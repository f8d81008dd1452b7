"""The paper's published numbers, to be set beside one's own.

>>> sfkit.published.published("tab:merging_comparison").loc["NMRF", "mean"]

``python -m sfkit.published.page docs`` writes ``docs/published.md``.
"""

from sfkit.published.checks import Disagreement, disagreements, wrong_marks, wrong_means
from sfkit.published.claims import EXPERIMENTS, QUOTES, Experiment, Place, Quote
from sfkit.published.tables import (
    BENCHMARKS,
    LABELS,
    SOURCES,
    PublishedTable,
    published,
    published_table,
)

__all__ = [
    "BENCHMARKS",
    "EXPERIMENTS",
    "LABELS",
    "QUOTES",
    "SOURCES",
    "Disagreement",
    "Experiment",
    "Place",
    "PublishedTable",
    "Quote",
    "disagreements",
    "published",
    "published_table",
    "wrong_marks",
    "wrong_means",
]
