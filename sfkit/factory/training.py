"""Train what a factory lacks: here, on several devices at a time, or on the machines of a Ray cluster."""

from __future__ import annotations

import subprocess
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any

from sfkit.errors import InputError, SfkitError
from sfkit.evaluation.compute import ensure_ray
from sfkit.evaluation.engines.ray_actors import connect
from sfkit.evaluation.engines.spawned import ISOLATED
from sfkit.factory.file import Factory, Order, read_factory
from sfkit.factory.standing import DONE, RUNNING, files_of, status
from sfkit.training.finetune import finetune
from sfkit.training.loop import Course

Say = Callable[[str], None]
SAID_EVERY = 50  # steps


def train_missing(
    factory: Factory, *, devices: Sequence[str] = ("cpu",), ray: bool = False, say: Say = lambda _: None
) -> tuple[str, ...]:
    """Train every network of a factory that is not done, one a device at a time; return their names.

    Where a network is trained changes nothing about it on one kind of device and one number of threads.

    Args:
        factory: what to train.
        devices: one trains here; several train side by side, each in a process of its own that ends with
            this one.
        ray: spread the trainings over a Ray cluster, whose machines see the same files; each takes a CPU, or
            a GPU where ``devices`` begins with ``cuda``.
        say: told a line when a training begins, and every fifty steps.

    Raises:
        InputError: no device, Ray is not installed, or another process trains one of them now.
        SfkitError: a training failed; the others were waited for, and their sources are kept.
    """
    if not devices:
        raise InputError("devices: found none, expected one such as 'cpu' or 'cuda:0'")
    missing = [item for item in status(factory) if item.state != DONE]
    running = [item.name for item in missing if item.state == RUNNING]
    if running:  # met now rather than after hours of training the others
        named = ", ".join(running)
        raise InputError(f"{factory.file}: another process is training {named}, wait for its end")
    for item in missing:
        say(f"{item.name}: {item.state}, {item.steps} steps")
    names = [item.name for item in missing]
    if ray:
        _on_ray(factory.file, names, devices[0], say)
    elif len(devices) == 1:
        for name in names:
            train_one(factory, name, devices[0], say)
    else:
        _side_by_side(factory.file, names, devices, say)
    return tuple(names)


def train_one(factory: Factory, name: str, device: str = "cpu", say: Say = lambda _: None) -> Path:
    """Train one network of a factory, or go on with it, and return its file.

    Raises:
        InputError: the factory has no such network, or what :func:`~sfkit.training.finetune.finetune`
            refuses.
    """
    order = _order(factory, name)
    file, _ = files_of(factory, [order])[name]
    finetune(
        factory.base,
        order.data,
        file,
        name=factory.architecture,
        options=factory.options,
        settings=order.settings,
        device=device,
        licence=order.licence,
        listen=_reporter(name, say),
    )
    return file


def _order(factory: Factory, name: str) -> Order:
    orders = {order.name: order for order in factory.networks}
    if name not in orders:
        raise InputError(f"{factory.file}: no network {name!r}, expected one of {', '.join(orders)}")
    return orders[name]


def _reporter(name: str, say: Say) -> Callable[[Course], None]:
    def report(course: Course) -> None:
        if course.done % SAID_EVERY == 0 or course.done == course.steps:
            left = course.seconds / course.done * (course.steps - course.done)
            loss = f"loss {course.last.loss:.3f}"
            say(f"{name}: step {course.done} of {course.steps}, {loss}, {left:.0f} s left")

    return report


def _side_by_side(file: Path, names: Sequence[str], devices: Sequence[str], say: Say) -> None:
    waiting: SimpleQueue[str] = SimpleQueue()
    for name in names:
        waiting.put(name)
    failures: list[str] = []

    stopped = threading.Event()

    def work(device: str) -> None:
        while not stopped.is_set():
            try:
                name = waiting.get_nowait()
            except Empty:
                return
            if failure := _train_in_child(file, name, device, say):
                failures.append(failure)

    # Daemons, which an interrupt does not wait for: their children end with this process.
    threads = [threading.Thread(target=work, args=(device,), daemon=True) for device in devices[: len(names)]]
    for thread in threads:
        thread.start()
    try:
        for thread in threads:
            thread.join()
    finally:
        stopped.set()  # a notebook's kernel lives on
    _raise(failures)


def _train_in_child(file: Path, name: str, device: str, say: Say) -> str:
    """Train in another process, which ends when its standard input does; what failed, or nothing."""
    command = [sys.executable, ISOLATED, "-m", "sfkit.factory.child", str(file), name, device]
    child = subprocess.Popen(
        command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
    )
    last = ""
    with child:
        assert child.stdout is not None
        for line in child.stdout:
            last = line.rstrip() or last
            say(last)
    return f"{name}: {last}" if child.returncode else ""


def _on_ray(file: Path, names: Sequence[str], device: str, say: Say) -> None:
    ensure_ray()
    import ray

    if not ray.is_initialized():
        connect(ray)
    wanted: dict[str, Any] = {"num_gpus": 1} if device.startswith("cuda") else {"num_cpus": 1}
    task: Any = ray.remote(max_retries=1, **wanted)(_train_there)
    kind = device.partition(":")[0]  # a task sees the one GPU it was given, as the first
    running = {task.remote(str(file.resolve()), name, kind): name for name in names}
    failures = []
    for done in _as_they_end(list(running)):
        name = running[done]
        try:
            ray.get(done)
            say(f"{name}: done")
        except Exception as error:  # the other trainings are waited for, whatever this one met
            failures.append(f"{name}: {str(error).strip().splitlines()[-1]}")
    _raise(failures)


def _train_there(file: str, name: str, device: str) -> None:
    """What a machine of the cluster does; it sees the factory's files under the same names."""
    train_one(read_factory(file), name, device)


def _as_they_end(running: list[Any]) -> Iterator[Any]:
    import ray

    while running:
        ended, running = ray.wait(running)
        yield from ended


def _raise(failures: Sequence[str]) -> None:
    if failures:
        met = "; ".join(failures)
        raise SfkitError(f"{len(failures)} trainings failed: {met}; all others are done, run again to go on")
