"""Make the bank from its seeds: train the base, fine-tune the sources, write what ships."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import Any

from safetensors.torch import load_file, save_file

from sfkit.bank.fingerprints import write_fingerprints
from sfkit.bank.measure import constant_guess, errors, held_out_pairs
from sfkit.bank.plan import BANK, HELD_OUT_PAIRS, BankPlan, TrainingPlan, bank_plan
from sfkit.bank.training import Trained, new_network, pairs_of, train
from sfkit.datasets.synthetic.domains import BASE, SOURCES, Domain
from sfkit.errors import unknown_name
from sfkit.evaluation.table import ProgressCallback
from sfkit.files import write_text, writing

LICENCE = "Apache-2.0"
Record = dict[str, Any]


def build(
    out: Path,
    name: str = BANK.name,
    *,
    progress: ProgressCallback | None = None,
    only: Iterable[str] | None = None,
    base_plan: TrainingPlan | None = None,
    source_plan: TrainingPlan | None = None,
    held_out: int = HELD_OUT_PAIRS,
) -> Path:
    """Train the bank called ``name`` into the folder ``out`` and return the path of its ``pool.toml``.

    A finished training is not repeated and a stopped one goes on from its last saved step, so calling
    this again resumes. ``only`` names the sources to train in this process (after the base), so that
    several processes can share the work; ``pool.toml`` is written as soon as every network is there.
    Each finished network is measured on ``held_out`` pairs of its own domain. With one thread, the base
    takes about ten minutes and a source two to five. Training carries rounding along, so a bank built on
    another machine or with another PyTorch is as good as the shipped one, not equal to it bit by bit.

    Raises:
        InputError: no bank of that name, or ``only`` names a source that it does not have.
    """
    of = bank_plan(name)
    chosen = _chosen(only)
    out.mkdir(parents=True, exist_ok=True)
    if not _finished(out, BASE.name):
        _train_base(out, of, base_plan or of.base, held_out, progress)
    for domain in chosen:
        if not _finished(out, domain.name):
            plan = source_plan or of.plan_of(domain.name)
            _train_source(out, of, domain, plan, held_out, progress)
    if all(_finished(out, domain.name) for domain in SOURCES):
        _assemble(out, of)
    return out / "pool.toml"


def _chosen(only: Iterable[str] | None) -> list[Domain]:
    by_name = {domain.name: domain for domain in SOURCES}
    names = list(by_name) if only is None else list(only)
    for name in names:
        if name not in by_name:
            raise unknown_name("source of the bank", name, by_name)
    return [by_name[name] for name in names]


def _train_base(
    out: Path, of: BankPlan, plan: TrainingPlan, held_out: int, progress: ProgressCallback | None
) -> None:
    trained = train(BASE, plan, None, _state_file(out, BASE.name), progress, of=of)
    with writing(out / "base.safetensors") as fresh:
        save_file(dict(trained.weights), fresh)
    network = new_network(plan.seed, of)
    network.load_state_dict(dict(trained.weights))
    pairs = held_out_pairs(BASE, held_out)
    own = {"constant_guess": constant_guess(pairs), "base": errors(network, pairs)}
    _record(out, BASE.name, plan, trained, own)


def _train_source(
    out: Path,
    of: BankPlan,
    domain: Domain,
    plan: TrainingPlan,
    held_out: int,
    progress: ProgressCallback | None,
) -> None:
    base = load_file(out / "base.safetensors")
    trained = train(domain, plan, base, _state_file(out, domain.name), progress, of=of)
    with writing(out / f"{domain.name}.safetensors") as fresh:
        save_file(dict(trained.weights), fresh)
    pairs = held_out_pairs(domain, held_out)
    network = new_network(plan.seed, of)
    network.load_state_dict(base)
    own = {"constant_guess": constant_guess(pairs), "base": errors(network, pairs)}
    network.load_state_dict(dict(trained.weights))
    own["source"] = errors(network, pairs)
    _record(out, domain.name, plan, trained, own)


def _record(out: Path, name: str, plan: TrainingPlan, trained: Trained, own: Record) -> None:
    record = {
        "plan": asdict(plan),
        "seconds": round(trained.seconds, 1),
        "cpu_seconds": round(trained.cpu_seconds, 1),
        "final_loss": trained.final_loss,
        "own_domain": own,
    }
    write_text(_record_file(out, name), json.dumps(record, indent=2) + "\n")
    shutil.rmtree(pairs_of(_state_file(out, name)), ignore_errors=True)


def _finished(out: Path, name: str) -> bool:
    return _record_file(out, name).exists()


def _record_file(out: Path, name: str) -> Path:
    return out / "training" / f"{name}.json"


def _state_file(out: Path, name: str) -> Path:
    return out / "training" / f"{name}.pt"


def _assemble(out: Path, of: BankPlan) -> None:
    records = {d.name: json.loads(_record_file(out, d.name).read_text()) for d in (BASE, *SOURCES)}
    if of is BANK:  # the benchmarks are the same for all
        write_fingerprints(out / "fingerprints.json")
    write_text(out / "trainings.json", json.dumps(records, indent=2) + "\n")
    write_text(out / "pool.toml", pool_toml(of))


def pool_toml(of: BankPlan = BANK) -> str:
    """The text of a bank's ``pool.toml``."""
    options = "\n".join(f"{key} = {json.dumps(value)}" for key, value in of.options.items())
    entries = "\n".join(
        f'\n[sources.{domain.name}]\nfile = "{domain.name}.safetensors"\nlicence = "{LICENCE}"'
        for domain in SOURCES
    )
    return (
        f'name = "sfkit-{of.name}"\narchitecture = "{of.architecture}"\n\n[options]\n{options}\n\n'
        f'[base]\nfile = "base.safetensors"\nlicence = "{LICENCE}"\n{entries}\n'
    )
