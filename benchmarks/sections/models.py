"""Models of the score in the library's place: what they add to an installation, to a start, and to chance.

Where scikit-learn and BoTorch are installed (``make bench``). What searches by them need is in the section
``optimum``.
"""

from __future__ import annotations

import io
import os
import re
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

import numpy as np
from exhaustive import subset_scores
from packaging.requirements import Requirement
from peers_models import botorch_fitted, scikit_learn_fitted
from sections.start import REPEATS, seconds
from tabulated import numbers

from sfkit.search.acquisition import equal_weights
from sfkit.search.gaussian_process import Array, fit

DOCUMENT = "benchmarks/README.md"

OURS, SCIKIT_LEARN, BOTORCH = "sfkit", "scikit-learn", "BoTorch"
IMPORTS = {
    OURS: "import sfkit.search.bayesian_subset",
    SCIKIT_LEARN: "import sfkit.search.bayesian_subset, sklearn.gaussian_process",
    BOTORCH: "import sfkit.search.bayesian_subset, botorch.fit, botorch.models",
}
SIZES = {60: 5, 200: 2}
"""Points a model learns -> draws of them: what Stage 1 evaluates, and more; BoTorch takes minutes at 400."""
NEW = 500
"""Subsets whose scores are foretold."""
THREADS = (1, 1, 2)
"""BLAS threads of the processes whose models are compared with the first one's."""

Told = dict[str, Array]
"""Hyper-parameters and predictions of every fit."""


def by_ours(points: Array, values: Array, new: Array) -> tuple[Array, Array]:
    """Length scale, noise, mean and variance; mean and deviation."""
    process = fit((points,), values)
    hyper = np.array([*process.lengths, process.noise, process.mean, process.variance])
    return hyper, np.stack(process.predict((new,)))


def by_scikit_learn(points: Array, values: Array, new: Array) -> tuple[Array, Array]:
    """Logarithms of its kernel's parameters; mean and deviation, that of the noise with it."""
    process = scikit_learn_fitted(points, values)
    return process.kernel_.theta, np.stack(process.predict(new, return_std=True))


def by_botorch(points: Array, values: Array, new: Array) -> tuple[Array, Array]:
    """Its raw parameters; mean and variance."""
    import torch

    model = botorch_fitted(points, values)
    with torch.no_grad():
        told = model.posterior(torch.from_numpy(new))
        hyper = torch.cat([value.reshape(-1) for value in model.parameters()])
    return hyper.numpy(), np.stack([told.mean[:, 0].numpy(), told.variance[:, 0].numpy()])


MODELS: dict[str, Callable[[Array, Array, Array], tuple[Array, Array]]] = {
    OURS: by_ours,
    SCIKIT_LEARN: by_scikit_learn,
    BOTORCH: by_botorch,
}


def megabytes(package: str, without: Iterable[str]) -> tuple[float, list[str], list[str]]:
    """What a package and all it requires take, but for what others require anyway.

    Returns:
        Megabytes of their files, compiled Python left out; the packages; and required ones that are not
        installed here.
    """
    wanted = required(package)
    for other in without:
        wanted = {name: found for name, found in wanted.items() if name not in required(other)}
    files = (
        Path(str(file.locate()))
        for found in wanted.values()
        if found is not None
        for file in found.files or ()
        if file.suffix != ".pyc"
    )
    size = sum(path.stat().st_size for path in files if path.is_file())
    here = sorted(name for name, found in wanted.items() if found is not None)
    return size / 1e6, here, sorted(wanted.keys() - here)


def required(package: str) -> Mapping[str, Distribution | None]:
    """A package and all it requires, extras aside, by name; None for what is not installed."""
    found: dict[str, Distribution | None] = {}
    left = [package]
    while left:
        name = re.sub(r"[-_.]+", "-", left.pop()).lower()
        if name in found:
            continue
        try:
            found[name] = distribution(name)
        except PackageNotFoundError:
            found[name] = None
            continue
        asked = map(Requirement, found[name].requires or ())
        left += [one.name for one in asked if one.marker is None or one.marker.evaluate({"extra": ""})]
    return found


