"""Make a bank from its seeds: train the base, fine-tune the sources, write what ships."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from safetensors.torch import load_file, save_file

from sfkit.bank import sharp
from sfkit.bank.fingerprints import write_fingerprints
from sfkit.bank.measure import TruePair, constant_guess, errors, held_out_pairs
from sfkit.bank.plan import BANK, HELD_OUT_PAIRS, BankPlan, Training, TrainingPlan, bank_plan
from sfkit.bank.training import new_network, pairs_of, train
from sfkit.datasets.synthetic import Domain
from sfkit.errors import ensure_known
from sfkit.evaluation.table import ProgressCallback
from sfkit.files import write_text, writing
from sfkit.training.finetune import finetune
from sfkit.training.loop import Course, Listener
from sfkit.training.places import training_folder
from sfkit.training.settings import TrainingSettings

LICENCE = "Apache-2.0"
Record = dict[str, Any]


@dataclass(frozen=True)
class _Builder:
    """What all trainings of one bank share."""

    out: Path
    of: BankPlan
    held_out: int
    progress: ProgressCallback | None

    def file(self, name: str) -> Path:
        return self.out / f"{'base' if self.is_base(name) else name}.safetensors"

    def record_file(self, name: str) -> Path:
        return self.out / "training" / f"{name}.json"

    def is_base(self, name: str) -> bool:
        return name == self.of.networks[0]

    def finished(self, name: str) -> bool:
        return self.record_file(name).exists()


def build(
    out: Path,
    name: str = BANK.name,
    *,
    progress: ProgressCallback | None = None,
    only: Iterable[str] | None = None,
    base_plan: Training | None = None,
    source_plan: Training | None = None,
    held_out: int = HELD_OUT_PAIRS,
) -> Path:
    """Train the bank called ``name`` into the folder ``out`` and return the path of its ``pool.toml``.

    A finished training is not repeated and a stopped one goes on from its last saved step, so calling
    this again resumes. ``only`` names the networks to train in this process (after the base), so that
    several processes can share the work; ``pool.toml`` is written as soon as base and sources are there.
    Each finished network is measured on ``held_out`` pairs of its own domain. Training carries rounding
    along, so a bank built on another machine or with another PyTorch is as good as the shipped one, not
    equal to it bit by bit. With one thread the base of ``bank`` takes about ten minutes and a source two to
    five; that of ``bank-sharp`` an hour and three quarters, a source four minutes and the joint network 45,
    and its scenes, 6 GB in ``rendered``, may be deleted when it is built.

    Raises:
        InputError: no bank of that name, or ``only`` names a network that it does not have.
    """
    of = bank_plan(name)
    base, *others = of.networks
    chosen = others if only is None else list(only)
    for each in chosen:
        ensure_known("source of the bank", each, others)
    out.mkdir(parents=True, exist_ok=True)
    at = _Builder(out, of, held_out, progress)
    for each in (base, *chosen):
        if not at.finished(each):
            given = base_plan if at.is_base(each) else source_plan
            _make(at, each, given or of.plan_of(each))
    # A pool.toml that names networks to come would open nowhere.
    if all(at.finished(world.name) for world in of.worlds):
        _assemble(at)
    return out / "pool.toml"


def _make(at: _Builder, name: str, plan: Training) -> None:
    """Train one network, measure it beside the base, and record both."""
    tuned = isinstance(plan, TrainingSettings)
    made = _finetuned(at, name, plan) if isinstance(plan, TrainingSettings) else _trained(at, name, plan)
    pairs = _held_out(at, name) if tuned else held_out_pairs(_world(at.of, name), at.held_out)
    network = new_network(plan.seed, at.of)
    network.load_state_dict(load_file(at.file(at.of.networks[0])))
    own = {"constant_guess": constant_guess(pairs), "base": errors(network, pairs, at.of)}
    if not at.is_base(name):
        network.load_state_dict(load_file(at.file(name)))
        own["source"] = errors(network, pairs, at.of)
    write_text(at.record_file(name), json.dumps({**made, "own_domain": own}, indent=2) + "\n")
    # Once the record is written: a training that is stopped goes on with the pairs it has rendered.
    shutil.rmtree(pairs_of(_state_file(at, name)), ignore_errors=True)


def _trained(at: _Builder, name: str, plan: TrainingPlan) -> Record:
    """Train as the first banks were, and say what it took."""
    start = None if at.is_base(name) else load_file(at.file(at.of.networks[0]))
    world = _world(at.of, name)
    trained = train(world, plan, start, _state_file(at, name), at.progress, of=at.of)
    with writing(at.file(name)) as fresh:
        save_file(dict(trained.weights), fresh)
    return {
        "plan": asdict(plan),
        "seconds": round(trained.seconds, 1),
        "cpu_seconds": round(trained.cpu_seconds, 1),
        "final_loss": trained.final_loss,
    }


def _finetuned(at: _Builder, name: str, settings: TrainingSettings) -> Record:
    """Train by :func:`sfkit.finetune`, and say what it took; its file carries the whole recipe."""
    file, scenes = at.file(name), at.out / "rendered"
    # Killed behind its last step, a training goes on with being measured.
    if not file.exists():
        finetune(
            None if at.is_base(name) else at.file(at.of.networks[0]),
            sharp.training_set(name, scenes),
            file,
            name=at.of.architecture,
            options=at.of.options,
            settings=settings,
            # Watched as it goes; of eleven worlds that would cost more than the training.
            validation=None if name == sharp.JOINT else sharp.held_out(name, scenes, at.held_out),
            licence=LICENCE,
            listen=_listening(at, name, settings),
        )
    recorded = json.loads((training_folder(file) / "training.json").read_text(encoding="utf-8"))
    return {
        "plan": {**recorded["settings"], "steps": recorded["steps"], "scenes": recorded["data"]["pairs"]},
        "licence": recorded["licence"],
        "seconds": recorded["seconds"],
        "cpu_seconds": recorded["cpu_seconds"],
        "final_loss": recorded["loss"],
    }


def _listening(at: _Builder, name: str, settings: TrainingSettings) -> Listener:
    def listen(course: Course) -> None:
        if at.progress is not None and (
            course.done % settings.save_every == 0 or course.done == course.steps
        ):
            # A single step's loss jumps.
            last = [row[1] for row in course.curve[-50:]]
            at.progress(f"{name}: loss {sum(last) / len(last):.3f}", course.done, course.steps)

    return listen


def _held_out(at: _Builder, name: str) -> Sequence[TruePair]:
    return [pair.load() for pair in sharp.held_out(name, at.out / "rendered", at.held_out).pairs]


def _world(of: BankPlan, name: str) -> Domain:
    return next(world for world in of.worlds if world.name == name)


def _state_file(at: _Builder, name: str) -> Path:
    return at.out / "training" / f"{name}.pt"


def _assemble(at: _Builder) -> None:
    finished = [each for each in at.of.networks if at.finished(each)]  # the pool does without the joint one
    records = {each: json.loads(at.record_file(each).read_text()) for each in finished}
    if at.of.benchmarks == at.of.name:  # the other banks share theirs
        write_fingerprints(at.out / "fingerprints.json", of=at.of.name)
    write_text(at.out / "trainings.json", json.dumps(records, indent=2) + "\n")
    write_text(at.out / "pool.toml", pool_toml(at.of))


def pool_toml(of: BankPlan = BANK) -> str:
    """The text of a bank's ``pool.toml``."""
    options = "\n".join(f"{key} = {json.dumps(value)}" for key, value in of.options.items())
    entries = "\n".join(
        f'\n[sources.{world.name}]\nfile = "{world.name}.safetensors"\nlicence = "{LICENCE}"'
        for world in of.worlds[1:]
    )
    return (
        f'name = "sfkit-{of.name}"\narchitecture = "{of.architecture}"\n\n[options]\n{options}\n\n'
        f'[base]\nfile = "base.safetensors"\nlicence = "{LICENCE}"\n{entries}\n'
    )
