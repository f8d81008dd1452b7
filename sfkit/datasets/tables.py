"""Pairs listed in a CSV file.

Columns left, right and disparity are paths; id, coding, mask and calibration may be added.
"""

from __future__ import annotations

import csv
from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any

from sfkit.datasets.folders import coding_for
from sfkit.datasets.listing import NEEDED, PairListing
from sfkit.datasets.matching import ensure_two
from sfkit.datasets.pairs import StereoPair
from sfkit.datasets.pfm import read_bytes
from sfkit.datasets.root_folder import inside
from sfkit.errors import InputError, nearest
from sfkit.files import is_file

COLUMNS = (*NEEDED, "calibration", "coding", "id", "mask")
FILES = (*NEEDED, "calibration", "mask")


def find_in_table(table: Path, root: Path, coding: str | None = None) -> PairListing:
    """The pairs of a CSV file; its paths are relative to ``root`` and stay under it.

    A pair without an id is named by its left image without the suffix. Files that a row names and that
    are not there are listed as missing.

    Raises:
        InputError: not a CSV, a column or value is missing or unknown, an id twice, a path leads outside.
    """
    pairs: list[StereoPair] = []
    missing: dict[str, tuple[str, ...]] = {}
    for line, row in enumerate(_rows(table), start=2):
        where = f"{table}, line {line}"
        # Not the bare file name, which is im0 in every folder.
        name = row.get("id") or PurePath(row["left"]).with_suffix("").as_posix()
        if name in missing or any(pair.id == name for pair in pairs):
            raise InputError(f"{where}: found the id {name!r} twice, expected each once; add a column 'id'")
        files: dict[str, Any] = {role: inside(root, row[role]) for role in FILES if row.get(role)}
        lacking = tuple(row[role] for role, path in files.items() if not is_file(path))
        ensure_two(files["left"], files["right"])
        if lacking:
            missing[name] = lacking
        else:
            told = coding_for(files["disparity"], [row.get("coding") or coding])
            pairs.append(StereoPair(name, coding=told, **files))
    return PairListing(tuple(sorted(pairs, key=lambda pair: pair.id)), missing)


def absent_files(table: Path, root: Path, found: PairListing) -> str:
    """The sentence for files that the table names and that are not there; empty where all are."""
    absent = [file for files in found.missing.values() for file in files]
    if not absent:
        return ""
    return (
        f"{table}: found no {', '.join(absent[:3])} ({len(absent)} in all), expected every file under {root}"
    )


def _rows(table: Path) -> list[dict[str, str]]:
    try:
        # utf-8-sig: spreadsheets put a byte order mark before the first column's name.
        reader = csv.DictReader(read_bytes(table).decode("utf-8-sig").splitlines(), strict=True)
        header = [column.strip() for column in reader.fieldnames or ()]
        reader.fieldnames = header
        rows = list(reader)
    except (csv.Error, UnicodeDecodeError) as error:
        raise InputError(f"{table}: is no CSV file in UTF-8 ({error}), save it again as one") from error
    _check_header(table, header)
    if not rows:
        raise InputError(f"{table}: found no row below the header, expected at least one pair")
    return [_check_row(f"{table}, line {line}", row) for line, row in enumerate(rows, start=2)]


def _check_header(table: Path, header: list[str]) -> None:
    for column in header:
        if column not in COLUMNS:
            raise InputError(
                f"{table}: found the column {column!r}, expected some of {', '.join(COLUMNS)}"
                f"{nearest(column, COLUMNS)}"
            )
    for column in NEEDED:
        if header.count(column) != 1:
            raise InputError(f"{table}: found the columns {header}, expected {column!r} once")


def _check_row(where: str, row: Mapping[str | None, str | None]) -> dict[str, str]:
    if None in row or None in row.values():
        raise InputError(f"{where}: found another number of values than columns, correct the row")
    clean = {str(key): str(value).strip() for key, value in row.items()}
    for column in NEEDED:
        if not clean[column]:
            raise InputError(f"{where}: found no value for {column!r}, expected a path")
    return clean
