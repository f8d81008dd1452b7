"""What the command line takes before any work starts: CPU seconds of help, refusals and ``sfkit show``."""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
from pathlib import Path

import pandas as pd
from tabulated import markdown

DOCUMENT = "benchmarks/README.md"
REPEATS = 5  # the least of them is kept: the machine does other work, too
FACTORY = (
    'name = "p"\nbase = "b.pth"\narchitecture = "anynet"\n[sources.a]\ndata = "vkitti3"\n'
    '[validation]\nname = "bank:courtyard"\n'
)
LINES = (
    ("--help", 0),
    ("search --help", 0),
    ("serch", 2),
    ("search nowhere/pool.toml -b eth3d", 2),
    ("search bank -b eth3d -r nowhere", 2),
    ("search bank -b bank:courtyrad", 2),
    ("search bank -b bank:courtyard --metric bad", 2),
    ("search bank -b bank:courtyard --test bank:courtyard", 2),
    ("search bank --blocks modul -b bank:courtyard", 2),
    ("baselines bank --names nobody -b bank:courtyard", 2),
    ("merge bank --weights nobody=1 -o new.safetensors", 2),
    ("predict text.pth -l left.png -r right.png", 2),
    ("export nothing.pth", 2),
    ("finetune text.pth vkitti3 -r . -o new.safetensors", 2),
    ("factory run factory.toml", 2),
    ("report 01_quickstart -p sed 1 -o page.html", 2),
    ("runs list nowhere", 2),
    ("data check eth3d -r nowhere", 2),
    ("show text.pth", 2),
    ("show bank", 0),
    ("show bank-sharp", 0),
)


def seconds(words: list[str], folder: Path, code: int = 0) -> float:
    """CPU seconds of a process, the least of several.

    Raises:
        RuntimeError: it ended with another code.
    """
    # Bytecode may be written: otherwise every start would compile what it imports.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    found = []
    for _ in range(REPEATS):
        with subprocess.Popen(
            words, cwd=folder, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL
        ) as process:
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode != code:
            raise RuntimeError(f"{' '.join(words)}: ended with {process.returncode}, expected {code}")
        found.append(used.ru_utime + used.ru_stime)
    return min(found)


def measure() -> list[dict[str, object]]:
    """A row a command: CPU seconds, and how often those of a Python that imports typer alone."""
    sfkit = [sys.executable, "-m", "sfkit"]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "text.pth").write_text("Not found\n", encoding="utf-8")
        (folder / "factory.toml").write_text(FACTORY, encoding="utf-8")
        least = seconds([sys.executable, "-c", "import typer"], folder)
        rows: list[dict[str, object]] = [
            {"command": "python -c 'import typer'", "CPU s": least, "times": 1.0}
        ]
        for line, code in LINES:
            taken = seconds([*sfkit, *line.split()], folder, code)
            rows.append({"command": f"sfkit {line}", "CPU s": taken, "times": taken / least})
    return rows


def section() -> str:
    """The section."""
    table = pd.DataFrame(measure()).set_index("command")
    refused = [f"sfkit {line}" for line, code in LINES if code]
    return f"""## The start of the command line

CPU seconds until a command has answered, the least of {REPEATS} runs, and how often what a Python takes that
imports typer, which no command can do without. Pools are shown again: the first time reads their files, which
takes twice as long. Refusals take at most
{table.loc[refused, "CPU s"].max():.2f} s.

{markdown(table)}
"""
