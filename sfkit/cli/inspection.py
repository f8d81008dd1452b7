"""What is this file, and how was it made? Behind ``sfkit show``."""

from __future__ import annotations

import math
import shlex
import warnings
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from sfkit.checkpoints.fingerprints import fingerprint, tensor_digest
from sfkit.checkpoints.headers import SUFFIXES, TensorPlace
from sfkit.checkpoints.layouts import Layout
from sfkit.checkpoints.spec import read_pool_spec
from sfkit.checkpoints.stored import stored_file
from sfkit.errors import InputError, SfkitWarning
from sfkit.files import trouble
from sfkit.merging.known import Relations, architecture_of, relations
from sfkit.merging.origin import Origin, read_origin
from sfkit.merging.recipe import Recipe
from sfkit.merging.steps import describe
from sfkit.outside import parse_json, table
from sfkit.training.places import TRAINED

STORE_SUFFIXES = (".sqlite", ".db")


@dataclass(frozen=True)
class Description:
    """A file explained: plain values, and the same as text."""

    document: Mapping[str, Any]
    text: str


def inspect_file(path: str | Path) -> Description:
    """Explain a network, a folder of networks, a ``pool.toml``, a recipe, or an evaluation store.

    A network that sfkit did not merge is named by its keys; members of a pool come with their nearness to the
    base. Both read the files whole.

    Raises:
        InputError: there is no such file, or it is of no kind sfkit knows.
        StoreError: an evaluation store that is damaged.
    """
    path = Path(path)
    if path.is_dir() and (path / "pool.toml").is_file():
        path = path / "pool.toml"
    if path.is_dir():
        return _folder(path)
    if why := trouble(path):
        raise InputError(f"{path}: {why}, expected a network, a pool.toml, a recipe or a store")
    readers: dict[str, Callable[[Path], Description]] = {
        **dict.fromkeys(SUFFIXES, _network),
        **dict.fromkeys(STORE_SUFFIXES, _store),
        ".toml": _pool,
        ".json": _recipe,
    }
    if path.suffix not in readers:
        raise InputError(f"{path}: found the ending {path.suffix!r}, expected one of {', '.join(readers)}")
    return readers[path.suffix](path)


def _network(path: Path) -> Description:
    tensors, digests, layout, texts = _tensors(path)
    elements = sum(math.prod(tensor.shape) for tensor in tensors.values())
    identity = fingerprint(digests)
    origin = read_origin(path)
    training = _training(path, texts)
    names = _architectures(path, tensors, origin)
    document = {
        "kind": "merged network" if origin else "checkpoint",
        "file": str(path),
        "fingerprint": identity,
        "tensors": len(tensors),
        "elements": elements,
        "dtypes": sorted({tensor.dtype.removeprefix("torch.") for tensor in tensors.values()}),
        "layout": {"container": layout.container, "prefix": layout.prefix},
        "architectures": names,
        "origin": _origin(origin) if origin else None,
        "training": training,
    }
    lines = [
        f"{path}: {document['kind']}, {len(tensors)} tensors, {elements:,} elements",
        f"  architecture: {' or '.join(names) or 'none that sfkit knows has these keys'}",
        f"  fingerprint: {identity[:12]}",
        f"  layout: {layout.container or 'bare state dict'}, prefix {layout.prefix or 'none'}",
    ]
    made = _origin_lines(origin) if origin else [] if training is None else _training_lines(training)
    return Description(document, "\n".join([*lines, *made]))


def _architectures(path: Path, tensors: Mapping[str, TensorPlace], origin: Origin | None) -> list[str]:
    """What a merged file says it is, or what another one's keys and shapes fit."""
    if origin is not None:
        return [str(origin.architecture["name"])]
    if known := architecture_of(tensors):
        return [known]
    from sfkit.merging.recognition import recognised

    return list(recognised(path))


