"""What is drawn under a seed is what was drawn before streams had names."""

from __future__ import annotations

import numpy as np
import pytest

from sfkit.streams import Stream, generator


@pytest.mark.parametrize(
    ("stream", "number"),
    [
        (Stream.SUBSET_SEARCH, 1),
        (Stream.ROUTING_SEARCH, 2),
        (Stream.HOLDOUT, 3),
        (Stream.RANDOM_SUBSETS, 3),
        (Stream.BOOTSTRAP_AVERAGE, 11),
    ],
)
@pytest.mark.parametrize("part", [(), (0,), (7,), (2, 5)])
def test_a_stream_draws_what_its_number_always_drew(
    stream: Stream, number: int, part: tuple[int, ...]
) -> None:
    drawn = generator(6, stream, *part).random(4)
    assert np.array_equal(drawn, np.random.default_rng([6, number, *part]).random(4))
