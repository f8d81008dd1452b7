"""Opening a pool: from a ``pool.toml`` to members that are checked and task vectors ready to merge."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from sfkit.architectures.registry import entry_for
from sfkit.checkpoints.spec import PoolSpec, read_pool_spec
from sfkit.errors import InputError, SfkitWarning
from sfkit.merging.blocks import BlockPartition, parse_partition
from sfkit.merging.cache import VectorCache
from sfkit.merging.flat import FlatLayout
from sfkit.merging.members import Checked, PoolOpener, assemble
from sfkit.merging.named import named_pool
from sfkit.merging.partitions import auto_partition
from sfkit.merging.pool import Pool
from sfkit.merging.recognition import whose_keys
from sfkit.merging.tensor_specs import specs_of, undrawn


def open_pool(
    path: str | Path | PoolSpec,
    *,
    cache: VectorCache | None = None,
    blocks: BlockPartition | Mapping[str, Sequence[str]] | str | None = None,
    progress: Callable[[Path, int, int], None] | None = None,
) -> Pool:
    """Open the pool a ``pool.toml`` describes: every file is checked, then read once.

    ``path`` is that file, its folder, or ``"bank"`` or another name of ``sfkit.bank.banks()``.

    ``blocks`` takes the place of the partition that it or the architecture gives: block name -> globs over
    keys, or ``"modules"`` or ``"disagreement"``, with ``:6`` for another number of blocks than four (see
    :func:`~sfkit.merging.partitions.auto_partition`).

    ``progress`` is called for each file when it was read: the file, how many were, and of how many.

    Task vectors of big networks are kept in ``cache`` (the user's, unless given), so that a second
    opening reads no checkpoint that has not changed.

    Warns (:class:`~sfkit.errors.SfkitWarning`) where a source does not look like a fine-tune of the base
    or lacks an optional part.

    Raises:
        InputError: anything in the description or the files is not as it must be; see
            :mod:`sfkit.checkpoints`.
    """
    spec = path if isinstance(path, PoolSpec) else read_pool_spec(named_pool(path))
    wanted = spec.partition if blocks is None else blocks
    automatic = parse_partition(wanted) if isinstance(wanted, str) else None
    entry = entry_for(spec.architecture, spec.module, spec.path.parent if spec.path else None)
    options = entry.resolve(spec.options, near=spec.base.path)
    network = undrawn(entry, options)
    specs = specs_of(network, entry)
    partition = BlockPartition.of(spec.blocks or entry.blocks_of(network, options))
    # Built for the names and shapes of its tensors alone.
    del network
    partition.check(spec.key for spec in specs)
    opener = PoolOpener(entry, options, specs, cache or VectorCache())
    try:
        base_file, *files = opener.headers((spec.base, *spec.sources))
        base_file = base_file or opener.read(spec.base.path, is_base=True, wrapping=spec.base.wrapping)
    except InputError as error:
        raise InputError(f"{error}{whose_keys(spec.base.path, entry.name)}") from error
    base, record = opener.base(spec.base, base_file)
    # Of all tensors: which ones a source changed shows when it is read.
    order = tuple(s for s, _ in FlatLayout.of(specs, partition).entries)
    told = progress or (lambda *_: None)
    told(spec.base.path, 1, 1 + len(files))
    staged = []
    for number, (member, file) in enumerate(zip(spec.sources, files, strict=True), 2):
        staged.append(
            opener.source(
                member,
                file or opener.read(member.path, is_base=False, wrapping=member.wrapping),  # one at a time
                base_file,
                record,
                order,
            )
        )
        told(member.path, number, 1 + len(files))
    sources = [source.member for source in staged]
    _refuse_twins(sources)
    vectors = assemble(staged, base_file.tensors, partition)
    pool = Pool(
        spec, entry, options, partition, tuple(specs), base, base_file.tensors, tuple(sources), vectors
    )
    pool.ensure_unchanged()  # nothing was written while it was read
    for doubt in pool.warnings:
        warnings.warn(doubt, SfkitWarning, stacklevel=2)
    if automatic is not None:
        by, count = automatic
        return pool.with_blocks(auto_partition(pool, count, by))
    if wanted is None or isinstance(wanted, str):
        return pool
    return pool.with_blocks(wanted if isinstance(wanted, BlockPartition) else BlockPartition.of(wanted))


def _refuse_twins(sources: Sequence[Checked]) -> None:
    seen: dict[str, Checked] = {}
    for source in sources:
        twin = seen.setdefault(source.fingerprint, source)
        if twin is not source:
            raise InputError(
                f"{source.path}: source {source.name!r} has the same content as source {twin.name!r} "
                f"({twin.path}), expected different networks: name it once"
            )
