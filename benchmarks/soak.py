"""The soak: searches killed at random moments, damaged files by the thousand; what passed, at what cost.

    python benchmarks/soak.py [--kills 200] [--fuzz 2000] [--parts kills fuzz engines faults] [--read]
    python benchmarks/soak.py --parts fuzz --again "torch or csv"

Runs the tests that ``make soak`` runs, part by part, and keeps what pytest says of each in ``build/soak``;
``--read`` prints what lies there. After a fault was mended ``--again`` runs once more those tests of which
the name has a word; each counts by its last run. A twentieth as many kills fall on each parallel engine. The
part ``faults`` is all tests of faults as ``make test`` runs them, for what they cost there.
"""

from __future__ import annotations

import os
import re
import resource
import subprocess
import sys
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from processes import answered
from tabulated import numbers

DOCUMENT = "benchmarks/README.md"

ROOT = Path(__file__).resolve().parents[1]
LOGS = ROOT / "build" / "soak"
SOAK = {
    "kills": ("tests/search/test_search_killed.py",),
    "fuzz": ("tests/outside/test_outside_fuzz.py",),
    "engines": ("tests/search/test_search_killed_engines.py",),
}
FAULTS = (
    *(file for files in SOAK.values() for file in files),
    "tests/search/test_search_bayesian_killed.py",
    "tests/search/test_search_faults.py",
    "tests/search/test_search_unlabelled_killed.py",
    "tests/cli/test_cli_doors.py",
    "tests/cli/test_cli_places.py",
    "tests/cli/test_cli_refusals.py",
    "tests/datasets/test_datasets_half_images.py",
    "tests/datasets/test_datasets_incomplete.py",
    "tests/datasets/test_datasets_matching.py",
    "tests/evaluation/test_engines_isolated.py",
    "tests/evaluation/test_evaluation_rescue.py",
    "tests/evaluation/test_evaluation_store.py",
    "tests/evaluation/test_evaluation_written.py",
    "tests/factory/test_factory_outputs.py",
    "tests/files/test_files_writing.py",
    "tests/merging/test_merging_bound.py",
    "tests/merging/test_merging_kept_buffers.py",
    "tests/merging/test_merging_unchanged.py",
    "tests/outside/test_outside_reading.py",
    "tests/reports/test_reports_hostile.py",
    "tests/reports/test_reports_interrupted.py",
    "tests/architectures/test_code_identity.py",
)
PARTS = {**SOAK, "faults": FAULTS}
_SHARE, _READER = "at_a_random_moment", "only_sentences_come_out"


