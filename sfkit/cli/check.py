"""``sfkit check``: whether a pool's network is called rightly, and whether merging can work."""

from __future__ import annotations

from typing import Annotated

import typer

from sfkit.cli.foreseen import roster_of
from sfkit.cli.options import JsonOption, PoolArgument, emit, pool_of, say
from sfkit.cli.panels import InlineOptions, OptionalBenchmarkOptions
from sfkit.cli.terminal import Bars


def check(
    pool: PoolArgument,
    data: OptionalBenchmarkOptions,
    compute: InlineOptions,
    pairs: Annotated[int, typer.Option(min=1, help="The first so many pairs.")] = 4,
    json: JsonOption = False,
) -> int:
    """Call the network once and say what is wrong; with a benchmark, score the midpoints between checkpoints.

    \b
    Examples:
      sfkit check pool.toml
      sfkit check pool.toml --benchmark eth3d --root ~/ETH3D
    """
    roster_of(pool)
    opened_benchmark = None
    if data is not None:
        whole = data.open()
        opened_benchmark = whole.first(pairs)
    from sfkit.analysis import linear_paths
    from sfkit.evaluation import Evaluator
    from sfkit.evaluation.first_call import first_call

    opened = pool_of(pool)
    called = first_call(opened)
    height, width = called.size
    memory = f"peak memory {called.memory / 2**30:.1f} GiB"
    lines = [
        f"{opened!r}",
        *([f"one pass on {width}x{height}: {called.seconds:.2f} s, {memory}"] if called.seconds else []),
        *(f"{mistake.name}: {mistake.sentence}" for mistake in called.mistakes),
    ]
    document = {
        "mistakes": [{"name": m.name, "sentence": m.sentence} for m in called.mistakes],
        "seconds": called.seconds,
        "memory_bytes": called.memory,
    }
    fatal = any(mistake.fatal for mistake in called.mistakes)
    if not called.mistakes:
        lines.append("the network is called rightly: disparities of the right size, sign and scale")
    if opened_benchmark is not None and not fatal:
        say(f"scoring the midpoints on {len(opened_benchmark.pairs)} pairs of {opened_benchmark.name}")
        with Evaluator(opened, opened_benchmark, compute=compute) as evaluator, Bars(keep=False) as bars:
            evaluator.listen = lambda done, total: bars("midpoints", done, total)
            paths = linear_paths(evaluator)
        members = paths.beside(opened.summary()).reset_index()
        tables = (members, paths.table())
        lines += [table.to_string(index=False, float_format="%.2f", na_rep="") for table in tables]
        lines += paths.sentences
        document |= {
            # JSON has no NaN.
            "members": members.astype(object).where(members.notna(), None).to_dict("records"),
            "paths": paths.table().to_dict("records"),
            "harmful": list(paths.harmful),
            "sentences": list(paths.sentences),
        }
    emit(document, "\n".join(lines), as_json=json)
    return 1 if fatal else 0
