"""Fine-tune a base on one training set and write the source, one file that says how it was made."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from fnmatch import fnmatchcase
from importlib.metadata import version
from pathlib import Path
from typing import Any

import torch
import torch.distributed as dist
from torch import nn

from sfkit.architectures import Architecture, architecture
from sfkit.checkpoints.fingerprints import fingerprint, tensor_digest
from sfkit.checkpoints.layouts import Layout
from sfkit.checkpoints.reading import read_checkpoint
from sfkit.checkpoints.targets import FileForm, check_target
from sfkit.checkpoints.writing import write_checkpoint
from sfkit.datasets.benchmark_record import Benchmark
from sfkit.datasets.training_set import TrainingSet
from sfkit.errors import InputError
from sfkit.evaluation.separation import seen_in_training
from sfkit.files import holding
from sfkit.merging.members import SEEN, PoolOpener
from sfkit.merging.network import load_network
from sfkit.merging.tensor_specs import tensor_specs
from sfkit.outside import parse_json
from sfkit.training.loop import Course, Listener, TrainingTask, train
from sfkit.training.places import LOCK, TRAINED, training_folder
from sfkit.training.recipes import TrainingRecipe, training_recipe
from sfkit.training.record import recording, write_record
from sfkit.training.scoring import scorer_of
from sfkit.training.settings import TrainingSettings


@dataclass(frozen=True)
class StartingPoint:
    """What trainings begin with; reading a large base takes seconds, and sources share theirs.

    Attributes:
        entry: the architecture's.
        options: all of the architecture's options.
        network: with the base's weights.
        layout: of the base's file, and of what is written.
        origin: the base's file, fingerprint and licence; empty where there is none.
    """

    entry: Architecture
    options: Mapping[str, Any]
    network: nn.Module
    layout: Layout
    origin: Mapping[str, str]


@dataclass(frozen=True)
class TrainedSource:
    """A source that was trained: its file, and what it cost.

    Attributes:
        path: the checkpoint.
        steps: how many the training had.
        samples: pairs seen, with repetition.
        loss: mean over the last 50 steps.
        seconds: on the clock, over all sittings.
        cpu_seconds: of this process.
        scores: the validation metric by step.
        broken: pairs that could not be read, and why.
    """

    path: Path
    steps: int
    samples: int
    loss: float
    seconds: float
    cpu_seconds: float
    scores: Mapping[int, float]
    broken: Mapping[str, str]


def finetune(
    base: str | Path | None,
    data: TrainingSet,
    out: str | Path,
    *,
    name: str | None = None,
    options: Mapping[str, Any] | None = None,
    settings: TrainingSettings | None = None,
    validation: Benchmark | None = None,
    device: str = "cpu",
    licence: str = "",
    form: FileForm = FileForm.SAFETENSORS,
    overwrite: bool = False,
    listen: Listener | None = None,
) -> TrainedSource:
    """Train ``base`` on ``data`` and write the network to ``out``, in the key names of the base's file.

    Stopped at any moment and called again with the same arguments it goes on from its last saved state and
    ends with the same file, bit for bit on one kind of device. States, ``training.csv`` and ``training.json``
    lie in a folder beside ``out``; the states go when the file is there.

    Args:
        base: the checkpoint; None starts from weights drawn from the seed, to make a base.
        data: see :func:`sfkit.datasets.training_sets.open_training_set`.
        out: the file to write.
        name: the architecture, for a base that does not say it.
        options: the architecture's options.
        settings: see :class:`~sfkit.training.settings.TrainingSettings`.
        validation: scored at every saved state; it guides nothing.
        device: where forward and backward passes run.
        licence: of the source's weights, kept in the file; the data set's own unless given.
        form: safetensors, or a torch file in the base's layout.
        overwrite: whether an existing ``out`` may be replaced.
        listen: called after every step.

    Raises:
        InputError: files, settings or states that cannot be used, too many pairs that cannot be read, or
            another process that trains to ``out``.
        SfkitError: the loss is no longer finite.
    """
    settings = settings or TrainingSettings()
    out = check_target(out, form, overwrite=overwrite)
    start = starting_point(
        base, name=name, options=options, seed=settings.seed
    )  # refused, it leaves no folder
    with _alone(out):
        check_target(out, form, overwrite=overwrite)  # who was here may have ended with the file
        entry, network = start.entry, start.network
        recipe = training_recipe(network, settings.limit)
        for key, parameter in network.named_parameters():
            parameter.requires_grad_(
                not (entry.is_frozen(key) or any(fnmatchcase(key, dead) for dead in entry.dead))
            )
        made = _made(start, data, settings, recipe, licence)
        folder = training_folder(out)
        task = TrainingTask(
            network=network,
            inputs=entry.inputs(start.options),
            objective=recipe.objective,
            groups=recipe.groups(network, settings.rate or recipe.rate, settings.weight_decay),
            limit=recipe.limit,
            steady=recipe.steady,
            pairs=data.pairs,
            settings=settings,
            folder=folder,
            # All that decides the result: a state of anything else is refused.
            identity=hashlib.sha256(json.dumps(made, sort_keys=True).encode()).hexdigest(),
            device=torch.device(device),
        )
        score = None if validation is None else scorer_of(validation, task.inputs, task.device)
        course = train(task, recording(folder, listen), score)
        result = _result(out, course, settings)
        if _is_first():
            # The checkpoint comes last: where it is, curve and record are, too.
            write_record(folder, course, {**made, **_cost(result)})
            metadata = {
                TRAINED: json.dumps({**made, "broken": len(course.broken)}, sort_keys=True),
                # For searches that would validate on them.
                SEEN: seen_in_training(data.pairs),
            }
            write_checkpoint(
                out,
                network.state_dict(),
                layout=start.layout,
                metadata=metadata,
                form=form,
                overwrite=overwrite,
            )
            # Nothing goes on from them any more.
            for state in folder.glob("state-*.pt"):
                state.unlink()
        return result


def intended(
    start: StartingPoint, data: TrainingSet, *, settings: TrainingSettings, licence: str = ""
) -> dict[str, Any]:
    """What a source of :func:`finetune` from there will say about itself; nothing is trained."""
    return _made(start, data, settings, training_recipe(start.network, settings.limit), licence)


def _made(
    start: StartingPoint,
    data: TrainingSet,
    settings: TrainingSettings,
    recipe: TrainingRecipe,
    licence: str,
) -> dict[str, Any]:
    entry = start.entry
    return {
        "architecture": {"name": entry.name, "version": entry.version, "options": dict(start.options)},
        "base": dict(start.origin),
        "data": data.describe(),
        "settings": settings.describe(),
        "rate": settings.rate or recipe.rate,
        "limit": None if math.isinf(recipe.limit) else recipe.limit,
        "steps": settings.steps(len(data)),
        "samples": settings.steps(len(data)) * settings.batch,
        "licence": licence or data.licence,
        "versions": {"sfkit": version("sfkit"), "torch": torch.__version__},
    }


def read_training(path: str | Path) -> dict[str, Any] | None:
    """How a source was trained, as its file says; None where it does not.

    Raises:
        InputError: the file cannot be read, or its metadata was edited.
    """
    text = read_checkpoint(path).metadata.get(TRAINED)
    if text is None:
        return None
    values = parse_json(text, f"{path}: its {TRAINED} entry", "was it edited?")
    if not isinstance(values, dict):
        raise InputError(f"{path}: its {TRAINED} entry is {type(values).__name__}, expected an object")
    return values


def starting_point(
    base: str | Path | None,
    *,
    name: str | None = None,
    options: Mapping[str, Any] | None = None,
    seed: int = 0,
) -> StartingPoint:
    """Read a base, or draw new weights from the seed where there is none; arguments as :func:`finetune`'s.

    Raises:
        InputError: the base cannot be used, or there is neither base nor name.
    """
    options = options or {}
    if base is None:
        if name is None:
            raise InputError(
                "base and name are missing, expected a checkpoint, or an architecture to begin from"
            )
        entry = architecture(name)
        chosen = entry.resolve(options)
        # Weights are drawn from the seed, and the caller's own draws go on undisturbed.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(seed)
            origin = dict.fromkeys(("file", "fingerprint", "licence"), "")
            return StartingPoint(entry, chosen, entry.build(**chosen), Layout(), origin)
    path = Path(base)
    recorded = read_training(path)
    if name is None and recorded is not None:
        name, options = recorded["architecture"]["name"], {**recorded["architecture"]["options"], **options}
    loaded = load_network(path, name=name, options=options)
    entry = architecture(loaded.name)
    chosen = entry.resolve(options, near=path)
    file = PoolOpener(entry, chosen, tensor_specs(entry, chosen)).read(path, is_base=True)
    identity = fingerprint({key: tensor_digest(tensor) for key, tensor in file.tensors.items()})
    origin = {"file": path.name, "fingerprint": identity, "licence": str((recorded or {}).get("licence", ""))}
    return StartingPoint(entry, chosen, loaded.network, file.layout, origin)


@contextlib.contextmanager
def _alone(out: Path) -> Iterator[None]:
    """Refuse a second training to the same file; of several processes of one the first speaks for all."""
    if not _is_first():
        yield
        return
    busy = f"{out}: another process is training it, wait for its end or give another output"
    with holding(training_folder(out) / LOCK, busy):
        yield


def _is_first() -> bool:
    return not dist.is_initialized() or dist.get_rank() == 0


def _cost(result: TrainedSource) -> dict[str, float | None]:
    seconds = round(result.seconds, 1)
    # One of several processes knows what it took itself, and nothing of the others.
    alone = not dist.is_initialized() or dist.get_world_size() == 1
    cpu = round(result.cpu_seconds, 1) if alone else None
    return {"seconds": seconds, "cpu_seconds": cpu, "loss": result.loss}


def _result(out: Path, course: Course, settings: TrainingSettings) -> TrainedSource:
    # A single step's loss is that of a few pairs.
    last = [row[1] for row in course.curve[-50:]]
    return TrainedSource(
        path=out,
        steps=course.done,
        samples=course.done * settings.batch,
        loss=sum(last) / len(last),
        seconds=course.seconds,
        cpu_seconds=course.cpu_seconds,
        scores={int(step): score for step, score, *_ in course.scores},
        broken=course.broken,
    )
