"""The journal: an append-only record of a search, one JSON object a line, for those who watch it.

Nothing here is state: no search ever reads a journal, and deleting one changes no result.

Records have an ``event``: ``start`` (kind of search, settings, names), ``generation`` (candidates, best,
counts, and what the kind adds), ``end`` (why), ``average`` (what won resamples, and the average of it),
``resumed`` (a line before it was cut off by a kill).
"""

from __future__ import annotations

import dataclasses
import json
import math
import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from numbers import Integral, Real
from pathlib import Path
from typing import Any, BinaryIO

from sfkit.errors import InputError, SfkitError
from sfkit.outside import parse_json

Record = dict[str, Any]
STOP_REQUESTED = "stop requested"
"""The reason of an end that somebody asked for."""


class Journal:
    """Appends records to a file; every line is handed to the operating system before :meth:`write` returns.

    The file is opened for each record alone, so that there is nothing to close and several searches can
    share one journal.
    """

    def __init__(self, path: str | os.PathLike[str]) -> None:
        """Name the file; it is created by the first record.

        Raises:
            InputError: the folder does not exist, or the path is a folder.
        """
        self.path = Path(path)
        if self.path.is_dir():
            raise InputError(f"journal {self.path}: found a folder, expected the name of a file")
        if not self.path.parent.is_dir():
            raise InputError(
                f"journal {self.path}: the folder {self.path.parent} does not exist: create it first"
            )

    def write(self, event: str, **fields: Any) -> None:
        """Append one record and the time (UTC) of writing; numbers that are not finite become null.

        Raises:
            SfkitError: it cannot be written, such as on a full disk.
        """
        record = {"event": event, "time": datetime.now(UTC).isoformat(), **fields}
        lines = _line(record)
        try:
            # Unbuffered: what was written is the system's, whatever happens to this process. Read for the
            # last byte.
            with self.path.open("a+b", buffering=0) as file:
                if _ends_inside_a_line(file):
                    lines = b"\n" + _line({"event": "resumed", "time": record["time"]}) + lines
                written = file.write(lines)
                while written < len(lines):  # a disk that fills takes a part before it refuses
                    written += file.write(lines[written:])
        except OSError as error:
            raise SfkitError(
                f"journal {self.path}: cannot be written ({error.strerror}): evaluations are in the store; "
                "make room and start again"
            ) from error


def read_journal(path: str | os.PathLike[str]) -> tuple[Record, ...]:
    """Every whole record of a journal, in the order written.

    A line cut off by a kill, at the end of the file or before a ``resumed`` record, is left out. A journal
    that is being written can be read at any moment.

    Raises:
        InputError: no such file, or a line that is no record anywhere else.
    """
    file = Path(path)
    if not file.is_file():
        raise InputError(
            f"journal {file}: no such file, expected what a search with journal=Journal(...) wrote"
        )
    # As bytes: a line that a kill cut need not be text.
    lines = [line for line in file.read_bytes().split(b"\n") if line]
    parsed = [_parse(line) for line in lines]
    for number, record in enumerate(parsed):
        # A kill may cut the last line, as it may the one before a search that goes on.
        after = parsed[number + 1] if number + 1 < len(parsed) else {"event": "resumed"}
        if record is None and (after is None or after.get("event") != "resumed"):
            raise InputError(
                f"journal {file}: record {number + 1} is damaged, expected one JSON object a line"
            )
    return tuple(record for record in parsed if record is not None)


def last_run(records: Iterable[Record], search: str | None = None) -> tuple[Record, ...]:
    """The records of the latest run: a search that was killed and started again wrote several.

    Args:
        records: what :func:`read_journal` returned.
        search: "subset" or "routing"; None takes the latest of any kind.
    """
    run: list[Record] = []
    for record in records:
        if search is not None and record.get("search", search) != search:
            continue
        # A run that was killed and begun again proposes the same candidates: only the last one counts.
        if record.get("event") == "start":
            run = []
        run.append(record)
    return tuple(run)