def _folder(folder: Path) -> Description:
    from sfkit.merging.recognition import family

    found = family(folder)
    document = {
        "kind": "folder of checkpoints",
        "file": str(folder),
        "architecture": found.architecture,
        "base": found.base.name,
        "cosines": {path.name: found.cosines[path] for path in (found.base, *found.sources)},
        "skipped": {path.name: why for path, why in found.skipped.items()},
    }
    members = [f"  {path.name}: cosine to the base {found.cosines[path]:.3f}" for path in found.sources]
    lines = [
        f"{folder}: {len(members) + 1} checkpoints of {found.architecture}",
        f"  {found.base.name}: the base, for all others are near it",
        *members,
        *(f"  left out: {why}" for why in found.skipped.values()),
        f"  sfkit init {shlex.quote(str(folder))} writes its pool.toml",
    ]
    return Description(document, "\n".join(lines))


def _tensors(path: Path) -> tuple[Mapping[str, TensorPlace], dict[str, str], Layout, Mapping[str, str]]:
    """Bare key -> tensor, bare key -> digest, layout and text entries; without torch where nothing is
    unusual.
    """
    if stored := stored_file(path):
        return stored.places, stored.digests(), stored.layout, stored.metadata
    from sfkit.checkpoints.reading import read_checkpoint

    file = read_checkpoint(path)
    held = file.tensors.items()
    places = {key: TensorPlace(str(tensor.dtype), tuple(tensor.shape), 0, 0) for key, tensor in held}
    return places, {key: tensor_digest(tensor) for key, tensor in held}, file.layout, file.metadata


def _training(path: Path, texts: Mapping[str, str]) -> dict[str, Any] | None:
    """How ``sfkit finetune`` made a file, as it says; None where it says nothing."""
    if TRAINED not in texts:
        return None
    where = f"{path}: its {TRAINED} entry"
    return table(parse_json(texts[TRAINED], where, "was it edited?"), where)


def _training_lines(training: Mapping[str, Any]) -> list[str]:
    def part(name: str) -> Mapping[str, Any]:
        found = training.get(name)
        return found if isinstance(found, Mapping) else {}

    data, base, settings = part("data"), part("base"), part("settings")
    of = "" if data.get("expected") is None else f" of {data['expected']}"
    start = (
        f"{base['file']} ({str(base.get('fingerprint'))[:12]})" if base.get("file") else "none, drawn anew"
    )
    return [
        f"  trained by sfkit {part('versions').get('sfkit')} on {data.get('name')}, "
        f"{data.get('pairs')}{of} pairs: {training.get('steps')} steps of {settings.get('batch')}, seed "
        f"{settings.get('seed')}",
        f"  base: {start}, licence: {base.get('licence') or 'not stated'}",
        f"  licence: {training.get('licence') or 'not stated'}",
    ]


def _origin(origin: Origin) -> dict[str, Any]:
    return {
        "pool": origin.pool,
        "sfkit": origin.sfkit,
        "architecture": dict(origin.architecture),
        "base": dict(origin.base),
        "sources": {name: dict(source) for name, source in origin.sources.items()},
        "licences": origin.licences,
        "recipe": origin.recipe.as_dict(),
    }


def _origin_lines(origin: Origin) -> list[str]:
    made = f"  made by sfkit {origin.sfkit} from pool {origin.pool!r} ({origin.architecture['name']})"
    members = {"base": origin.base, **origin.sources}
    parts = [
        f"  {name}: {member['file']} ({member['fingerprint'][:12]}), licence: {origin.licences[name]}"
        for name, member in members.items()
    ]
    return [made, *parts, *recipe_lines(origin.recipe)]


def recipe_lines(recipe: Recipe) -> list[str]:
    """A recipe as text: a line a block, weights in the order of its sources."""
    if not recipe.sources:
        return ["  recipe: the base itself"]
    width = max(len(block) for block in recipe.blocks)
    prepared = [f"  task vectors: {describe(recipe.preparation)}"] if recipe.preparation else []
    lines = [*prepared, f"  recipe over {', '.join(recipe.sources)}:"]
    for block, row, scale in zip(recipe.blocks, recipe.weights, recipe.scales, strict=True):
        weights = " ".join(f"{weight:.3f}" for weight in row)
        lines.append(f"    {block:<{width}}  weights {weights}  scale {scale:.3f}")
    return lines


