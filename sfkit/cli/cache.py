"""``sfkit cache``: what the cache of task vectors holds, and how to empty it."""

from __future__ import annotations

from datetime import datetime

from sfkit.cli.groups import sub_commands
from sfkit.cli.options import JsonOption, emit

app = sub_commands()


@app.command("list")
def list_entries(json: JsonOption = False) -> None:
    """List cached task vectors, the one used last first.

    \b
    Example:
      sfkit cache list
    """
    from sfkit.merging.cache import VectorCache

    cache = VectorCache()
    entries = cache.entries()
    rows = [{"source": e.source, "bytes": e.size_bytes, "used": e.used, "name": e.name} for e in entries]
    total = sum(entry.size_bytes for entry in entries)
    lines = [f"{cache.folder}: {total / 2**30:.2f} GiB of at most {cache.limit / 2**30:.0f} GiB"]
    for entry in entries:
        when = datetime.fromtimestamp(entry.used).isoformat(sep=" ", timespec="minutes")
        lines.append(f"  {entry.size_bytes / 2**20:8.1f} MiB  used {when}  {entry.source}")
    document = {"folder": cache.folder, "limit": cache.limit, "bytes": total, "entries": rows}
    emit(document, "\n".join(lines), as_json=json)


@app.command("clear")
def clear(json: JsonOption = False) -> None:
    """Delete all cached task vectors; checkpoints and evaluations are not touched.

    \b
    Example:
      sfkit cache clear
    """
    from sfkit.merging.cache import VectorCache

    cache = VectorCache()
    freed = cache.clear()
    emit({"folder": cache.folder, "freed": freed}, f"freed {freed / 2**30:.2f} GiB", as_json=json)
