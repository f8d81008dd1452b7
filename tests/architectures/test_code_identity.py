"""A network of one's own is known by all the code it reaches: no edit meets the scores of before."""

from __future__ import annotations

import functools
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
import torch
from flat_world import benchmark, flat_spec
from torch import nn

import sfkit
from sfkit.architectures import architecture, register_architecture
from sfkit.architectures.identity import code_identity
from sfkit.errors import InputError

NETWORK = """
import functools, logging, math
import numpy as np
import torch
from torch import nn

LOG = logging.getLogger("mine")
SEEN = []
TABLE = {"gain": 1.0}
GRID = np.arange(3)
FACTOR = 1.0

class Gain:
    value = 1.0
    def __call__(self, x):
        return x * self.value

class Base(nn.Module):
    extra = 0.0
    def finish(self, level):
        return level + self.extra

def bent(function):
    @functools.wraps(function)
    def inner(*args):
        return function(*args) + 0.0
    return inner

@bent
def shifted(level, by=0.0):
    return level + by + 0 * math.pi

class Net(Base):
    kinds = (Gain,)
    def __init__(self):
        super().__init__()
        self.level = nn.Parameter(torch.zeros(1))
        self.offset = nn.Parameter(torch.zeros(1))
    def forward(self, left, right):
        SEEN.append(1)
        LOG.debug("seen")
        level = float((self.level + self.offset).detach()) * FACTOR * TABLE["gain"] + 0 * float(GRID[0])
        level = shifted(self.finish(self.kinds[0]()(level)))
        return torch.full((1, *left.shape[-2:]), level)
"""
EDITS = {
    "a helper class": ("value = 1.0", "value = 1.5"),
    "a base": ("level + self.extra", "level + 1 + self.extra"),
    "an attribute of a base": ("extra = 0.0", "extra = 1.0"),
    "an attribute": ("kinds = (Gain,)", "kinds = (Gain, Gain)"),
    "a decorator": ("+ 0.0", "+ 1.0"),
    "a decorated function": ("0 * math.pi", "1 * math.pi"),
    "a default": ("by=0.0", "by=1.0"),
    "a number": ("FACTOR = 1.0", "FACTOR = 2.0"),
    "a table": ('{"gain": 1.0}', '{"gain": 2.0}'),
    "an array": ("np.arange(3)", "np.arange(1, 4)"),
    "the class itself": ("torch.full", "1 + torch.full"),
}


def cell(text: str, name: str = "mine") -> dict[str, Any]:
    """What running a notebook's cell defines: code without a file."""
    module = ModuleType(name)
    exec(compile(text, "<cell>", "exec"), module.__dict__)  # noqa: S102 (as a kernel does)
    return module.__dict__


@pytest.mark.parametrize("edit", EDITS)
def test_whatever_is_reached_counts(edit: str) -> None:
    before, after = EDITS[edit]
    assert NETWORK.count(before) == 1
    first, again = (code_identity("mine", cell(NETWORK)["Net"]) for _ in range(2))
    moved = code_identity("mine", cell("\n\n# a comment\n" + NETWORK)["Net"])
    assert first == again == moved
    assert code_identity("mine", cell(NETWORK.replace(before, after))["Net"]) != first


def test_what_is_not_reached_and_what_a_run_fills_does_not_count() -> None:
    held = cell(NETWORK)
    first = code_identity("mine", held["Net"])
    held["Net"]()(*torch.zeros(2, 1, 3, 4, 4))
    held["unrelated"] = 3
    assert held["SEEN"] == [1]
    assert code_identity("mine", held["Net"]) == first


def test_a_setting_that_was_empty_at_first_counts_once_it_is_made() -> None:
    read_only = NETWORK.replace("* FACTOR", "* GAINS.get('gain', FACTOR)").replace(
        "FACTOR = 1.0", "FACTOR, GAINS = 1.0, {}"
    )
    held = cell(read_only)
    first = code_identity("mine", held["Net"])
    held["GAINS"]["gain"] = 0.01
    assert code_identity("mine", held["Net"]) != first
    held["GAINS"].clear()
    assert code_identity("mine", held["Net"]) == first


FILLED = {
    "a helper": ("fill(GRIDS, 1)", "def fill(cache, key):\n    cache[key] = 2\n"),
    "a subscript over several lines": ("GRIDS[\n            (1,\n             2)\n        ] = 2", ""),
    "a method": ("GRIDS.setdefault(1, 2)", ""),
    "another name": ("grids = GRIDS; grids[1] = 2", ""),
    "what a helper returns": ("given()[1] = 2", "def given():\n    return GRIDS\n"),
    "a look before": ("GRIDS.get(1); GRIDS[1] = 2", ""),
}


@pytest.mark.parametrize("way", FILLED)
def test_a_cache_never_changes_the_identity_however_it_is_filled(way: str) -> None:
    statement, helper = FILLED[way]
    text = NETWORK.replace("SEEN.append(1)", statement).replace(
        "SEEN = []", f"SEEN, GRIDS = [], {{}}\n{helper}"
    )
    held = cell(text)
    first = code_identity("mine", held["Net"])
    held["Net"]()(*torch.zeros(2, 1, 3, 4, 4))
    assert held["GRIDS"]
    assert code_identity("mine", held["Net"]) == first


