"""The members of a pool: every file is read once, checked, fingerprinted and turned into its task vector."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import torch

from sfkit.architectures import Architecture
from sfkit.checkpoints.checks import Kind, TensorSpec, check_keys, check_types, check_values
from sfkit.checkpoints.fingerprints import fingerprint, tensor_digest
from sfkit.checkpoints.kinship import Kinship, KinshipSums
from sfkit.checkpoints.layouts import Layout, Wrapping
from sfkit.checkpoints.prefixes import network_prefix
from sfkit.checkpoints.reading import CheckpointFile, read_checkpoint
from sfkit.checkpoints.spec import Member
from sfkit.errors import InputError, SfkitError
from sfkit.files import Signature
from sfkit.merging.blocks import BlockPartition
from sfkit.merging.buffers import MAPPED_ABOVE, allocate
from sfkit.merging.cache import FileRecord, VectorCache, VectorRecord, vector_key
from sfkit.merging.flat import FlatLayout
from sfkit.merging.vectors import TaskVectors

ITSELF = Kinship(1.0, 0.0)  # the base's kinship to the base
SEEN = "sfkit.seen"
"""The text entry in which a network that sfkit trained names the pairs it saw, by their digests."""


@dataclass(frozen=True)
class Checked:
    """A member of a pool after its content has been read.

    Attributes:
        name: the source's name, or ``base``.
        path: its file.
        fingerprint: identity of its content.
        licence: as ``pool.toml`` gives it.
        note: as ``pool.toml`` gives it.
        layout: how the file wraps its tensors.
        absent: keys of optional tensors it lacks.
        kinship: how near it lies to the base.
        thawed: keys it changed although the architecture calls them frozen.
        kept: keys of buffers of numbers whose values differ from the base's, which merges keep.
        signatures: what each file it was read from looked like then.
        seen: digests of the pairs it was trained on, as its file tells; empty where it does not.
    """

    name: str
    path: Path
    fingerprint: str
    licence: str
    note: str
    layout: Layout
    absent: tuple[str, ...] = ()
    kinship: Kinship = ITSELF
    thawed: tuple[str, ...] = ()
    kept: tuple[str, ...] = ()
    signatures: Mapping[Path, Signature] = field(default_factory=dict)
    seen: frozenset[str] = frozenset()


@dataclass(frozen=True)
class Staged:
    """A source's task vector over the tensors it changed, packed in canonical order."""

    member: Checked
    changed: tuple[TensorSpec, ...]
    values: torch.Tensor  # (number of changed elements or more,) float32

    def tensors(self) -> Iterator[tuple[str, torch.Tensor]]:
        """The changed tensors' task vectors by key."""
        offset = 0
        for spec in self.changed:
            yield spec.key, self.values[offset : offset + spec.size]
            offset += spec.size


