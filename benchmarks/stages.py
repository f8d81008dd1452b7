"""Both stages as benchmarks run them, and the command line of what prints rows of them."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import sfkit
from sfkit.merging import Pool

Rows = list[dict[str, Any]]


def both(
    pool: Pool,
    scorer: sfkit.Evaluator | sfkit.CombinedScorer,
    seed: int,
    *,
    population: int,
    generations: int,
    evaluations: int,
    converge: bool = False,
) -> tuple[sfkit.SubsetSearch, sfkit.RoutingSearch]:
    """Stage 1, then Stage 2 over the subset it found, each run to its end."""
    stage1 = sfkit.SubsetSettings(population=population, generations=generations, seed=seed)
    first = sfkit.SubsetSearch(pool.names, pool.blocks, scorer, stage1)
    stage2 = sfkit.RoutingSettings(evaluations=evaluations, converge=converge, seed=seed)
    second = sfkit.RoutingSearch(first.run().subset, pool.blocks, scorer, stage2)
    second.run()
    return first, second


def printed(
    about: str | None,
    measure: Callable[..., Rows],
    options: Mapping[str, Any],
    line: Callable[[dict[str, Any]], str],
    arguments: Sequence[str] | None = None,
) -> None:
    """Measure what the command line asks for and print a line a row, or JSON.

    Args:
        about: what ``--help`` says.
        measure: takes every option by its name.
        options: name -> default, whose type the option has.
        line: a row as text.
        arguments: of the command line; the process's own unless given.
    """
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawTextHelpFormatter)
    for name, usual in options.items():
        parser.add_argument(f"--{name}", type=type(usual), default=usual, help=f"{usual} unless given")
    parser.add_argument("--json", action="store_true", help="print a JSON list of records")
    given = vars(parser.parse_args(arguments))
    as_json = given.pop("json")
    rows = measure(**given)
    print(json.dumps(rows, indent=2) if as_json else "\n".join(map(line, rows)))