@dataclass(frozen=True)
class SoakPart:
    """Tests that ran together.

    Attributes:
        name: ``kills``, ``fuzz``, ``engines`` or ``faults``.
        asked: how many kills in all, damaged files a reader, kills of an engine, or files of tests.
        passed: tests that passed, by name.
        failed: tests that did not.
        seconds: CPU seconds of all its processes; NaN where it was stopped.
    """

    name: str
    asked: int
    passed: tuple[str, ...]
    failed: tuple[str, ...]
    seconds: float

    @property
    def said(self) -> str:
        """What was survived, in words."""
        if self.name == "kills":
            return f"{len(self._of(_SHARE)) * self.asked // 10} kills of a search in one process"
        if self.name == "fuzz":
            readers = len(self._of(_READER))
            return f"{readers * self.asked:,} damaged files, {self.asked:,} for each of {readers} readers"
        if self.name == "faults":
            return f"the tests of faults, {self.asked} files, as `make test` runs them"
        ends = {"test_processes": self.asked, "test_ray": max(1, self.asked // 2)}
        there = [f"{n} kills with {name[5:]}" for name, n in ends.items() if self._of(name)]
        return ", ".join(there) or "no kill of a parallel search"

    def _of(self, word: str) -> list[str]:
        return [name for name in self.passed if word in name]


def run(name: str, kills: int, fuzz: int, log: Path, again: str = "") -> None:
    """Run one part, or ``again`` its tests whose names match that, and keep what pytest says of it."""
    asked = {"kills": kills, "fuzz": fuzz, "engines": -(-kills // 20), "faults": len(FAULTS)}[name]
    more = {
        "SFKIT_FUZZ": str(fuzz),
        "SFKIT_KILLS": str(kills),
        "SFKIT_ENGINE_KILLS": str(-(-kills // 20)),
        "SFKIT_KILLS_SEED": str(int(time.time())),
    }
    environment = {**os.environ, "OMP_NUM_THREADS": "1", **(more if name in SOAK else {})}
    words = [sys.executable, "-m", "pytest", "--slow", "-v", "-o", "faulthandler_timeout=0", *PARTS[name]]
    words += ["-k", again] if again else []
    log.parent.mkdir(parents=True, exist_ok=True)
    before = _spent()
    with log.open("a" if again else "w", encoding="utf-8") as stream:
        stream.write(f"asked {asked}\n")
        stream.flush()
        subprocess.run(words, cwd=ROOT, env=environment, stdout=stream, stderr=stream, check=False)
        stream.write(f"cpu {_spent() - before:.1f}\n")


def read(name: str, text: str) -> SoakPart:
    """What a log says."""
    ends = dict(re.findall(r"^tests/\S+::(\S+) .*?(PASSED|FAILED|ERROR)", text, re.DOTALL | re.MULTILINE))
    asked = re.search(r"^asked (\d+)$", text, re.MULTILINE)
    spent = [float(seconds) for seconds in re.findall(r"^cpu ([\d.]+)$", text, re.MULTILINE)]
    return SoakPart(
        name,
        int(asked[1]) if asked else 0,
        tuple(test for test, end in ends.items() if end == "PASSED"),
        tuple(test for test, end in ends.items() if end != "PASSED"),
        sum(spent) if len(spent) == len(re.findall(r"^asked \d+$", text, re.MULTILINE)) else float("nan"),
    )


def table(parts: Sequence[SoakPart]) -> str:
    """A row a part."""
    rows = []
    for part in parts:
        cost = "stopped" if part.seconds != part.seconds else f"{part.seconds:.0f}"
        rows.append((part.name, part.said, len(part.passed), len(part.failed), cost))
    return numbers(("part", "survived", "tests passed", "failed", "CPU seconds"), rows, 2)


def kept(folder: Path = LOGS) -> list[SoakPart]:
    """The parts that were run."""
    logs = ((name, folder / f"{name}.log") for name in PARTS)
    return [read(name, log.read_text(encoding="utf-8")) for name, log in logs if log.is_file()]


def _spent() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def measure(
    kills: int = 200,
    fuzz: int = 2000,
    parts: tuple[str, ...] = tuple(PARTS),
    again: str = "",
    read: bool = False,
) -> list[SoakPart]:
    """Run the parts, or of each the tests that ``again`` names as pytest's ``-k`` does; all that were run.

    Raises:
        SystemExit: there is no such part.
    """
    if unknown := [name for name in parts if name not in PARTS]:
        raise SystemExit(f"unknown part {unknown[0]!r}, expected one of: {', '.join(PARTS)}")
    for name in () if read else parts:
        run(name, kills, fuzz, LOGS / f"{name}.log", again)
    return kept()


def section() -> str:
    """The soak's last run, read where there is one in ``build/soak``, else run whole."""
    parts = kept() or measure()
    left = [name for name in PARTS if name not in {part.name for part in parts}]
    note = f"\n\nNot run that time: {', '.join(left)}." if left else ""
    return f"""## The soak: kill -9 and damaged files

`python benchmarks/soak.py`, which runs the tests of `make soak KILLS=200`. A search is killed with SIGKILL
at a random moment between its first and its last evaluation and started again: it must end with the same
files to the last byte, and compute nothing twice. Readers of outside data get sound files with a few bytes
cut out, put in or changed: only `InputError` may come out. `faults` is what all tests of faults cost within
`make test`, where they may take five minutes.

{table(parts)}{note}"""


if __name__ == "__main__":
    answered(measure, table)
