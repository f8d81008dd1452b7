"""Fine-tuning: what is bit-identical however it is interrupted, and equal however it is divided."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import ClassVar

import numpy as np
import pytest
import torch
import torch.distributed as dist
from safetensors.torch import load_file
from training_worlds import SETTINGS, tiny_sample, tiny_set

import sfkit
from sfkit.datasets.pairs import MemoryPair, Sample
from sfkit.datasets.training_set import TrainingSet
from sfkit.training import Augmentation, TrainingSettings
from sfkit.training.finetune import finetune, read_training
from sfkit.training.loop import Course
from sfkit.training.places import training_folder
from sfkit.training.settings import Precision

NAME, OPTIONS = "anynet", {"ranges": [2, 2, 2], "spn": False}
STEPS = SETTINGS.steps(8)
# Clipped gradients come near Adam's epsilon on this hardly trained base, which then turns rounding to steps.
DIVIDED = replace(SETTINGS, clip=0.0, rate=1e-4)
BRIGHT = 0.55  # mean of a view, in the standard deviations it is normalised by


IDLE, FICKLE = "idle-net", "fickle-net"


@sfkit.register_architecture(IDLE, blocks={"all": ["*"]}, version="1")
class Idle(torch.nn.Module):
    """A network of one convolution, with a layer that no output depends on."""

    def __init__(self) -> None:
        super().__init__()
        self.level = torch.nn.Conv2d(6, 1, 3, padding=1)
        self.unused = torch.nn.Linear(3, 3)

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        """(B, H, W) px."""
        found: torch.Tensor = self.level(torch.cat([left, right], dim=1))
        return found[:, 0]


@sfkit.register_architecture(FICKLE, blocks={"all": ["*"]}, version="1")
class Fickle(Idle):
    """One that passes bright views alone through its second layer."""

    used: ClassVar[list[bool]] = []

    def __init__(self) -> None:
        super().__init__()
        self.unused = torch.nn.Conv2d(1, 1, 3, padding=1)

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        """(B, H, W) px."""
        found = super().forward(left, right)
        self.used.append(bool(left.mean() > BRIGHT))
        return self.unused(found[:, None])[:, 0] if self.used[-1] else found


class KilledError(Exception):
    """Stands for the moment at which a process dies."""


@pytest.fixture(scope="module")
def base(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("base") / "base.safetensors"
    settings = replace(SETTINGS, freeze_batch_norm=False, epochs=2)
    finetune(None, tiny_set(), path, name=NAME, options=OPTIONS, settings=settings)
    return path


def test_stopping_anywhere_and_resuming_ends_with_the_same_file(base: Path, tmp_path: Path) -> None:
    whole = finetune(base, tiny_set(), tmp_path / "whole.safetensors", settings=SETTINGS)
    assert whole.steps == STEPS == 6
    for stop in (1, 4, 5):
        out = tmp_path / f"stopped-{stop}.safetensors"

        def die(course: Course, stop: int = stop) -> None:
            if course.done == stop:
                raise KilledError

        with pytest.raises(KilledError):
            finetune(base, tiny_set(), out, settings=SETTINGS, listen=die)
        assert not out.exists()
        finetune(base, tiny_set(), out, settings=SETTINGS)
        assert out.read_bytes() == whole.path.read_bytes()
        curves = [(training_folder(p) / "training.csv").read_text() for p in (out, whole.path)]
        assert curves[0] == curves[1]


@pytest.mark.skipif(not hasattr(os, "fork"), reason="needs fork: run it on Linux")
@pytest.mark.slow
def test_kill_9_at_random_moments_ends_with_the_same_file(base: Path, tmp_path: Path) -> None:
    whole = finetune(base, tiny_set(), tmp_path / "whole.safetensors", settings=SETTINGS)
    out, rng = tmp_path / "killed.safetensors", np.random.default_rng(0)
    steps = rng.permutation(np.repeat(np.arange(1, STEPS), 2))[:10]
    command = [sys.executable, __file__, str(base), str(out), *map(str, steps)]
    done = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    assert str(-signal.SIGKILL) in done.stdout.split()
    assert len(list(training_folder(out).glob("state-*.pt"))) <= 2
    finetune(base, tiny_set(), out, settings=SETTINGS, overwrite=True)
    assert out.read_bytes() == whole.path.read_bytes()


def test_reading_ahead_in_threads_changes_nothing(base: Path, tmp_path: Path) -> None:
    one = finetune(base, tiny_set(), tmp_path / "a.safetensors", settings=SETTINGS)
    two = finetune(base, tiny_set(), tmp_path / "b.safetensors", settings=replace(SETTINGS, workers=3))
    assert load_file(one.path).keys() == load_file(two.path).keys()
    assert one.path.read_bytes() == two.path.read_bytes()


def test_micro_batches_add_up_to_the_batch(base: Path, tmp_path: Path) -> None:
    scanned = [tiny_sample(i) for i in range(8)]
    for number, sample in enumerate(scanned):  # as many known pixels in none as in another
        sample.disparity[: 5 * number] = np.nan
    data = TrainingSet("scanned", tuple(MemoryPair(s.id, s) for s in scanned))
    whole = finetune(base, data, tmp_path / "a.safetensors", settings=DIVIDED)
    parts = finetune(base, data, tmp_path / "b.safetensors", settings=replace(DIVIDED, micro_batch=1))
    # Sums in another order: AdamW divides by hardly more than rounding where a gradient is nearly zero.
    assert largest_difference(whole.path, parts.path) < 3e-5


def test_bfloat16_computes_in_it_and_keeps_weights_and_repetition(base: Path, tmp_path: Path) -> None:
    """Autocast, as on CUDA: passes in bfloat16, weights, their steps and what is written in float32."""
    low, seen = replace(SETTINGS, precision=Precision.BFLOAT16), set()

    def listen(module: torch.nn.Module, _: object, output: object) -> None:
        if isinstance(module, torch.nn.Conv2d) and isinstance(output, torch.Tensor):
            seen.add((output.dtype, module.weight.dtype))

    handle = torch.nn.modules.module.register_module_forward_hook(listen)
    try:
        once = finetune(base, tiny_set(), tmp_path / "a.safetensors", settings=low)
    finally:
        handle.remove()
    assert seen == {(torch.bfloat16, torch.float32)}
    again = finetune(base, tiny_set(), tmp_path / "b.safetensors", settings=low)
    assert once.path.read_bytes() == again.path.read_bytes()
    whole = finetune(base, tiny_set(), tmp_path / "whole.safetensors", settings=SETTINGS)
    types = [{tensor.dtype for tensor in load_file(one.path).values()} for one in (once, whole)]
    assert types[0] == types[1]
    assert once.loss == pytest.approx(whole.loss, rel=1e-2)
    assert once.loss != whole.loss


def test_two_processes_equal_one(base: Path, tmp_path: Path) -> None:
    alone = finetune(base, tiny_set(), tmp_path / "one.safetensors", settings=DIVIDED)
    said = train_in_two_processes(out := tmp_path / "two.safetensors", base)
    assert largest_difference(alone.path, out) < 1e-6
    assert "find_unused_parameters" not in said


def test_two_processes_equal_one_where_a_parameter_is_never_used(tmp_path: Path) -> None:
    settings = replace(DIVIDED, micro_batch=1)
    alone = finetune(None, tiny_set(), tmp_path / "one.safetensors", name=IDLE, settings=settings)
    train_in_two_processes(out := tmp_path / "two.safetensors", IDLE)
    assert largest_difference(alone.path, out) < 1e-6
    # Weight decay would shrink what no gradient moves.
    torch.manual_seed(settings.seed)
    drawn = Idle().state_dict()
    moved = {key for key, value in load_file(out).items() if not torch.equal(value, drawn[key])}
    assert moved == {"level.weight", "level.bias"}


def test_two_processes_equal_one_where_a_parameter_is_used_by_some_passes(tmp_path: Path) -> None:
    """The first pass uses all of them, and so would say that none is ever without a gradient."""
    settings = replace(DIVIDED, micro_batch=1)
    Fickle.used.clear()
    alone = finetune(None, tiny_set(), tmp_path / "one.safetensors", name=FICKLE, settings=settings)
    by_step = np.reshape(Fickle.used, (STEPS, settings.batch))
    assert by_step[0, :2].all(), "what either process sees first"
    assert not by_step.all(axis=1)[1:].any()
    train_in_two_processes(out := tmp_path / "two.safetensors", FICKLE)
    assert largest_difference(alone.path, out) < 1e-6


def test_frozen_batch_norm_keeps_the_statistics_of_the_base(base: Path, tmp_path: Path) -> None:
    before = load_file(base)
    frozen = load_file(finetune(base, tiny_set(), tmp_path / "a.safetensors", settings=SETTINGS).path)
    trained = replace(SETTINGS, freeze_batch_norm=False)
    free = load_file(finetune(base, tiny_set(), tmp_path / "b.safetensors", settings=trained).path)
    statistics = [key for key in before if key.endswith(("running_mean", "running_var"))]
    assert statistics
    assert all(torch.equal(before[key], frozen[key]) for key in statistics)
    assert not any(torch.equal(before[key], free[key]) for key in statistics)


def test_a_source_is_told_how_it_was_made_and_opens_in_a_pool(base: Path, tmp_path: Path) -> None:
    data = replace(tiny_set(), licence="CC BY 4.0")
    source = finetune(base, data, tmp_path / "tiny.safetensors", settings=SETTINGS)
    told = read_training(source.path)
    assert told is not None
    assert (told["steps"], told["samples"], told["licence"]) == (6, 24, "CC BY 4.0")
    assert told["data"]["pairs"] == 8
    assert told["settings"]["seed"] == 3
    assert told["architecture"]["options"] == {"ranges": [2, 2, 2], "align_corners": True, "spn": False}
    record = json.loads((training_folder(source.path) / "training.json").read_text())
    assert record["cpu_seconds"] > 0
    spec = tmp_path / "pool.toml"
    spec.write_text(
        f'name = "tiny"\narchitecture = "{NAME}"\nroot = "/"\n[options]\nranges = [2, 2, 2]\nspn = false\n'
        f'[base]\nfile = "{base}"\n[sources.tiny]\nfile = "{source.path}"\n'
    )
    pool = sfkit.open_pool(spec)
    assert pool.names == ("tiny",)


def test_a_state_of_another_training_is_refused(base: Path, tmp_path: Path) -> None:
    out = tmp_path / "a.safetensors"

    def die(course: Course) -> None:
        if course.done == 3:
            raise KilledError

    with pytest.raises(KilledError):
        finetune(base, tiny_set(), out, settings=SETTINGS, listen=die)
    with pytest.raises(sfkit.InputError, match=r"state-00000002\.pt: is the state of another training"):
        finetune(base, tiny_set(), out, settings=replace(SETTINGS, rate=2e-3))


class BrokenPair(MemoryPair):
    """A pair whose file cannot be read."""

    def load(self) -> Sample:
        raise sfkit.InputError(f"{self.id}.png: found a file that ends too early")


def test_a_broken_pair_is_named_replaced_and_counted(base: Path, tmp_path: Path) -> None:
    sound = tiny_set().pairs
    data = TrainingSet("broken", (*sound[:7], BrokenPair("tiny-7", tiny_sample(7))))
    few = replace(SETTINGS, broken_share=0.2)
    source = finetune(base, data, tmp_path / "a.safetensors", settings=few)
    assert list(source.broken) == ["tiny-7"]
    told = read_training(source.path)
    assert told is not None
    assert told["broken"] == 1
    with pytest.raises(sfkit.InputError, match=r"1 of 8 pairs cannot be read.*tiny-7"):
        finetune(base, data, tmp_path / "b.safetensors", settings=SETTINGS)


def test_validation_is_scored_as_it_goes(base: Path, tmp_path: Path) -> None:
    from sfkit.datasets import memory_benchmark

    held = memory_benchmark("held", [tiny_sample(20), tiny_sample(21)], metric="epe")
    source = finetune(base, tiny_set(), tmp_path / "a.safetensors", settings=SETTINGS, validation=held)
    assert sorted(source.scores) == [2, 4, 6]
    network = sfkit.load_network(source.path, name=NAME, options=OPTIONS)
    off = []
    for index in (20, 21):
        sample = tiny_sample(index)
        pair = network.inputs.prepare(sample.left, sample.right)
        with torch.inference_mode():
            found = pair.window.crop(network.network(pair.left, pair.right))[0].numpy()
        off.append(np.abs(found - sample.disparity).mean())
    assert source.scores[6] == pytest.approx(np.mean(off), rel=1e-5)


def test_training_lowers_the_loss(tmp_path: Path) -> None:
    settings = TrainingSettings(
        epochs=30, batch=4, rate=5e-3, augmentation=Augmentation.none(), freeze_batch_norm=False, workers=0
    )
    out = tmp_path / "a.safetensors"
    losses: list[float] = []
    finetune(
        None,
        tiny_set(4),
        out,
        name=NAME,
        options=OPTIONS,
        settings=settings,
        listen=lambda course: losses.append(course.last.loss),
    )
    assert np.mean(losses[-5:]) < 0.6 * np.mean(losses[:5])


def train_in_two_processes(out: Path, base: Path | str) -> str:
    """What torchrun's two processes print while they train."""
    command = [sys.executable, "-m", "torch.distributed.run", "--nproc-per-node=2", "--master-port=0"]
    command += ["--rdzv-backend=c10d", "--rdzv-endpoint=localhost:0", __file__, str(base), str(out), "0"]
    done = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout + done.stderr


