"""What is said of other libraries' models: what they would install, and whether they find the same again."""

from __future__ import annotations

from collections.abc import Iterator
from importlib.metadata import distribution
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from benchmark_scripts import imported


@pytest.fixture(scope="module")
def models() -> Iterator[ModuleType]:
    with imported("sections.models") as (module,):
        yield module


def test_a_package_weighs_what_it_alone_requires(models: ModuleType) -> None:
    assert models.megabytes("numpy", ["sfkit"]) == (0.0, [], [])
    assert {"numpy", "torch"} <= models.required("sfkit").keys()
    assert "pytest" not in models.required("sfkit")  # an extra's
    assert models.megabytes("no-such-package", ["sfkit"]) == (0.0, [], ["no-such-package"])
    size, packages, missing = models.megabytes("Typing_Extensions", [])
    (module,) = (file for file in distribution("typing_extensions").files or () if file.suffix == ".py")
    assert (packages, missing) == (["typing-extensions"], [])
    assert size == pytest.approx(Path(str(module.locate())).stat().st_size / 1e6, abs=0.1)


def test_what_is_apart_is_told_with_how_far(models: ModuleType) -> None:
    one = {"60-0 hyper": np.array([1.0, 2.0]), "60-1 hyper": np.array([4.0]), "60-0 predicted": np.ones(2)}
    other = {**one, "60-1 hyper": np.array([4.0 + 4e-9])}
    assert models.same(one, other, "predicted") == "1 of 1"
    assert models.same(one, other, "hyper") == "1 of 2 (apart by 1e-09)"


def test_another_process_is_given_the_same_draws(models: ModuleType) -> None:
    here, there = models.told("sfkit"), models.in_process("sfkit", 1)
    assert list(here) == list(there)
    assert len(here) == 2 * sum(models.SIZES.values())
    for name, value in here.items():
        assert there[name] == pytest.approx(value, rel=1e-6)
    for name, points, values, new in models.draws():
        assert len(points) == len(values) == int(name.partition("-")[0])
        assert not {row.tobytes() for row in points} & {row.tobytes() for row in new}
