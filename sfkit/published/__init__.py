"""The paper's published numbers, to be set beside one's own.

>>> sfkit.published.published("tab:merging_comparison").loc["NMRF", "mean"]

``docs/published_page.py`` writes ``docs/published.md`` and finds where the tables disagree.
"""

from sfkit.published.tables import BENCHMARKS, LABELS, SOURCES, PublishedTable, published, published_table
