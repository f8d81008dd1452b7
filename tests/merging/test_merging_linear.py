"""The merge itself, against sums written out by hand and against plain loops over tensors."""

from __future__ import annotations

import math

import pytest
import torch
from hypothesis import given, settings
from hypothesis import strategies as st

from sfkit.checkpoints.checks import Kind, TensorSpec
from sfkit.errors import InputError
from sfkit.merging.blocks import BlockPartition
from sfkit.merging.flat import FlatLayout
from sfkit.merging.linear import CHUNK, convex, merge_flat, weighted_sum
from sfkit.merging.recipe import Recipe, routed

PARTITION = BlockPartition.of({"one": ["a.*"], "two": ["b.*"]})
SPECS = (
    TensorSpec("a.weight", (2,), Kind.WEIGHT),
    TensorSpec("a.running_var", (1,), Kind.STATISTIC),
    TensorSpec("b.weight", (1,), Kind.WEIGHT),
    TensorSpec("z.weight", (1,), Kind.WEIGHT),  # outside every block
    TensorSpec("a.index", (3,), Kind.CONSTANT),
)


def values(layout: FlatLayout, **tensors: list[float]) -> torch.Tensor:
    flat = torch.zeros(layout.size)
    layout.fill(flat, {key.replace("_", ".", 1): torch.tensor(v) for key, v in tensors.items()})
    return flat


def merged(
    recipe: Recipe, base: torch.Tensor, vectors: list[torch.Tensor], layout: FlatLayout
) -> dict[str, list[float]]:
    out = torch.full((layout.size,), math.nan)
    merge_flat(recipe, layout, base, vectors, out)
    return {key: view.tolist() for key, view in layout.views(out).items()}


def test_a_routed_merge_by_hand() -> None:
    layout = FlatLayout.of(SPECS, PARTITION)
    base = values(layout, a_weight=[1.0, 2.0], a_running_var=[1.0], b_weight=[10.0], z_weight=[100.0])
    first = values(layout, a_weight=[4.0, 8.0], a_running_var=[2.0], b_weight=[1.0], z_weight=[40.0])
    second = values(layout, a_weight=[0.0, -4.0], a_running_var=[0.0], b_weight=[3.0], z_weight=[0.0])
    recipe = routed(["x", "y"], ["one", "two"], [[0.25, 0.75], [0.5, 0.5]], [2.0, 0.5])

    result = merged(recipe, base, [first, second], layout)

    assert result["a.weight"] == [1 + 2 * (0.25 * 4), 2 + 2 * (0.25 * 8 - 0.75 * 4)]
    assert result["a.running_var"] == [1 + 0.25 * 2], "a module scale never touches a running statistic"
    assert result["b.weight"] == [10 + 0.5 * (0.5 * 1 + 0.5 * 3)]
    assert result["z.weight"] == [100 + 0.25 * 40], "outside: the first block's routing with a scale of 1"
    assert "a.index" not in result, "constants have no place in the buffer"


def test_task_arithmetic_keeps_statistics_convex() -> None:
    layout = FlatLayout.of(SPECS, PARTITION)
    base = values(layout, a_weight=[1.0, 1.0], a_running_var=[1.0])
    vectors = [values(layout, a_weight=[1.0, 0.0], a_running_var=[-0.8]) for _ in range(2)]
    recipe = Recipe.weighted({"x": 1.0, "y": 1.0}, PARTITION.names)

    result = merged(recipe, base, vectors, layout)

    assert result["a.weight"] == [3.0, 1.0], "parameters follow the plain sum"
    assert result["a.running_var"] == pytest.approx([0.2]), (
        "base + min(1, 2) * (1/2 + 1/2) * -0.8, not 1 - 1.6"
    )