def _pool(path: Path) -> Description:
    spec = read_pool_spec(path)
    members = {m.name: m for m in (spec.base, *spec.sources)}
    document = {
        "kind": "pool",
        "file": str(path),
        "name": spec.name,
        "architecture": spec.architecture,
        "options": dict(spec.options),
        "members": {
            name: {"file": str(m.path), "exists": m.path.is_file(), "licence": m.licence, "note": m.note}
            for name, m in members.items()
        },
    }
    lines = [f"{path}: pool {spec.name!r} of {spec.architecture}, base and {len(spec.sources)} sources"]
    for name, member in members.items():
        there = "" if member.path.is_file() else " (missing)"
        lines.append(f"  {name}: {member.path.name}{there}, licence: {member.licence or 'not stated'}")
    if all(member.path.is_file() for member in members.values()):
        more, opened = _opened(path)
        document, lines = {**document, **more}, [*lines, *opened]
    return Description(document, "\n".join(lines))


def _opened(path: Path) -> tuple[dict[str, Any], list[str]]:
    """Blocks, and how near each source is to the base; or why the pool cannot be opened."""
    doubts: tuple[str, ...] = ()
    try:
        # Without opening the pool, where nothing in it is unusual.
        found = relations(read_pool_spec(path))
        if found is None:
            found, doubts = _relations(path)
    except InputError as error:
        return {"problem": str(error)}, [f"  cannot be opened: {error}"]
    kinships, sizes = found.kinships, found.blocks
    document = {
        "kinships": {name: {"cosine": k.cosine, "distance": k.distance} for name, k in kinships.items()},
        "blocks": sizes,
        "warnings": list(doubts),
    }
    lines = [
        *(
            f"  {name}: cosine to the base {k.cosine:.4f}, distance {k.distance:.4f} of its norm"
            for name, k in kinships.items()
        ),
        f"  blocks: {', '.join(f'{block} ({size:,} changed)' for block, size in sizes.items())}",
        *(f"  warning: {warning}" for warning in doubts),
    ]
    return document, lines


def _relations(path: Path) -> tuple[Relations, tuple[str, ...]]:
    """Of any pool, which is opened for it, with what is doubtful of it."""
    from sfkit.merging.opening import open_pool

    # They are lines of the description below, and not to be said twice.
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", SfkitWarning)
        pool = open_pool(path)
    sizes = {
        block: sum(s.stop - s.start for s in pool.layout.segments if s.block == number)
        for number, block in enumerate(pool.blocks)
    }
    return Relations({source.name: source.kinship for source in pool.sources}, sizes), pool.warnings


def _recipe(path: Path) -> Description:
    recipe = Recipe.from_json(path.read_text(encoding="utf-8", errors="replace"), where=str(path))
    document = {"kind": "recipe", "file": str(path), "recipe": recipe.as_dict()}
    return Description(document, "\n".join([f"{path}: recipe", *recipe_lines(recipe)]))


def _store(path: Path) -> Description:
    from sfkit.evaluation.outcome import total_known
    from sfkit.evaluation.store import EvaluationStore

    if path.stat().st_size == 0:  # opening it would turn it into a store
        raise InputError(f"{path}: is empty, expected an evaluation store")
    with EvaluationStore(path, read_only=True) as store:
        evaluations = list(store)
    failed = sum(evaluation.failure is not None for evaluation in evaluations)
    benchmarks = sorted({str(e.description.get("benchmark", ""))[:12] for e in evaluations})
    document = {
        "kind": "evaluation store",
        "file": str(path),
        "evaluations": len(evaluations),
        "failed": failed,
        "seconds": sum(evaluation.seconds for evaluation in evaluations),
        "cpu_seconds": total_known(evaluation.cpu_seconds for evaluation in evaluations),
        "benchmarks": benchmarks,
    }
    text = (
        f"{path}: evaluation store, {len(evaluations)} evaluations ({failed} failed) on {len(benchmarks)} "
        f"benchmarks, {document['seconds']:.1f} s of computing"
    )
    if document["cpu_seconds"] is not None:
        text += f" ({document['cpu_seconds']:.1f} s of CPU)"
    return Description(document, text)
