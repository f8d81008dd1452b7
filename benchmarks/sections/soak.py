"""Searches killed at random moments, and damaged files by the thousand."""

from __future__ import annotations

from soak import PARTS, kept, main, table

DOCUMENT = "benchmarks/README.md"


def section() -> str:
    """The soak's last run, read where there is one in ``build/soak``, else run whole."""
    if not kept():
        main([])
    parts = kept()
    left = [name for name in PARTS if name not in {part.name for part in parts}]
    note = f"\n\nNot run that time: {', '.join(left)}." if left else ""
    return f"""## The soak: kill -9 and damaged files

`python benchmarks/soak.py`, which runs the tests of `make soak KILLS=200`. A search is killed with SIGKILL
at a random moment between its first and its last evaluation and started again: it must end with the same
files to the last byte, and compute nothing twice. Readers of outside data get sound files with a few bytes
cut out, put in or changed: only `InputError` may come out. `faults` is what all tests of faults cost within
`make test`, where they may take five minutes.

{table(parts)}{note}"""
