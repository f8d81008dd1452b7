"""``sfkit finetune``: from a base and a training set to a source."""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from sfkit.checkpoints.targets import FileForm, check_target
from sfkit.cli.foreseen import ensure_benchmark, ensure_loadable, ensure_root
from sfkit.cli.groups import Group
from sfkit.cli.options import ForceOption, JsonOption, NetworkOption, emit, say
from sfkit.cli.outputs import Places
from sfkit.cli.panels import DeviceOptions, FolderChoice
from sfkit.cli.terminal import Bars
from sfkit.datasets.shipped import ensure_training_set
from sfkit.outside import read_toml
from sfkit.training.places import OUTPUTS, TRAINED, training_folder
from sfkit.training.settings import Augmentation, TrainingSettings

if TYPE_CHECKING:
    from sfkit.training.finetune import TrainedSource
    from sfkit.training.loop import Course

SHOWN_EVERY = 10


def _read(context: typer.Context, path: Path | None) -> Path | None:
    """Make a file's settings the defaults of options, so that what else is said wins."""
    if path is not None:
        stated = TrainingSettings.from_dict(read_toml(path, "expected training settings"), str(path))
        given = TRAINING.spread(stated) | AUGMENTATION.spread(stated.augmentation)
        context.default_map = given | dict(context.default_map or {})
    return path


def _of_words(**values: Any) -> TrainingSettings:
    return TrainingSettings.from_dict(values, "the command line")


TRAINING = Group(TrainingSettings, "Training", make=_of_words)
AUGMENTATION = Group(Augmentation, "What changes about a pair")
SettingsOption = Annotated[
    Path | None,
    typer.Option(
        "--settings",
        help="A TOML file of training settings, as in a factory.toml.",
        is_eager=True,
        callback=_read,
    ),
]


def command(
    base: Annotated[Path, typer.Argument(help="The checkpoint to start from.")],
    data: Annotated[str, typer.Argument(help="sceneflow, vkitti2, ..., a benchmark's name, or pairs.")],
    root: Annotated[Path, typer.Option("--root", "-r", help="The training set's folder; any part of it.")],
    out: Annotated[Path, typer.Option("--out", "-o", help="The source's file to write.")],
    training: Annotated[TrainingSettings, TRAINING],
    augmentation: Annotated[Augmentation, AUGMENTATION],
    reading: Annotated[FolderChoice, Group(FolderChoice, "Training set", only=("csv", "coding"))],
    compute: DeviceOptions,
    architecture: Annotated[
        str | None, typer.Option("--architecture", "-a", help="For a base that does not say it.")
    ] = None,
    option: NetworkOption = None,
    settings: SettingsOption = None,
    hold_out: Annotated[
        bool, typer.Option("--hold-out/--all", help="Keep the held-out sequences from training, or not.")
    ] = True,
    validation: Annotated[
        str | None, typer.Option(help="A benchmark to score as it goes; it guides nothing.")
    ] = None,
    validation_root: Annotated[Path | None, typer.Option(help="That benchmark's folder.")] = None,
    licence: Annotated[str, typer.Option(help="Of the source; the training set's unless given.")] = "",
    form: Annotated[
        FileForm, typer.Option(help="safetensors, or the base's own torch layout.")
    ] = FileForm.SAFETENSORS,
    force: ForceOption = False,
    json: JsonOption = False,
) -> None:
    """Fine-tune a checkpoint on one training set.

    Stopped at any moment and started again, it goes on and ends with the same file. Several GPUs: start it
    with torchrun, which changes no result while batch norm is frozen.

    \b
    Examples:
      sfkit finetune sceneflow.tar vkitti2 -a anynet --root ~/VirtualKITTI2 -o vkitti2.safetensors
      torchrun --nproc-per-node 4 -m sfkit finetune base.pth fsd -a nmrf-swint -r ~/FSD -o fsd.safetensors
    """
    check_target(out, form, overwrite=force)
    places = Places(settings=settings, csv=reading.csv)
    places.reads("BASE", base)
    places.claim("--out", out)
    places.folder("--out", training_folder(out), OUTPUTS)
    ensure_training_set(data)
    ensure_root(data, root)
    if validation is not None:
        ensure_benchmark(validation, validation_root, place="--validation-root")
    options = ensure_loadable(base, architecture, option, trained=TRAINED)
    from sfkit.datasets.benchmark import open_benchmark
    from sfkit.datasets.training_sets import open_training_set

    chosen = replace(training, augmentation=augmentation)
    pairs = open_training_set(data, root, hold_out=hold_out, coding=reading.coding, table=reading.csv)
    say(f"{pairs.name}: {pairs.coverage}, {len(pairs.held_out)} held out, {chosen.steps(len(pairs))} steps")
    scored = None if validation is None else open_benchmark(validation, validation_root)
    from sfkit.training.finetune import finetune

    with _Processes(compute.kind), Bars() as bars:
        source = finetune(
            base,
            pairs,
            out,
            name=architecture,
            options=options,
            settings=chosen,
            validation=scored,
            device=compute.device,
            licence=licence,
            form=form,
            overwrite=force,
            listen=progress(bars, chosen.batch),
        )
    # Every process of torchrun is here; one speaks.
    if int(os.environ.get("RANK", 0)) == 0:
        emit(*_told(source), as_json=json)


def _told(source: TrainedSource) -> tuple[dict[str, Any], str]:
    from sfkit.training.places import training_folder

    document = {
        "file": source.path,
        "steps": source.steps,
        "samples": source.samples,
        "loss": source.loss,
        "seconds": source.seconds,
        "scores": dict(source.scores),
        "broken": dict(source.broken),
        "curve": training_folder(source.path) / "training.csv",
    }
    lines = [
        f"wrote {source.path}",
        f"  {source.steps} steps, {source.samples} samples in {source.seconds:.0f} s, loss {source.loss:.3f}",
        *(f"  could not be read: {name}: {why}" for name, why in source.broken.items()),
    ]
    return document, "\n".join(lines)


def progress(bars: Bars, batch: int) -> Callable[[Course], None]:
    """Says loss, rate, samples a second and the time left: in lines every ten steps of ``batch`` pairs."""

    def advance(course: Course) -> None:
        step, pace = course.last, course.seconds / course.done
        score = f", validation {course.scores[-1][1]:.2f}" if course.scores else ""
        note = f"loss {step.loss:.3f}, rate {step.rate:.1e}"
        line = f"step {step.number} of {course.steps}: {note}, {batch / pace:.2f} samples a second, "
        line += f"{pace * (course.steps - course.done):.0f} s left{score}"
        told = not course.done % SHOWN_EVERY or course.done == course.steps
        bars("training", course.done, course.steps, note + score, line=line if told else None)

    return advance


class _Processes:
    """The process group that torchrun asks for; nothing without it."""

    def __init__(self, kind: str) -> None:
        self.backend = "nccl" if kind == "cuda" else "gloo"

    def __enter__(self) -> None:
        if "RANK" in os.environ:
            import torch.distributed as dist

            dist.init_process_group(self.backend)

    def __exit__(self, *_error: object) -> None:
        if "RANK" in os.environ:
            import torch.distributed as dist

            dist.destroy_process_group()
