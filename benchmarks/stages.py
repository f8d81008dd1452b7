"""Both stages as benchmarks run them, and the command line of what prints rows of them."""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict
from typing import Any

import pandas as pd

import sfkit
from sfkit.merging import Pool


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


def readable(found: Any) -> str:
    """Rows as a table, and what a record holds by name."""
    if not isinstance(found, Mapping):
        return pd.DataFrame(found).to_string(index=False, float_format="{:.4g}".format)
    parts = (
        f"{name}:\n{readable(v)}" if isinstance(v, list) else f"{name}: {v}" for name, v in found.items()
    )
    return "\n".join(parts)


def answered(
    about: str | None,
    measure: Callable[..., Any],
    options: Mapping[str, Any],
    text: Callable[[Any], str] = readable,
    arguments: Sequence[str] | None = None,
) -> None:
    """Measure what the command line asks for and print it as text, or JSON.

    Args:
        about: what ``--help`` says.
        measure: takes every option by its name.
        options: name -> default, whose type the option has; of a tuple several values, of False a switch.
        text: of what was measured; its rows as a table unless given.
        arguments: of the command line; the process's own unless given.
    """
    parser = argparse.ArgumentParser(description=about, formatter_class=argparse.RawTextHelpFormatter)
    for name, usual in options.items():
        kind: dict[str, Any] = {"type": type(usual)}
        if isinstance(usual, tuple):
            kind = {"type": type(usual[0]), "nargs": "+"}
        elif usual is False:
            kind = {"action": "store_true"}
        parser.add_argument(f"--{name}", default=usual, help=f"{usual} unless given", **kind)
    parser.add_argument("--json", action="store_true", help="print JSON")
    given = vars(parser.parse_args(arguments))
    as_json = given.pop("json")
    found = measure(**given)
    print(json.dumps(found, indent=2, default=asdict) if as_json else text(found))