@dataclass(frozen=True)
class JournalledSearch:
    """One search as its journal tells of it: the latest run. What records look like is known here alone.

    Attributes:
        kind: ``subset`` or ``routing``.
        start: its first record: ``settings``, ``constraints``, ``sources``, ``blocks``, ``start`` and more.
        generations: those that are finished.
        end: its last record where the search ended, else None.
        last: the record that was written last.
    """

    kind: str
    start: Record
    generations: tuple[Record, ...]
    end: Record | None
    last: Record

    @classmethod
    def find(cls, records: Iterable[Mapping[str, Any]], kind: str) -> JournalledSearch | None:
        """The latest run of a kind of search; None where no such search has begun."""
        run = [r for r in last_run((dict(record) for record in records), kind) if r.get("search") == kind]
        if not run or run[0].get("event") != "start":
            return None
        finished = tuple(record for record in run if record["event"] == "generation")
        found = cls(kind, run[0], finished, run[-1] if run[-1]["event"] == "end" else None, run[-1])
        try:
            found._read_all()
        except (KeyError, TypeError, ValueError, AttributeError, OverflowError) as error:
            raise InputError(
                f"journal: a record of its {kind} search is not what a search writes ({error!r}), was it "
                "edited?"
            ) from error
        return found

    def _read_all(self) -> None:
        """Read what viewers do, so that a record of another form is told here."""
        names = (*self.sources, *self.blocks)
        # Reading is the check: each property raises where its record is of another form.
        facts: tuple[object, ...] = (self.reason, self.generation, self.started, self.written)
        facts += (self.counts, self.candidates, self.best)
        # Only CPU seconds may be unknown.
        numbers = [float(v) for k, v in self.counts.items() if v is not None or not k.startswith("cpu_")]
        if not (all(isinstance(name, str) for name in names) and facts and len(numbers) >= 0):
            raise TypeError("sources and blocks must be texts")

    @classmethod
    def begun(cls, records: Iterable[Mapping[str, Any]], kind: str) -> JournalledSearch:
        """The same, with at least one generation.

        Raises:
            InputError: there is none.
        """
        found = cls.find(records, kind)
        if found is None or not found.generations:
            raise InputError(
                f"journal: found no generation of a {kind} search, expected at least one: "
                "run the search first"
            )
        return found

    @property
    def sources(self) -> tuple[str, ...]:
        """The names it chooses from, in the pool's order."""
        return tuple(self.start["sources"])

    @property
    def blocks(self) -> tuple[str, ...]:
        """The pool's blocks, in order."""
        return tuple(self.start["blocks"])

    @property
    def settings(self) -> Record:
        """The settings of its stage."""
        return dict(self.start["settings"])

    @property
    def by_model(self) -> bool:
        """Whether a model proposes its candidates; a journal from before it said so is of the paper's."""
        return self.start.get("method") == "bayesian"

    @property
    def most(self) -> int:
        """The most candidates of Stage 1; a journal from before it said so is of the paper's search."""
        if "most" in self.start:
            return int(self.start["most"])
        population, generations = (int(self.settings[name]) for name in ("population", "generations"))
        # Offspring came in pairs: an odd population had one more.
        return population + generations * (population + population % 2)

    @property
    def generation(self) -> int:
        """The number of the last finished generation; -1 before the first."""
        return int(self.generations[-1]["generation"]) if self.generations else -1

    @property
    def candidates(self) -> tuple[Record, ...]:
        """Every candidate so far, by number."""
        return tuple(entry for record in self.generations for entry in record["candidates"])

    @property
    def populations(self) -> tuple[tuple[int, ...], ...]:
        """Stage 1: the numbers of the candidates in each population."""
        return tuple(tuple(record["population"]) for record in self.generations)

    @property
    def axes(self) -> tuple[Any, ...]:
        """Stage 2: the axes of the distribution that each candidate was drawn from."""
        return tuple(r["distribution"]["axes"] for r in self.generations for _ in r["candidates"])

    @property
    def best(self) -> Record | None:
        """The best candidate so far, with its recipe; None where none has a finite score."""
        found = self.generations[-1]["best"] if self.generations else None
        return None if found is None else dict(found)

    @property
    def counts(self) -> Record:
        """What the search has asked for so far; empty before its first generation."""
        return dict(self.generations[-1]["counts"]) if self.generations else {}

    @property
    def reason(self) -> str | None:
        """Why it ended; None where its journal tells of no end: it runs, or was interrupted."""
        return None if self.end is None else str(self.end["reason"])

    @property
    def stopped(self) -> bool:
        """True where it was asked to end."""
        return self.reason == STOP_REQUESTED

    @property
    def started(self) -> datetime:
        """When it began (UTC)."""
        return datetime.fromisoformat(self.start["time"])

    @property
    def written(self) -> datetime:
        """When its last record was written (UTC)."""
        return datetime.fromisoformat(self.last["time"])


def journalled_score(entry: Mapping[str, Any], key: str = "score") -> float:
    """A score of a candidate's record; ``inf`` where it has no finite one."""
    return math.inf if entry[key] is None else float(entry[key])


def _line(record: Mapping[str, Any]) -> bytes:
    return json.dumps(_plain(record), allow_nan=False, separators=(",", ":")).encode() + b"\n"


def _plain(value: Any) -> Any:
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        return _plain({field.name: getattr(value, field.name) for field in dataclasses.fields(value)})
    if isinstance(value, Mapping):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    # Before whole numbers, one of which True is to Python.
    if value is None or isinstance(value, bool | str):
        return value
    if isinstance(value, Integral):
        return int(value)
    if isinstance(value, Real):
        # JSON has neither NaN nor infinity.
        return float(value) if math.isfinite(value) else None
    raise TypeError(f"journal: cannot write a {type(value).__name__}")


def _parse(line: bytes) -> Record | None:
    try:
        record = parse_json(line, "journal")
    except InputError:
        return None
    return record if isinstance(record, dict) and isinstance(record.get("event"), str) else None


def _ends_inside_a_line(file: BinaryIO) -> bool:
    if file.seek(0, os.SEEK_END) == 0:
        return False
    file.seek(-1, os.SEEK_END)
    return file.read(1) != b"\n"