class PoolOpener:
    """Reads one base and its sources against what the architecture's network has."""

    def __init__(
        self,
        architecture: Architecture,
        options: Mapping[str, object],
        specs: Sequence[TensorSpec],
        cache: VectorCache | None = None,
    ) -> None:
        self.architecture = architecture
        self.options = options
        self.specs = tuple(specs)
        # A network this small is read faster than its cache entries.
        small = sum(spec.size for spec in self.specs) * 4 <= MAPPED_ABOVE
        self.cache = None if small else cache

    def headers(self, members: Sequence[Member]) -> list[CheckpointFile | None]:
        """Check every file's keys and shapes before any content is read.

        Returns:
            The opened files; None for one that cannot be mapped and will be read again in its turn, so
            that no two such files are in memory at once.
        """
        opened: list[CheckpointFile | None] = []
        for number, member in enumerate(members):
            file = self.read(member.path, is_base=number == 0, wrapping=member.wrapping)
            # A mapped file takes no memory while it waits; any other is read again at its turn.
            opened.append(file if file.mapped else None)
        return opened

    def read(self, path: Path, *, is_base: bool, wrapping: Wrapping | None = None) -> CheckpointFile:
        """One file with keys as the network names them, its keys and shapes checked."""
        file = self._bare(read_checkpoint(path, wrapping), wrapping)
        if self.architecture.rename is not None:
            names = self.architecture.rename(file.tensors)
            tensors = {names.get(key, key): tensor for key, tensor in file.tensors.items()}
            renamed = {new: old for old, new in names.items() if new != old}
            file = replace(file, tensors=tensors, layout=replace(file.layout, renamed=renamed))
        if self.architecture.check is not None:
            shapes = {key: tuple(tensor.shape) for key, tensor in file.tensors.items()}
            try:
                self.architecture.check(shapes, self.options)
            except InputError as error:
                raise InputError(f"{path}: {error}") from error
        # Optional parts the file has and the network, by its options, does not.
        extra = [key for key in file.tensors if self.architecture.is_optional(key)]
        try:
            check_keys(path, file.tensors, self.specs, known_extra=extra, is_base=is_base)
        except InputError as error:
            lacking = (spec.key for spec in self.specs if spec.key not in file.tensors)
            raise InputError(f"{error}{self.architecture.advice_for(lacking)}") from error
        check_types(path, file.tensors, self.specs)
        return replace(file, tensors=self._unaliased(file.tensors))

    def _bare(self, file: CheckpointFile, wrapping: Wrapping | None) -> CheckpointFile:
        """The file without what stands before the network's keys, and without keys of anything else."""
        prefix = network_prefix(
            file.path,
            file.tensors,
            [s.key for s in self.specs if not (s.tolerant or s.optional or s.aliases)],
            self.architecture.rename,
            wrapping.prefix if wrapping else None,
        )
        if not prefix:
            return file
        tensors = {k.removeprefix(prefix): t for k, t in file.tensors.items() if k.startswith(prefix)}
        return replace(file, tensors=tensors, layout=replace(file.layout, prefix=file.layout.prefix + prefix))

    def _unaliased(self, tensors: Mapping[str, torch.Tensor]) -> dict[str, torch.Tensor]:
        """The tensors with every aliased one under all its keys, under whichever it was found."""
        named = dict(tensors)
        for spec in self.specs:
            keys = (spec.key, *spec.aliases)
            found = next((key for key in keys if key in tensors), None)
            if found is not None and spec.aliases:
                named |= {key: tensors.get(key, tensors[found]) for key in keys}
        return named

    def base(self, member: Member, file: CheckpointFile) -> tuple[Checked, FileRecord]:
        """The base, checked whole, and what identifies each of its tensors."""
        record = self.contents(file)
        return _checked(member, file, record.fingerprint), record

    def contents(self, file: CheckpointFile) -> FileRecord:
        """Read every tensor once: refuse values that are not finite, fingerprint the rest.

        A file the cache knows is not read.
        """
        known = self.cache.file(file, self.architecture.name) if self.cache else None
        if known is not None:
            return known
        digests = {}
        for key, tensor in file.tensors.items():
            check_values(file.path, key, tensor)
            digests[key] = tensor_digest(tensor)
        self._check_aliases(file.path, digests)
        record = FileRecord(fingerprint(digests), digests)
        if self.cache is not None:
            self.cache.remember(file, self.architecture.name, record)
        return record

    def _check_aliases(self, path: Path, digests: Mapping[str, str]) -> None:
        """Refuse a file whose keys of one tensor hold different values: the network can have one alone."""
        for spec in self.specs:
            other = next((key for key in spec.aliases if digests.get(key) != digests.get(spec.key)), None)
            if other is not None:
                raise InputError(
                    f"{path}: {spec.key!r} and {other!r} hold different values, expected the same: both name "
                    "one tensor of the network; was one of them edited?"
                )

    def source(
        self,
        member: Member,
        file: CheckpointFile,
        base: CheckpointFile,
        base_record: FileRecord,
        order: Sequence[TensorSpec],
    ) -> Staged:
        """A source, checked whole, with the task vector of every tensor it changed.

        Args:
            member: the source.
            file: its opened file.
            base: the base's opened file.
            base_record: what identifies the base's tensors.
            order: the mergeable tensors in canonical (buffer) order.
        """
        record = self.contents(file)
        digests = record.digests
        # By digest, so that a tensor which training left alone costs nothing from here on.
        changed = tuple(
            s for s in order if s.key in digests and digests[s.key] != base_record.digests.get(s.key)
        )
        absent = tuple(spec.key for spec in order if spec.key not in digests)
        key = vector_key(base_record.fingerprint, record.fingerprint, "\n".join(s.key for s in changed))
        kinship, values = self._vector(key, file, base, changed)
        thawed = tuple(spec.key for spec in changed if self.architecture.is_frozen(spec.key))
        kept = tuple(
            spec.key for spec in self.specs if self._is_kept(spec, file, digests, base_record.digests)
        )
        found = {"absent": absent, "kinship": kinship, "thawed": thawed, "kept": kept}
        return Staged(_checked(member, file, record.fingerprint, **found), changed, values)

    def _is_kept(
        self, spec: TensorSpec, file: CheckpointFile, own: Mapping[str, str], theirs: Mapping[str, str]
    ) -> bool:
        """Whether a buffer that nobody called constant differs from the base's."""
        known = (*self.architecture.constants, *self.architecture.dead)
        if spec.kind is not Kind.CONSTANT or any(fnmatchcase(spec.key, pattern) for pattern in known):
            return False
        differs = spec.key in own and spec.key in theirs and own[spec.key] != theirs[spec.key]
        found = file.tensors[spec.key] if differs else None
        # Whole numbers count or index: nobody expects a merge of those.
        return found is not None and (found.is_floating_point() or found.is_complex())

    def _vector(
        self, key: str, file: CheckpointFile, base: CheckpointFile, changed: Sequence[TensorSpec]
    ) -> tuple[Kinship, torch.Tensor]:
        """The task vector over ``changed``, packed in that order: from the cache, or computed and kept."""
        size = sum(spec.size for spec in changed)
        if self.cache is None or size * 4 <= MAPPED_ABOVE:
            values = allocate(size, mapped=size * 4 > MAPPED_ABOVE)
            return _subtract(file, base, changed, values), values
        known = self.cache.vector(key)
        if known is None:
            # Into the cache's own file: a big vector is never in memory as a whole.
            with self.cache.writing(key, size) as buffer:
                kinship = _subtract(file, base, changed, buffer)
            self.cache.describe(key, VectorRecord(kinship.cosine, kinship.distance, str(file.path)))
            known = self.cache.vector(key)
        if known is None:
            raise SfkitError(
                f"{self.cache.folder}: a task vector just cached there is gone, is the disk full?"
            )
        return Kinship(known[0].cosine, known[0].distance), known[1]