def test_a_module_beside_counts_by_what_is_called_of_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "beside_net.py").write_text("def gain(x):\n    return x\ndef other(x):\n    return x\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    text = NETWORK.replace("import functools", "import beside_net\nimport functools", 1)
    text = text.replace("return level + self.extra", "return beside_net.gain(level) + self.extra")
    net = cell(text)["Net"]
    first, helpers = code_identity("mine", net), sys.modules["beside_net"]
    monkeypatch.setattr(helpers, "other", lambda x: 2 * x)
    assert code_identity("mine", net) == first
    monkeypatch.setattr(helpers, "gain", lambda x: 2 * x)
    assert code_identity("mine", net) != first
    monkeypatch.delitem(sys.modules, "beside_net")


def test_what_cannot_be_told_wants_a_version() -> None:
    text = NETWORK.replace("GRID = np.arange(3)", "GRID = np.random.default_rng(0)")
    net = cell(text)["Net"]
    with pytest.raises(InputError, match=r"uses GRID, a numpy\.random.*Generator.*pass version='1'"):
        register_architecture("blind", blocks={"all": ["*"]})(net)
    register_architecture("blind", blocks={"all": ["*"]}, version="1")(net)
    assert architecture("blind").version == "1"


def test_a_partial_of_what_comes_with_sfkit_has_an_identity() -> None:
    anynet = architecture("anynet")
    known = {code_identity("x", functools.partial(anynet.build, ranges=r)) for r in ([4], [5], [4])}
    assert len(known) == 2


@pytest.mark.parametrize(
    "value", [np.float32(1), torch.ones(2), nn.Linear(1, 1), frozenset({1, "a"}), {1: {2}}]
)
def test_values_of_many_kinds_have_an_identity(value: object) -> None:
    def build() -> nn.Module:
        return nn.Identity() if value is None else nn.Flatten()

    assert code_identity("x", build) == code_identity("x", build)


def test_an_edited_helper_is_never_answered_from_the_store(tmp_path: Path) -> None:
    """Measured before: 3.78 from the store where 2.90 was true."""

    def registered(text: str) -> dict[str, Any]:
        held = cell(text)
        sfkit.register_architecture("mine", blocks={"all": ["*"]})(held["Net"])
        return held

    def score(evaluator: Callable[..., Any]) -> float:
        return float(evaluator([pool.base_recipe()])[0].score)

    spec = replace(flat_spec(tmp_path, {"low": 4.0}), architecture="mine")
    store = sfkit.EvaluationStore(tmp_path / "store.sqlite")
    held = registered(NETWORK)
    pool = sfkit.open_pool(spec)
    first = sfkit.Evaluator(pool, benchmark(truths=(5.0,), metric="epe"), store=store)
    assert score(first) == 0.0
    held["Gain"].value = 2.0  # the cell of the helper alone is run again
    with pytest.raises(InputError, match="its code has changed since this evaluator was made"):
        score(first)
    pool = sfkit.open_pool(spec)
    assert score(sfkit.Evaluator(pool, benchmark(truths=(5.0,), metric="epe"), store=store)) == 5.0
    held["Gain"].value = 1.0
    again = sfkit.Evaluator(pool, benchmark(truths=(5.0,), metric="epe"), store=store)
    assert (score(again), again.counts.cached) == (0.0, 1)


ORDINARY = """
import dataclasses
from collections import namedtuple
import torch
from torch import nn

Size = namedtuple("Size", "height width")

@dataclasses.dataclass(frozen=True)
class Settings:
    gain: float = 1.0
    sizes: list = dataclasses.field(default_factory=list)

class Net(nn.Module):
    def __init__(self):
        super().__init__()
        self.level = nn.Parameter(torch.zeros(1))
        self.pool = nn.MaxPool2d(1)
        self.settings = Settings()

    @torch.no_grad()
    def forward(self, left, right):
        import colorsys
        size = Size(*left.shape[-2:])
        return torch.full((1, *size), float(self.level) * self.settings.gain + 0 * len(colorsys.__all__))
"""


def test_ordinary_code_needs_no_version_and_attributes_are_no_globals(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """A notebook's ``pool`` is not ``self.pool``; an import that runs later changes nothing."""
    monkeypatch.setitem(sys.modules, "mine", ModuleType("mine"))  # where dataclasses look
    sys.modules.pop("colorsys", None)
    there = cell(ORDINARY)
    before = code_identity("mine", there["Net"])
    there["pool"] = object()  # whose state nobody can tell
    sys.modules.pop("colorsys", None)
    assert code_identity("mine", there["Net"]) == before
    assert there["Net"]()(torch.zeros(1, 3, 2, 4), None).shape == (1, 2, 4)
    assert code_identity("mine", there["Net"]) == before
    edited = cell(ORDINARY.replace("gain: float = 1.0", "gain: float = 2.0"))
    assert code_identity("mine", edited["Net"]) != before