def largest_difference(first: Path, second: Path) -> float:
    """Over all tensors of two files."""
    one, two = load_file(first), load_file(second)
    return max(float((one[key].double() - two[key].double()).abs().max()) for key in one)


def train(base: str, out: str, stop: int) -> None:
    """Train in a process of its own, under torchrun if it started it; die by signal 9 after ``stop``."""
    if "RANK" in os.environ:
        dist.init_process_group("gloo")
    taken = 0

    def listen(course: Course) -> None:
        nonlocal taken
        taken += 1
        if taken == stop:
            os.kill(os.getpid(), signal.SIGKILL)

    settings = DIVIDED if dist.is_initialized() else SETTINGS
    if base in (IDLE, FICKLE):
        finetune(None, tiny_set(), out, name=base, settings=replace(settings, micro_batch=1))
    else:
        finetune(base, tiny_set(), out, settings=settings, listen=listen, overwrite=True)
    if dist.is_initialized():
        dist.destroy_process_group()


def train_in_a_process(base: str, out: str, stop: int) -> int:
    """The exit code of a fresh process that trains; forked before anything was computed here."""
    pid = os.fork()
    if pid == 0:
        train(base, out, stop)
        os._exit(0)
    return os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])


if __name__ == "__main__":
    torch.set_num_threads(1)
    if len(sys.argv) == 4:
        train(*sys.argv[1:3], int(sys.argv[3]))
    else:
        print(*(train_in_a_process(*sys.argv[1:3], int(stop)) for stop in sys.argv[3:]))
