"""The bank's worlds stand in for nothing: they guide and test the bank's own pools alone."""

from __future__ import annotations

from pathlib import Path

import pytest

from sfkit import bank
from sfkit.errors import InputError


def test_the_banks_pools_have_its_worlds_unless_others_are_named() -> None:
    worlds = ["bank:indoor-rooms", "bank:hazy-road", "bank:grey-workshop"]
    assert bank.worlds("bank", None) == ("bank:courtyard", worlds)
    assert bank.worlds("bank-slim", None) == ("bank:courtyard", worlds)
    assert bank.worlds("bank", "eth3d", ["middlebury"]) == ("eth3d", ["middlebury"])
    assert bank.worlds("bank", None, []) == ("bank:courtyard", [])


@pytest.mark.parametrize("pool", ["pool.toml", Path("garage/pool.toml")])
def test_a_pool_of_ones_own_has_none_and_is_told_what_to_name(pool: object) -> None:
    with pytest.raises(InputError, match=r"benchmark is missing: pool '.*pool.toml' is none of the bank's"):
        bank.worlds(pool, None)
    assert bank.worlds(pool, "eth3d") == ("eth3d", [])
    assert bank.worlds(pool, "bank:courtyard") == ("bank:courtyard", [])  # asked for by name
