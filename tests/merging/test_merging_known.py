"""Shipped architectures known without torch: the table is the registry's, the answers are the pool's own."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from safetensors.torch import load_file, save_file
from tiny import write_pool

from sfkit import bank
from sfkit.architectures import code, registry
from sfkit.checkpoints.checks import Kind
from sfkit.checkpoints.fingerprints import COUNTER
from sfkit.checkpoints.spec import PoolSpec, read_pool_spec
from sfkit.cli import inspection
from sfkit.errors import SfkitWarning
from sfkit.merging import known, recognition
from sfkit.merging.opening import open_pool
from sfkit.merging.tensor_specs import tensor_specs


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """As in a process that has not imported the registry."""
    monkeypatch.setattr(known, "nobody_registered", lambda: True)


def as_registered() -> str:
    """What ``known.json`` says, of the registry's networks."""
    found = {}
    for name in registry.architectures():
        entry = registry.architecture(name)
        module = entry.build.__module__
        ours, adapter = (module.startswith(known.SHIPPED + room) for room in ("", "adapters."))
        if entry.beside or adapter or not ours:
            continue
        options = entry.resolve()
        specs = [spec for spec in tensor_specs(entry, options) if not spec.key.endswith(COUNTER)]
        shapes = {spec.key: spec.shape for spec in specs}
        constants = [spec.key for spec in specs if spec.kind is Kind.CONSTANT]
        plain = not (entry.rename or entry.check or entry.frozen or constants)
        found[name] = {
            "required": known._digest(
                {k: shape for k, shape in shapes.items() if not known._any(k, entry.optional)}
            ),
            "whole": known._digest(shapes),
            "optional": entry.optional,
            "constants": constants,
            "options": list(options),
            "blocks": entry.blocks(options) if plain else {},
        }
    return json.dumps(found, indent=1) + "\n"


def test_the_table_is_what_the_registry_has() -> None:
    written = known.TABLE.read_text(encoding="utf-8")
    assert as_registered() == written, "write as_registered() to sfkit/merging/known.json"
    assert set(json.loads(written)) == {"anynet", "anynet-slim", "anynet-wide", "nmrf-res", "nmrf-swint"}


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize("name", ["bank", "bank-slim"])
def test_a_pool_is_described_as_the_opened_one_is(name: str) -> None:
    path = bank.pool_path(name)
    found, (opened, doubts) = known.relations(read_pool_spec(path)), inspection._relations(path)
    assert found is not None
    assert doubts == ()
    assert found.blocks == opened.blocks
    assert found.kinships.keys() == opened.kinships.keys()
    for source, kinship in opened.kinships.items():
        assert vars(found.kinships[source]) == pytest.approx(vars(kinship), rel=1e-9), source
    assert sum(found.blocks.values()) == open_pool(path).layout.size


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize("spn", [True, False])
@pytest.mark.parametrize("archive", [True, False])
def test_so_is_a_pool_of_torch_files(tmp_path: Path, *, spn: bool, archive: bool) -> None:
    path = write_pool(tmp_path, sources=2)
    whole = registry.architecture("anynet").build(spn=True).state_dict() if spn else {}
    lines = path.read_text().replace(".safetensors", ".tar").splitlines()
    for file in tmp_path.glob("*.safetensors"):
        state = {f"module.{key}": tensor for key, tensor in (whole | load_file(file)).items()}
        content = {"epoch": 3, "state_dict": state}
        torch.save(content, file.with_suffix(".tar"), _use_new_zipfile_serialization=archive)
    # With options of its own a network may have no optional part.
    path.write_text("\n".join(line for line in lines if not spn or line[:4] not in ("[opt", "rang", "spn ")))
    found, (opened, doubts) = known.relations(read_pool_spec(path)), inspection._relations(path)
    assert found is not None
    assert doubts == ()
    assert found.blocks == opened.blocks
    for source, kinship in opened.kinships.items():
        assert vars(found.kinships[source]) == pytest.approx(vars(kinship), rel=1e-9), source


