"""A factory on the synthetic worlds that come with sfkit: nothing to download, everything to see."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from sfkit import bank
from sfkit.bank.plan import BANK
from sfkit.checkpoints.spec import read_pool_spec
from sfkit.files import write_text
from sfkit.outside import toml_value

TESTS = ("grey-workshop", "hazy-road")


def write_example(
    file: str | Path,
    domains: Sequence[str],
    *,
    pairs: int = 40,
    training: Mapping[str, Any] | None = None,
    validation_pairs: int = 8,
    search: Mapping[str, Any] | None = None,
    joint: bool = False,
    of: str = BANK.name,
) -> Path:
    """Write a ``factory.toml`` that fine-tunes an embedded bank's base on some of its domains.

    Args:
        file: what to write; a file that is there is replaced.
        domains: names of :func:`sfkit.bank.domains`, a source each.
        pairs: of each domain.
        training: entries of the file's ``[training]``.
        validation_pairs: of the bank's validation world, and of each world to test on.
        search: entries of its ``[search]``.
        joint: whether one network on all domains together is made too.
        of: the bank's name.
    """
    spec = read_pool_spec(bank.pool_path(of))
    worlds = [f'name = "{of}:{name}"\npairs = {validation_pairs}' for name in (bank.VALIDATION, *TESTS)]
    sections = [
        f"name = {toml_value('factory')}\narchitecture = {toml_value(spec.architecture)}\n"
        f"base = {toml_value(str(spec.base.path))}\njoint = {toml_value(joint)}",
        _section("options", spec.options),
        _section("training", training or {}),
        *(_section(f"sources.{name}", {"data": f"{of}:{name}", "pairs": pairs}) for name in domains),
        f"[validation]\n{worlds[0]}",
        *(f"[[tests]]\n{world}" for world in worlds[1:]),
        _section("search", search or {}),
    ]
    return write_text(Path(file), "\n\n".join(filter(None, sections)) + "\n")


def _section(name: str, values: Mapping[str, Any]) -> str:
    lines = [f"{key} = {toml_value(value)}" for key, value in values.items()]
    return "\n".join([f"[{name}]", *lines]) if lines else ""