def draws() -> Iterator[tuple[str, Array, Array, Array]]:
    """Name, weights and scores of some subsets of the first bank, and weights of others."""
    table = subset_scores()
    masks = np.array(sorted(table.scores))
    for size, count in SIZES.items():
        for seed in range(count):
            drawn = np.random.default_rng([size, seed]).permutation(masks)
            members = [tuple(n for n in range(len(table.names)) if mask >> n & 1) for mask in drawn]
            weights = equal_weights(members, len(table.names))
            scores = np.array([table.scores[int(mask)] for mask in drawn[:size]])
            yield f"{size}-{seed}", weights[:size], scores, weights[size : size + NEW]


def told(model: str) -> Told:
    """What a model finds of every draw, by its name."""
    found: Told = {}
    for name, points, values, new in draws():
        found[f"{name} hyper"], found[f"{name} predicted"] = MODELS[model](points, values, new)
    return found


def in_process(model: str, threads: int) -> Told:
    """The same in a fresh process with so many BLAS threads."""
    names = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")
    paths = [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
    given = dict.fromkeys(names, str(threads)) | {"PYTHONPATH": os.pathsep.join(filter(None, paths))}
    command = [sys.executable, __file__, model]
    done = subprocess.run(command, env={**os.environ, **given}, stdout=subprocess.PIPE, check=True)
    with np.load(io.BytesIO(done.stdout)) as arrays:
        return dict(arrays)


def same(one: Told, other: Told, part: str) -> str:
    """In how many draws a part is the same to the last bit, and how far it is apart at most."""
    pairs = [(value, other[name]) for name, value in one.items() if name.endswith(part)]
    equal = sum(np.array_equal(a, b) for a, b in pairs)
    apart = max(float(np.max(np.abs(a - b) / np.maximum(np.abs(a), 1e-12))) for a, b in pairs)
    return f"{equal} of {len(pairs)}" + (f" (apart by {apart:.0e})" if equal < len(pairs) else "")


def measure() -> tuple[list[tuple[str, ...]], list[str]]:
    """A row a model; and sentences on what it would install."""
    rows, sentences = [], []
    with tempfile.TemporaryDirectory() as folder:
        for model, line in IMPORTS.items():
            size, packages, missing = (0.0, [], []) if model == OURS else megabytes(model.lower(), ["sfkit"])
            if packages:
                lacks = f", not installed here: {', '.join(missing)}" if missing else ""
                sentences.append(f"{model} adds {', '.join(packages)}{lacks}.")
            cpu = seconds([sys.executable, "-c", line], Path(folder))
            first, *others = (in_process(model, threads) for threads in THREADS)
            cells = [same(first, other, part) for other in others for part in ("hyper", "predicted")]
            rows.append((model, f"{size:.0f}", f"{cpu:.1f}", *cells))
    return rows, sentences


def section() -> str:
    """The section.

    Raises:
        SystemExit: scikit-learn or BoTorch is not installed.
    """
    for package in (SCIKIT_LEARN, BOTORCH):
        if required(package.lower())[package.lower()] is None:
            raise SystemExit(f"{package} is not installed: make bench prepares .venv-peers, which has it")
    rows, sentences = measure()
    heads = (
        "model",
        "MB more",
        "CPU s to start",
        "again: hyper-parameters",
        "predictions",
        "2 threads: hyper-parameters",
        "predictions",
    )
    fits = " and ".join(f"{count} draws of {size}" for size, count in SIZES.items())
    return f"""## Models of the score: what a library would add

Megabytes of the packages that would be installed besides ours, and CPU seconds of a process that imports what
Stage 1 by a model needs, and the library, the least of {REPEATS}. Then {fits} subsets of the first bank: a
model learns their scores and foretells {NEW} others', in one process with one BLAS thread, again in another,
and in one with two. In how many draws all is the same to the last bit, and in brackets by how much of the
value it is apart at most. What searches by them need is in the section `optimum`, above.

{" ".join(sentences)}

{numbers(heads, rows)}
"""


if __name__ == "__main__":
    np.savez(sys.stdout.buffer, **told(sys.argv[1]))
