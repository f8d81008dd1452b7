"""A search's folder: of one search, which nobody else writes to meanwhile.

``search.json`` says which search a folder is of: pool, benchmarks and plan, in content. The same search goes
on in it; another one would replace what this one found, and is refused unless that is asked for.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from filelock import FileLock, Timeout

from sfkit.errors import InputError
from sfkit.evaluation.combining import CombinedScorer
from sfkit.evaluation.evaluator import Evaluator
from sfkit.evaluation.outcome import Scorer
from sfkit.files import write_text
from sfkit.merging.pool import Pool

if TYPE_CHECKING:
    from sfkit.search.pipeline import Plan

SEARCH = "search.json"
LOCK = ".lock"
STORE = "evaluations.sqlite"
OUTPUTS = ("journal.jsonl", "stage1.csv", "stage2.csv", "recipe.json", "merged.safetensors", "result.json")
"""What a search writes into its folder."""
_REMEDY = "choose another folder (--out), or replace what it holds (--force)"
_NAMED = 3  # differences that a refusal names


@dataclass(frozen=True)
class RunFolder:
    """A folder that this search alone writes to; made by :func:`run_folder`."""

    path: Path


def identity_of(pool: Pool, scorer: Scorer, plan: Plan) -> dict[str, Any]:
    """What tells one search from another, as JSON values: what decides its result, and no place or time.

    A scorer of another kind than sfkit's own says nothing of itself.
    """
    parts = scorer.evaluators if isinstance(scorer, CombinedScorer) else (scorer,)
    told = {
        "pool": {"base": pool.base.fingerprint, "sources": pool.identity},
        "partition": pool.partition.fingerprint(),
        "benchmarks": [part.frame for part in parts if isinstance(part, Evaluator)],
        "metrics": [str(part.metric) for part in parts if isinstance(part, Evaluator)],
        "combine": scorer.how if isinstance(scorer, CombinedScorer) else None,
        "method": plan.method,
        "subset": plan.subset,
        "stage1": asdict(plan.stage1),
        "stage2": plan.stage2 and asdict(plan.stage2),
        "constraints": asdict(plan.constraints),
        "start": plan.start and plan.start.as_dict(),
    }
    known: dict[str, Any] = json.loads(json.dumps(told, sort_keys=True, default=list))
    return known


@contextmanager
def run_folder(path: Path, identity: Mapping[str, Any], *, force: bool = False) -> Iterator[RunFolder]:
    """Hold a search's folder as long as the block runs; it is made where there is none.

    Args:
        path: the folder.
        identity: which search is to run, from :func:`identity_of`.
        force: whether another search's results may be replaced.

    Raises:
        InputError: another search runs there now, or left results there; nothing is changed then.
    """
    if not force:
        _refuse_other(path, identity)
    path.mkdir(parents=True, exist_ok=True)
    lock = FileLock(path / LOCK, thread_local=False)
    try:
        lock.acquire(blocking=False)
    except Timeout as error:
        raise InputError(
            f"{path}: another search is writing to this folder, choose another (--out) or wait for its end"
        ) from error
    try:
        if not force:  # it may have begun since
            _refuse_other(path, identity)
        write_text(path / SEARCH, json.dumps(identity, indent=1) + "\n")
        yield RunFolder(path)
    finally:
        lock.release()


def refuse_unclaimed(path: Path) -> None:
    """Refuse a folder with files of a search's names that no search says are its own.

    Raises:
        InputError: there is such a file.
    """
    held = [] if (path / SEARCH).exists() else [path / name for name in OUTPUTS if (path / name).exists()]
    if held:
        raise InputError(f"{held[0]}: exists and no {SEARCH} beside it says of which search it is: {_REMEDY}")


def _refuse_other(path: Path, identity: Mapping[str, Any]) -> None:
    """Refuse where what lies in a folder would be replaced by another search's results."""
    record = path / SEARCH
    try:
        held = json.loads(record.read_text(encoding="utf-8"))
    except FileNotFoundError:
        refuse_unclaimed(path)
        return
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(
            f"{record}: cannot be read ({error}), expected which search this is: {_REMEDY}"
        ) from error
    there, here = dict(_flat(held)), dict(_flat(identity))
    unlike = [key for key in dict.fromkeys((*here, *there)) if here.get(key, "") != there.get(key, "")]
    if unlike:
        named = ", ".join(
            f"{key} {_short(there.get(key))} there and {_short(here.get(key))} now" for key in unlike[:_NAMED]
        )
        more = f" and {len(unlike) - _NAMED} more" if len(unlike) > _NAMED else ""
        raise InputError(f"{path}: holds another search ({named}{more}): {_REMEDY}")


def _flat(value: object, name: str = "") -> Iterator[tuple[str, object]]:
    """Every leaf of nested values with its way there, such as ``stage1.seed``."""
    below: Sequence[tuple[object, object]] = ()
    if isinstance(value, Mapping):
        below = tuple(value.items())
    elif isinstance(value, list):
        below = tuple(enumerate(value))
    if not below:
        yield name, value
    for key, entry in below:
        yield from _flat(entry, f"{name}.{key}" if name else str(key))


def _short(value: object) -> str:
    text = "none" if value is None or value in ([], {}) else str(value)
    return text if len(text) <= 16 else f"{text[:12]}..."
