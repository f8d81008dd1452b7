"""A search's folder: of one search, which nobody else writes to meanwhile.

``search.json`` says which search a folder is of: pool, benchmarks and plan, in content. The same search goes
on in it; another one would replace what this one found, and is refused unless that is asked for.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sfkit.errors import InputError
from sfkit.files import holding, trouble, write_text

SEARCH = "search.json"
NAMES = "names"
"""In that file, what the benchmarks are called: for people, since a renamed one makes no other search."""
LOCK = ".lock"
STORE = "evaluations.sqlite"
WINNERS, BEST = "winners.csv", "best.json"
"""Of a search that averages: what was averaged, and the recipe that scores best on validation."""
OUTPUTS = (
    *("journal.jsonl", "stage1.csv", "stage2.csv", WINNERS, BEST),
    *("recipe.json", "merged.safetensors", "result.json"),
)
"""What a search writes into its folder."""
_REMEDY = "choose another folder (--out), or replace what it holds (--force)"
_NAMED = 3  # differences that a refusal names


@dataclass(frozen=True)
class RunFolder:
    """A folder that this search alone writes to; made by :func:`run_folder`."""

    path: Path


@contextmanager
def run_folder(path: Path, identity: Mapping[str, Any], *, force: bool = False) -> Iterator[RunFolder]:
    """Hold a search's folder as long as the block runs; it is made where there is none.

    Args:
        path: the folder.
        identity: which search is to run, from :meth:`sfkit.search.plan.SearchPlan.identity`.
        force: whether another search's results may be replaced.

    Raises:
        InputError: another search runs there now, or left results there; nothing is changed then.
    """
    # Before the folder is made, so that a refusal leaves none behind.
    if not force:
        _refuse_other(path, identity)
    busy = f"{path}: another search is writing to this folder, choose another (--out) or wait for its end"
    with holding(path / LOCK, busy):
        try:
            _refuse_other(path, identity)  # another may have begun since
        except InputError:
            if not force:
                raise
            for name in OUTPUTS:  # nothing of another search may pass as this one's
                (path / name).unlink(missing_ok=True)
        # Before any output: what lies here is never without a word on whose it is.
        write_text(path / SEARCH, json.dumps(identity, indent=1) + "\n")
        yield RunFolder(path)


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
    if not any((path / name).exists() for name in OUTPUTS):
        return  # nothing to lose: a search that was not begun
    record = path / SEARCH
    if record.exists() and (why := trouble(record)):
        raise InputError(f"{record}: cannot be read ({why}), expected which search this is: {_REMEDY}")
    try:
        held = json.loads(record.read_text(encoding="utf-8"))
    except FileNotFoundError:
        refuse_unclaimed(path)
        return
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(
            f"{record}: cannot be read ({error}), expected which search this is: {_REMEDY}"
        ) from error
    # Leaf by leaf, so that the refusal names a setting and not the record it lies in.
    there, here = (dict(_flat(_nameless(one))) for one in (held, identity))
    unlike = [key for key in dict.fromkeys((*here, *there)) if here.get(key, "") != there.get(key, "")]
    if unlike:
        named = ", ".join(
            f"{key} {_short(there.get(key))} there and {_short(here.get(key))} now" for key in unlike[:_NAMED]
        )
        more = f" and {len(unlike) - _NAMED} more" if len(unlike) > _NAMED else ""
        raise InputError(f"{path}: holds another search ({named}{more}): {_REMEDY}")


def _nameless(identity: object) -> object:
    if not isinstance(identity, Mapping):
        return identity
    # A benchmark that was only given another name is the same benchmark.
    return {key: value for key, value in identity.items() if key != NAMES}


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
