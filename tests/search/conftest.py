"""A server that forks searches, shared by the tests that do them harm."""

from __future__ import annotations

from collections.abc import Iterator

import pytest
from faults_world import Run, Searches, computed


@pytest.fixture(scope="session")
def searches(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Searches]:
    """Searches in forked processes."""
    world = Searches(tmp_path_factory.mktemp("faults"))
    yield world
    world.close()


@pytest.fixture(scope="session")
def whole(searches: Searches) -> Run:
    """A search that nothing happened to."""
    run = Run(searches, "whole")
    document = run.finish()
    assert computed(document) == run.count() > 20
    assert document["evaluations"]["failed"] == 0
    return run