def _subtract(
    file: CheckpointFile, base: CheckpointFile, changed: Sequence[TensorSpec], out: torch.Tensor
) -> Kinship:
    """Write source minus base of each tensor into ``out``, one after the other; how near the two lie."""
    sums, offset = KinshipSums(), 0
    for spec in changed:
        ours, theirs = file.tensors[spec.key], base.tensors[spec.key]
        # In float32 whatever the files hold: a difference of halves would keep few of its digits.
        torch.sub(ours.float(), theirs.float(), out=out[offset : offset + spec.size].view(spec.shape))
        offset += spec.size
        if spec.kind is Kind.WEIGHT:
            sums.add(theirs, ours)
    return sums.kinship()


def _checked(member: Member, file: CheckpointFile, identity: str, **found: Any) -> Checked:
    told = (member.name, member.path, identity, member.licence, member.note)
    seen = frozenset(file.metadata.get(SEEN, "").split())
    return Checked(*told, file.layout, signatures=file.signatures, seen=seen, **found)


def assemble(
    staged: Sequence[Staged], base: Mapping[str, torch.Tensor], partition: BlockPartition
) -> TaskVectors:
    """The task vectors of all sources over every tensor that any of them changed."""
    specs = {spec.key: spec for source in staged for spec in source.changed}
    layout = FlatLayout.of(specs.values(), partition)
    order = tuple(spec for spec, _ in layout.entries)
    flat_base = torch.empty(layout.size, dtype=torch.float32)
    layout.fill(flat_base, base)
    by_source = {}
    for source in staged:
        # Mostly all sources change the same tensors: then the buffer or mapped file it was read into serves
        # as it is.
        if source.changed == order:
            by_source[source.member.name] = source.values
            continue
        row = allocate(layout.size, mapped=layout.size * 4 > MAPPED_ABOVE)
        layout.fill(row, dict(source.tensors()))
        by_source[source.member.name] = row
    return TaskVectors(layout, flat_base, by_source)
