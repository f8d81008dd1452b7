"""A pool as plain arrays, to be shared through an object store by workers that have no files."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray

from sfkit.architectures import architecture
from sfkit.checkpoints.checks import TensorSpec
from sfkit.checkpoints.spec import PoolSpec
from sfkit.datasets.benchmark_record import Benchmark
from sfkit.datasets.pairs import MemoryPair
from sfkit.evaluation.prepared import PreparedBenchmark
from sfkit.merging.blocks import BlockPartition
from sfkit.merging.flat import FlatLayout
from sfkit.merging.opening import Checked
from sfkit.merging.pool import Pool
from sfkit.merging.steps import Step


@dataclass(frozen=True)
class TensorBytes:
    """A tensor's bytes, in any dtype that torch has: numpy lacks bfloat16."""

    data: NDArray[np.uint8]
    dtype: torch.dtype
    shape: tuple[int, ...]

    @classmethod
    def of(cls, tensor: torch.Tensor) -> TensorBytes:
        """Share the memory of a contiguous tensor on the CPU, copy any other."""
        flat = tensor.detach().cpu().contiguous().reshape(-1).view(torch.uint8)
        return cls(flat.numpy(), tensor.dtype, tuple(tensor.shape))

    def tensor(self) -> torch.Tensor:
        """The tensor in the same memory; nothing may write to it."""
        if not self.data.size:
            return torch.empty(self.shape, dtype=self.dtype)
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="The given NumPy array is not writable")
            return torch.from_numpy(self.data).view(self.dtype).reshape(self.shape)


@dataclass(frozen=True)
class PoolParcel:
    """What :class:`~sfkit.merging.pool.Pool` is made of, its architecture by name."""

    spec: PoolSpec
    options: Mapping[str, Any]
    partition: BlockPartition
    specs: tuple[TensorSpec, ...]
    base: Checked
    sources: tuple[Checked, ...]
    layout: FlatLayout
    base_flat: TensorBytes
    vectors: Mapping[str, TensorBytes]
    base_tensors: Mapping[str, TensorBytes]
    preparation: tuple[Step, ...]
    origins: Mapping[str, tuple[Checked, ...]]

    @classmethod
    def of(cls, pool: Pool) -> PoolParcel:
        """The parts of a pool, sharing its memory."""
        return cls(
            pool.spec,
            pool.options,
            pool.partition,
            pool.specs,
            pool.base,
            pool.sources,
            pool.layout,
            TensorBytes.of(pool.base_flat),
            {name: TensorBytes.of(vector) for name, vector in pool.vectors.items()},
            {key: TensorBytes.of(tensor) for key, tensor in pool.base_tensors.items()},
            pool.preparation,
            pool.origins,
        )

    def open(self) -> Pool:
        """The pool again, in the parcel's memory; its architecture must be registered.

        Raises:
            InputError: no such architecture.
        """
        vectors = {name: data.tensor() for name, data in self.vectors.items()}
        tensors = {key: data.tensor() for key, data in self.base_tensors.items()}
        return Pool(
            self.spec,
            architecture(self.spec.architecture),
            self.options,
            self.partition,
            self.specs,
            (self.base, tensors),
            (self.layout, self.base_flat.tensor(), vectors),
            self.sources,
            preparation=self.preparation,
            origins=self.origins,
        )


def in_memory(prepared: PreparedBenchmark) -> Benchmark:
    """The benchmark with its loaded samples in the place of files; each still knows what it was read from."""
    pairs = zip(prepared.benchmark.pairs, prepared.samples, strict=True)
    held = tuple(MemoryPair(pair.id, sample, pair.fingerprint()) for pair, sample in pairs)
    return replace(prepared.benchmark, pairs=held)
