"""Recorded results: run a section's measurements and write them into its document.

    python benchmarks/results.py --list
    python benchmarks/results.py bigpool
    python benchmarks/results.py                    # all of them, one after the other

To add a section, add one file with a docstring, ``measure()`` and ``section() -> str``: Markdown that begins
with a ``## `` heading and says which commands it ran. It lies here where it is a command of its own, else in
``sections``. Underscores in the file's name are hyphens in the section's. What is about speed, or about
searches on known ground, says ``DOCUMENT = "benchmarks/README.md"``; other sections go to
``docs/results.md``. Nothing else needs to know of it: date, machine and command are added here, and the text
between ``<!-- begin NAME -->`` and ``<!-- end NAME -->`` is replaced, or added at the end.
"""

from __future__ import annotations

import argparse
import importlib
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path

from processes import machine

HERE = Path(__file__).parent
ROOT = HERE.parent
RESULTS = "docs/results.md"
PREAMBLES = {
    RESULTS: """# Measured results

Every section was written by the command it names, on the machine it names; no figure is edited by hand. Of
some that nobody needs to measure again only the record is left, and their script in the history.
Speed is in [benchmarks](../benchmarks/README.md).
""",
    "benchmarks/README.md": "# Benchmarks\n",
}


def modules() -> dict[str, str]:
    """Section -> the module that has it."""
    files = [*HERE.glob("*.py"), *(HERE / "sections").glob("*.py")]
    found = {f.stem.replace("_", "-"): f for f in files if "\ndef section(" in f.read_text(encoding="utf-8")}
    return {
        name: ".".join(file.relative_to(HERE).with_suffix("").parts) for name, file in sorted(found.items())
    }


def made(name: str, body: str) -> str:
    """A section with its origin: date, command and size of the machine."""
    size = machine()
    origin = (
        f"Measured {datetime.now(UTC):%Y-%m-%d} by `python benchmarks/results.py {name}` with torch "
        f"{size['torch']} on {size['cores']} cores and {size['memory_gb']} GiB of memory, load average "
        f"{size['load']:.1f} in the last 15 minutes; torch threads: {size['threads']} unless said otherwise."
    )
    return f"{body.strip()}\n\n{origin}"


def replaced(document: str, name: str, text: str) -> str:
    """The document with a section's text between its markers, which are added at the end if need be."""
    begin, end = f"<!-- begin {name} -->", f"<!-- end {name} -->"
    block = f"{begin}\n{text.strip()}\n{end}"
    pattern = re.compile(f"{re.escape(begin)}.*?{re.escape(end)}", re.DOTALL)
    if pattern.search(document):
        return pattern.sub(lambda _: block, document)
    return f"{document.rstrip()}\n\n{block}\n"


def record(name: str, root: Path = ROOT) -> Path:
    """Run a section's measurements, write them, and return the document's path.

    Args:
        name: one of :func:`modules`.
        root: the checkout; a document comes into being with its first section.
    """
    module = importlib.import_module(modules()[name])
    document = getattr(module, "DOCUMENT", RESULTS)
    text = made(name, module.section())
    path = root / document
    path.parent.mkdir(parents=True, exist_ok=True)
    before = path.read_text(encoding="utf-8") if path.is_file() else PREAMBLES[document]
    path.write_text(replaced(before, name, text), encoding="utf-8")
    return path


def main(arguments: Sequence[str] | None = None) -> None:
    """Record the sections named, or all."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawTextHelpFormatter)
    parser.add_argument("section", nargs="*", help="which, all without one")
    parser.add_argument("--list", action="store_true", help="print the sections' names")
    options = parser.parse_args(arguments)
    known = list(modules())
    unknown = [name for name in options.section if name not in known]
    if unknown:
        parser.error(f"unknown section {unknown[0]!r}, expected one of: {', '.join(known)}")
    if options.list:
        print("\n".join(known))
        return
    for name in options.section or known:
        print(f"wrote section {name} of {record(name).relative_to(ROOT)}")


if __name__ == "__main__":
    main()
