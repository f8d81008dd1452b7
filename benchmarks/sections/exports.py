"""AnyNet, NMRF and FoundationStereo merged and exported whole, each checked beside itself.

A run is kept under ``runs/results/exports`` as soon as it is finished: together they take many minutes.
"""

from __future__ import annotations

import importlib
import json
import signal
import subprocess
from typing import Any

from processes import HERE, call, shown

from sfkit.analysis.tables import markdown_lines
from sfkit.files import write_text

KEPT = HERE.parent / "runs" / "results" / "exports"
COLUMNS = ("network", "file", "sizes", "99 % within, px", "largest, px", "CPU s", "peak, MB", "file, MB")


_HEAD = f"""## Merged networks exported

`{shown("exports.py", "NAME", "FORMAT")}`, with `--dynamic` for a file of all sizes. AnyNet is
four real checkpoints merged uniformly, propagation included, on Middlebury's whole Motorcycle (500 x 741
pixels). The others are merged from two copies of a base with every value moved by 1 %; the base's weights are
filled by the rule its golden arrays were made with, since published ones are not at hand. All layers take
part, of FoundationStereo (s: ViT-S, l: ViT-L) one update and 64 disparities; their pair is a part of
Middlebury's Cones of 64 x 128 pixels. CPU seconds are of one thread; after 900 a run is stopped."""


def section() -> str:
    """One row an export, each made in a process of its own unless it is kept."""
    exports = importlib.import_module("exports")
    records = [_kept(*wanted) for wanted in exports.WANTED]
    table = markdown_lines(COLUMNS, [_row(record) for record in records], [False] * 3 + [True] * 5)
    told = [f"- {' '.join(_about(record))}: {record['error']}" for record in records if "error" in record]
    return "\n\n".join((_HEAD, table, *(("The command's words:", "\n".join(told)) if told else ())))


def _kept(name: str, form: str, dynamic: bool) -> dict[str, Any]:
    words = [name, form, *(["--dynamic"] if dynamic else [])]
    path = KEPT / f"{'_'.join(words)}.json"
    if not path.is_file():
        path.parent.mkdir(parents=True, exist_ok=True)
        write_text(path, json.dumps(_called(words)))
    record: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return record


def _called(words: list[str]) -> dict[str, Any]:
    """What the run printed, or that its time was over."""
    try:
        record: dict[str, Any] = call("exports.py", *words, "--json")
    except subprocess.CalledProcessError as error:
        if error.returncode != -signal.SIGXCPU:
            raise
        seconds = importlib.import_module("exports").MOST_SECONDS
        return {"name": words[0], "format": words[1], "dynamic": "--dynamic" in words, "stopped": seconds}
    return record


def _about(record: dict[str, Any]) -> tuple[str, str, str]:
    return record["name"], record["format"], "any" if record["dynamic"] else "one"


def _row(record: dict[str, Any]) -> tuple[str, ...]:
    about = _about(record)
    if "stopped" in record:
        return (*about, "stopped", "", f"> {record['stopped']}", "", "")
    took = (str(record["seconds"]), f"{record['peak_memory_mb']:,}")
    if "error" in record:
        return (*about, "does not export", "", *took, "")
    return (
        *about,
        f"{record['percentile99']:.2g}",
        f"{record['largest']:.2g}",
        *took,
        f"{record['file_mb']:.1f}",
    )