def test_a_folder_is_the_same_family_with_and_without_the_registry(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = write_pool(tmp_path / "pool").parent
    slow = recognition.family(folder)
    monkeypatch.setattr(known, "nobody_registered", lambda: True)
    fast = recognition.family(folder)
    assert replace(fast, cosines={}, distances={}) == replace(slow, cosines={}, distances={})
    assert fast.cosines == pytest.approx(slow.cosines, rel=1e-9)
    assert fast.distances == pytest.approx(slow.distances, rel=1e-9)


def _first(state: dict[str, torch.Tensor], ending: str) -> torch.Tensor:
    return next(tensor for key, tensor in state.items() if key.endswith(ending))


UNUSUAL: dict[str, Callable[[dict[str, torch.Tensor]], Any]] = {
    "not finite": lambda state: _first(state, "weight").fill_(torch.nan),
    "a variance below 0": lambda state: _first(state, "running_var").fill_(-1),
    "half precision": lambda state: state.update({k: t.bfloat16() for k, t in state.items()}),
    "another key": lambda state: state.update(more=torch.zeros(1)),
    "whole numbers": lambda state: state.update({k: t.int() for k, t in state.items()}),
    "unlike its base": lambda state: [t.neg_() for t in state.values() if t.is_floating_point()],
}


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize("kind", UNUSUAL)
def test_what_is_unusual_is_left_to_the_opener(kind: str, tmp_path: Path) -> None:
    spec = read_pool_spec(write_pool(tmp_path))
    assert known.relations(spec) is not None
    state = load_file(spec.sources[0].path)
    UNUSUAL[kind](state)
    save_file(state, spec.sources[0].path)
    assert known.relations(spec) is None


@pytest.mark.usefixtures("alone")
@pytest.mark.parametrize(
    "change",
    [
        {"options": {"ranges": "wide"}},
        {"options": {"widths": 3}},
        {"partition": "modules"},
        {"blocks": {"all": ("*",)}},
        {"architecture": "anynet-slim"},
        {"architecture": "mine"},
    ],
    ids=str,
)
def test_so_is_a_pool_that_is_described_otherwise(change: dict[str, Any], tmp_path: Path) -> None:
    spec: PoolSpec = read_pool_spec(write_pool(tmp_path))
    assert known.relations(replace(spec, **change)) is None
    twins = (*spec.sources, replace(spec.sources[0], name="twin"))
    assert known.relations(replace(spec, sources=twins)) is None


def test_where_the_registry_is_in_use_it_is_asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shipped = json.loads(known.TABLE.read_text(encoding="utf-8"))
    # Other tests of the same process may have registered networks with the same keys.
    monkeypatch.setattr(registry, "_REGISTRY", {name: registry.architecture(name) for name in shipped})
    spec = read_pool_spec(write_pool(tmp_path))
    assert known.known_file(spec.base.path) is None
    assert recognition.recognised(spec.base.path) == ("anynet",)
    assert np.isfinite(inspection._relations(tmp_path / "pool.toml")[0].kinships["a"].cosine)


PACKAGES = {
    "twin": """import sfkit
from sfkit.architectures import architecture
anynet = architecture("anynet")
sfkit.register_architecture("twin", blocks=anynet.blocks, version="1")(lambda: anynet.build())
""",
    "broken": "raise OSError('libdepth.so: no such file')",
    "hollow": """import sfkit
@sfkit.register_architecture("hollow", blocks={"all": ["*"]})
def build(width=None):
    raise ValueError("say how wide\\nas in the manual")
""",
    "leaving": """import sfkit
@sfkit.register_architecture("leaving", blocks={"all": ["*"]})
def build():
    raise SystemExit("no licence")
""",
}


def _install(site: Path, name: str) -> None:
    """A package that declares its architecture as an entry point."""
    info = site / f"{name}_net-1.0.dist-info"
    info.mkdir(parents=True)
    (site / f"{name}_net.py").write_text(PACKAGES[name])
    (info / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}-net\nVersion: 1.0\n")
    (info / "entry_points.txt").write_text(f"[sfkit.architectures]\n{name} = {name}_net\n")


@pytest.mark.parametrize(
    ("name", "expected", "said"),
    [
        ("twin", ("anynet", "twin"), None),
        (
            "broken",
            ("anynet",),
            r"'broken': its package cannot be imported \(libdepth\.so: no such file; entry",
        ),
        (
            "hollow",
            ("anynet",),
            r"'hollow': cannot be built with .* \(ValueError: say how wide\), so its keys",
        ),
        (
            "leaving",
            ("anynet",),
            r"'leaving': cannot be built with .* \(SystemExit: no licence\), so its keys",
        ),
    ],
)
def test_what_installed_packages_declare_is_asked_too(
    name: str, expected: tuple[str, ...], said: str | None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A file that fits several is all of theirs; one that cannot be asked is named, and hides no other."""
    shipped = json.loads(known.TABLE.read_text(encoding="utf-8"))
    monkeypatch.setattr(registry, "_REGISTRY", {one: registry.architecture(one) for one in shipped})
    base = tmp_path / "base.safetensors"
    save_file(registry.architecture("anynet").build().state_dict(), base)
    with monkeypatch.context() as unused:
        unused.delitem(sys.modules, "sfkit.architectures.registry")
        assert (known.known_file(base) or (None, None))[1] == "anynet"
        _install(tmp_path / "site", name)
        unused.syspath_prepend(tmp_path / "site")
        assert known.known_file(base) is None
        unused.setitem(sys.modules, "sfkit.architectures.registry", registry)
        with pytest.warns(SfkitWarning, match=said) if said else nullcontext():
            assert recognition.recognised(base) == expected


def test_architectures_of_eggs_and_of_places_that_may_not_be_entered_are_left_to_importlib(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert not code._declares([str(tmp_path), str(tmp_path / "nowhere")])
    (tmp_path / "EGG-INFO").mkdir()
    (tmp_path / "EGG-INFO" / "entry_points.txt").write_text("[sfkit.architectures]\nold = old_net\n")
    assert code._declares([str(tmp_path)])
    (tmp_path / "EGG-INFO" / "entry_points.txt").write_text("[console_scripts]\nold = old_net\n")
    assert not code._declares([str(tmp_path)])

    def closed(path: Path) -> bool:
        raise PermissionError(13, "Permission denied", str(path))

    monkeypatch.setattr(Path, "is_file", closed)
    assert code._declares([str(tmp_path)])
