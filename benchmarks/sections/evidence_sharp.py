"""The comparisons of Stage 2 on the sharp bank, at smaller budgets and over more draws."""

from __future__ import annotations

from evidence import kept_of, written
from evidence_bank import SHARP
from stage2_worlds import BANK_WINDOW

HEIGHT, WIDTH = BANK_WINDOW
HEAD = f"""## Does Stage 2 help on pairs it never saw? The sharp bank

`python benchmarks/evidence.py --sharp`: the comparisons above on `bank-sharp`, whose sources differ
more. Of every pair its middle is taken, {HEIGHT} x {WIDTH} pixels, which costs a quarter and leaves room for
more draws. Both stages are guided by pairs of `courtyard`, drawn anew for each seed: Stage 1 with
"""


def section() -> str:
    """Tables of whatever is finished.

    Raises:
        SystemExit: that is nothing.
    """
    return written(SHARP, kept_of(SHARP), HEAD)
