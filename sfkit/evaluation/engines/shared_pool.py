"""A pool as plain arrays, to be shared through an object store by workers that have no files."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sfkit.architectures import architecture
from sfkit.datasets.benchmark_record import Benchmark
from sfkit.datasets.pairs import MemoryPair
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging.flat import FlatLayout
from sfkit.merging.pool import Pool
from sfkit.merging.vectors import TaskVectors


@dataclass(frozen=True)
class TensorBytes:
    """A tensor's bytes, in any dtype that torch has: numpy lacks bfloat16."""

    data: NDArray[np.uint8]
    dtype: torch.dtype
    shape: tuple[int, ...]

    @classmethod
    def of(cls, tensor: torch.Tensor) -> TensorBytes:
        """Share the memory of a contiguous tensor on the CPU, copy any other."""
        # As bytes: numpy has no bfloat16.
        flat = tensor.detach().cpu().contiguous().reshape(-1).view(torch.uint8)
        return cls(flat.numpy(), tensor.dtype, tuple(tensor.shape))

    def tensor(self) -> torch.Tensor:
        """The tensor in the same memory; nothing may write to it."""
        # There are no bytes to view.
        if not self.data.size:
            return torch.empty(self.shape, dtype=self.dtype)
        # Object stores hand out read-only memory, and torch warns of it.
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="The given NumPy array is not writable")
            return torch.from_numpy(self.data).view(self.dtype).reshape(self.shape)


@dataclass(frozen=True)
class SharedPool:
    """A :class:`~sfkit.merging.pool.Pool`, its architecture by name and its tensors as bytes.

    Attributes:
        record: the pool's other fields, by name.
        layout: of the flat buffers.
        rounding: of merges.
        base_flat: the base in that layout.
        vectors: source name -> task vector.
        base_tensors: key -> the base's tensor.
    """

    record: Mapping[str, Any]
    layout: FlatLayout
    rounding: torch.dtype | None
    base_flat: TensorBytes
    vectors: Mapping[str, TensorBytes]
    base_tensors: Mapping[str, TensorBytes]

    @classmethod
    def of(cls, pool: Pool) -> SharedPool:
        """The parts of a pool, sharing its memory."""
        apart = ("architecture", "base_tensors", "task_vectors")
        return cls(
            {f.name: getattr(pool, f.name) for f in fields(pool) if f.name not in apart},
            pool.layout,
            pool.task_vectors.rounding,
            TensorBytes.of(pool.base_flat),
            {name: TensorBytes.of(vector) for name, vector in pool.vectors.items()},
            {key: TensorBytes.of(tensor) for key, tensor in pool.base_tensors.items()},
        )

    def open(self) -> Pool:
        """The pool again, in this memory; its architecture must be registered.

        Raises:
            InputError: no such architecture.
        """
        by_source = {name: data.tensor() for name, data in self.vectors.items()}
        return Pool(
            architecture=architecture(self.record["spec"].architecture),
            base_tensors={key: data.tensor() for key, data in self.base_tensors.items()},
            task_vectors=TaskVectors(self.layout, self.base_flat.tensor(), by_source, self.rounding),
            **self.record,
        )


def in_memory(prepared: PreparedBenchmark) -> Benchmark:
    """The benchmark with its loaded samples in the place of files; each still knows what it was read from."""
    pairs = zip(prepared.benchmark.pairs, prepared.samples, strict=True)
    held = tuple(MemoryPair(pair.id, sample, pair.fingerprint()) for pair, sample in pairs)
    return replace(prepared.benchmark, pairs=held)