@pytest.mark.parametrize(
    ("weights", "expected"),
    [
        ([0.2, 0.3], [0.2, 0.3]),
        ([1.0, 3.0], [0.25, 0.75]),
        ([0.0, 0.0], [0.0, 0.0]),
        ([0.5, 0.5], [0.5, 0.5]),
    ],
)
def test_convex_weights(weights: list[float], expected: list[float]) -> None:
    assert convex(weights) == expected


def test_zero_weights_read_nothing_and_give_the_base() -> None:
    layout = FlatLayout.of(SPECS, PARTITION)
    base = values(layout, a_weight=[1.0, 2.0])
    poison = torch.full((layout.size,), math.nan)
    recipe = Recipe.weighted({"x": 0.0}, PARTITION.names)

    out = torch.empty(layout.size)
    merge_flat(recipe, layout, base, [poison], out)

    assert torch.equal(out, base)


@settings(max_examples=40, deadline=None)
@given(data=st.data())
def test_equals_a_plain_loop_in_float64(data: st.DataObject) -> None:
    """Against the definition, tensor by tensor, for any number of sources, blocks and tensors."""
    keys = data.draw(st.lists(st.sampled_from("abcd"), min_size=1, max_size=6))
    specs = [
        TensorSpec(f"{block}.{i}.{kind}", (data.draw(st.integers(1, 7)),), Kind(kind))
        for i, block in enumerate(keys)
        for kind in ("weight", "statistic")
    ]
    partition = BlockPartition.of({"a": ["a.*"], "b": ["b.*"], "c": ["c.*"]})
    layout = FlatLayout.of(specs, partition)
    count = data.draw(st.integers(1, 4))
    generator = torch.Generator().manual_seed(data.draw(st.integers(0, 2**31)))
    base = torch.randn(layout.size, generator=generator)
    vectors = [torch.randn(layout.size, generator=generator) for _ in range(count)]
    number = st.floats(0, 2, allow_subnormal=False)
    rows = tuple(tuple(data.draw(number) for _ in range(count)) for _ in partition.names)
    scales = tuple(data.draw(number) for _ in partition.names)
    recipe = Recipe(tuple("uvwx"[:count]), partition.names, rows, scales)

    out = torch.empty(layout.size)
    merge_flat(recipe, layout, base, vectors, out)

    for spec, offset in layout.entries:
        part = slice(offset, offset + spec.size)
        block = "abc".find(spec.key[0])
        row, scale = rows[max(block, 0)], scales[block] if block >= 0 else 1.0
        if spec.kind is Kind.STATISTIC:
            total = sum(row)
            row = tuple(w / total for w in row) if total > 1 else row
            scale = 1.0
        moved = sum(
            (w * v[part].double() for w, v in zip(row, vectors, strict=True)), torch.zeros(spec.size).double()
        )
        assert torch.allclose(out[part].double(), base[part].double() + scale * moved, atol=1e-5)


def test_chunks_leave_no_seam() -> None:
    size = 2 * CHUNK + 3
    generator = torch.Generator().manual_seed(0)
    base, first, second = (torch.randn(size, generator=generator) for _ in range(3))
    out = torch.empty(size)
    weighted_sum(base, [(first, 0.5), (second, 2.0)], out, 0, size)
    assert torch.allclose(out, base + 0.5 * first + 2.0 * second, atol=1e-6)


def test_the_layout_groups_by_block_and_kind_without_gaps() -> None:
    layout = FlatLayout.of(SPECS, PARTITION)
    assert [(s.block, s.kind.value) for s in layout.segments] == [
        (-1, "weight"), (0, "weight"), (0, "statistic"), (1, "weight"),
    ]  # fmt: skip
    assert [s.start for s in layout.segments[1:]] == [s.stop for s in layout.segments[:-1]]
    assert layout.segments[-1].stop == layout.size == 5


def test_a_pattern_that_matches_nothing_is_refused() -> None:
    with pytest.raises(InputError, match=r"block 'two': the pattern 'b\.\*' matches no parameter"):
        PARTITION.check(["a.weight"])
