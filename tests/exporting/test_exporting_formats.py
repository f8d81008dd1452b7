"""Exported files beside the network they were made from, run by what will run them: no code of sfkit's."""

from __future__ import annotations

import contextlib
import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import onnxruntime
import pytest
import torch
from numpy.typing import NDArray
from tiny import write_pool

import sfkit
from sfkit.architectures import architecture
from sfkit.architectures.nmrf import inference, propagation
from sfkit.architectures.portable import portable
from sfkit.cli import main
from sfkit.datasets.images import read_image
from sfkit.errors import InputError, SfkitError, SfkitWarning
from sfkit.exporting import Form, export, export_network, formats
from sfkit.exporting.deployed import DeployedNetwork, Sizes
from sfkit.exporting.export import rendered_pair
from sfkit.exporting.formats import TRACING
from sfkit.exporting.forms import SEEN, kind_of, untried
from sfkit.files import writing
from sfkit.merging.network import LoadedNetwork

sys.path.insert(0, str(Path(__file__).parents[1] / "architectures"))
from nmrf_fill import fill

SIZE = (45, 70)  # no multiples of 16: padded inside


@pytest.fixture(scope="module")
def merged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A merged tiny AnyNet without its last stage."""
    folder = tmp_path_factory.mktemp("merged")
    pool = sfkit.open_pool(write_pool(folder))
    return sfkit.save_merged(pool, pool.equal("a", "c"), folder / "merged.safetensors")


def image(array: NDArray[np.uint8]) -> torch.Tensor:
    return torch.from_numpy(array.transpose(2, 0, 1)[None].astype(np.float32))


def run(path: Path, form: Form, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> NDArray[np.float32]:
    """The disparity (H, W) of a file, as a program without sfkit finds it."""
    a, b = image(left), image(right)
    if form is Form.ONNX:
        session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
        return np.asarray(session.run(["disparity"], {"left": a.numpy(), "right": b.numpy()})[0][0])
    module: Any = torch.export.load(path).module() if form is Form.TORCH else torch.jit.load(path)  # type: ignore[no-untyped-call]
    with torch.no_grad():
        return np.asarray(module(a, b)[0])


def stated(path: Path, form: Form) -> dict[str, Any]:
    """The metadata of a file, each entry decoded."""
    if form is Form.ONNX:
        entries = {entry.key: entry.value for entry in onnx.load(path).metadata_props}
        return {key: json.loads(value) for key, value in entries.items() if key.startswith("sfkit.")}
    extra = {"sfkit.json": ""}
    if form is Form.TORCH:
        torch.export.load(path, extra_files=extra)
    else:
        torch.jit.load(path, _extra_files=extra)  # type: ignore[no-untyped-call]
    return {key: json.loads(value) for key, value in json.loads(extra["sfkit.json"]).items()}


@pytest.mark.filterwarnings("ignore::DeprecationWarning", "ignore::FutureWarning", "ignore::UserWarning")
@pytest.mark.parametrize("form", [Form.ONNX, Form.TORCH, Form.TORCHSCRIPT])
def test_a_file_of_a_fixed_size_pads_normalises_and_tells_its_origin(
    merged: Path, tmp_path: Path, form: Form
) -> None:
    out = tmp_path / {"onnx": "net.onnx", "torch": "net.pt2", "torchscript": "net.pt"}[form]
    lines: list[str] = []
    exported = export_network(merged, out, form=form, size=SIZE, progress=lines.append)
    assert exported.agrees
    assert lines[:2] == ["running the network on a pair of 45x70", TRACING]
    assert lines[-1] == "running the file beside the network"
    assert exported.size == exported.pair == SIZE
    rng = np.random.default_rng(3)
    left, right = rng.integers(0, 256, (2, *SIZE, 3), dtype=np.uint8)
    expected = sfkit.load(merged)(left, right)
    found = run(out, form, left, right)
    assert found.shape == SIZE
    assert np.percentile(np.abs(found - expected), 99) < 1e-3

    told = stated(out, form)
    origin = sfkit.read_origin(merged)
    assert origin is not None
    assert told["sfkit.recipe"] == origin.recipe.as_dict()
    assert {name: m["licence"] for name, m in told["sfkit.sources"].items()} == {
        "a": "licence of a",
        "c": "licence of c",
    }
    assert told["sfkit.base"]["fingerprint"] == origin.base["fingerprint"]
    assert told["sfkit.export"]["checked"]["largest"] == exported.largest
    assert told["sfkit.export"]["size"] == list(SIZE)
    assert len(told["sfkit.network"]["fingerprint"]) == 64


def test_the_plain_checkpoint_loads_where_the_base_did(merged: Path, tmp_path: Path) -> None:
    exported = export_network(merged, tmp_path / "net.pth", form="pth", size=SIZE)
    assert exported.largest == 0.0
    state = torch.load(exported.path, weights_only=True)
    architecture("anynet").build(ranges=[4, 3, 3], spn=False).load_state_dict(state)
    assert sfkit.read_origin(exported.path) == sfkit.read_origin(merged)


@pytest.mark.parametrize("width", [16, 48])
def test_the_plain_scan_is_the_fast_one(width: int) -> None:
    network = architecture("anynet").build(ranges=[4, 3, 3]).eval()
    images = torch.randn(2, 1, 3, 32, width, generator=torch.Generator().manual_seed(1))
    with torch.no_grad():
        expected = network(*images)
        with portable():
            torch.testing.assert_close(network(*images), expected, atol=1e-4, rtol=1e-5)


@pytest.mark.parametrize("name", ["nmrf-res", "nmrf-swint"])
def test_plain_operations_of_nmrf_give_what_the_fast_ones_give(name: str) -> None:
    network = architecture(name).build().eval()
    fill(network, "A")
    images = torch.rand(2, 1, 3, 64, 96, generator=torch.Generator().manual_seed(1)) * 255
    with torch.no_grad():
        expected = network(*images)
        with portable():
            torch.testing.assert_close(network(*images), expected, atol=1e-4, rtol=1e-5)


def test_a_dynamic_file_is_fed_padded_images_and_cropped() -> None:
    entry = architecture("anynet")
    inputs, sizes = entry.inputs(entry.resolve()), Sizes(None, 16)
    network = entry.build(ranges=[4, 3, 3], spn=False).eval()
    left, right = rendered_pair((40, 70))
    fed = sizes.fed(left, right, inputs)
    assert fed.left.shape == (1, 3, 48, 80)
    prepared = inputs.prepare(left, right)
    with torch.no_grad():
        found = fed.window.crop(DeployedNetwork(network, inputs, sizes)(fed.left, fed.right))[0].numpy()
        expected = prepared.window.crop(network(prepared.left, prepared.right))[0].numpy()
    np.testing.assert_allclose(found, expected, atol=1e-4)


@pytest.mark.slow
def test_onnx_of_merged_anynets_on_a_real_pair(real_data: Path, tmp_path: Path) -> None:
    pool = sfkit.open_pool(Path(__file__).parents[1] / "pools" / "anynet_real.toml")
    merged = sfkit.save_merged(pool, pool.uniform(), tmp_path / "merged.safetensors")
    left, right = (
        read_image(real_data / "pairs/motorcycle" / f"motorcycle_{side}.png") for side in ("left", "right")
    )
    exported = export_network(merged, tmp_path / "net.onnx", pair=(left, right))
    assert exported.percentile99 < 1e-3
    found = run(exported.path, Form.ONNX, left, right)
    difference = np.abs(found - sfkit.load(merged)(left, right))
    assert np.percentile(difference, 99) < 1e-3
    assert difference.max() == exported.largest


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:.*never run to its end")  # of all its layers
def test_onnx_of_merged_nmrfs_on_a_real_pair(
    real_data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """With four layers, one of them shifted: an exporter takes minutes for all fifteen."""
    monkeypatch.setattr(inference, "INFERENCE_LAYERS", 2)
    monkeypatch.setattr(inference, "REFINEMENT_LAYERS", 1)
    monkeypatch.setattr(propagation, "LAYERS", 1)
    network = architecture("nmrf-res").build()
    fill(network, "A")
    base = {key: tensor.clone() for key, tensor in network.state_dict().items()}
    torch.save(base, tmp_path / "base.pth")
    for number, name in enumerate("ab"):
        generator = torch.Generator().manual_seed(number)
        moved = {
            key: tensor * (1 + 0.01 * torch.randn(tensor.shape, generator=generator))
            if tensor.is_floating_point() and tensor.numel()
            else tensor
            for key, tensor in base.items()
        }
        torch.save(moved, tmp_path / f"{name}.pth")
    text = 'name = "nmrf"\narchitecture = "nmrf-res"\n[base]\nfile = "base.pth"\n'
    (tmp_path / "pool.toml").write_text(text + '[sources.a]\nfile = "a.pth"\n[sources.b]\nfile = "b.pth"\n')
    pool = sfkit.open_pool(tmp_path / "pool.toml")
    merged = sfkit.save_merged(pool, pool.uniform(), tmp_path / "merged.safetensors")
    left, right = (read_image(real_data / "pairs/cones" / name)[100:164, 60:188] for name in IMAGES)
    exported = export_network(merged, tmp_path / "net.onnx", pair=(left, right))
    found = run(exported.path, Form.ONNX, left, right)
    assert np.percentile(np.abs(found - sfkit.load(merged)(left, right)), 99) < 1e-3


IMAGES = ("im2.png", "im6.png")


@sfkit.register_architecture("export-complex", blocks={"all": ["*"]})
class Complex(torch.nn.Module):
    """A network that looks at its values in Python, which no exporter can follow."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = torch.nn.Parameter(torch.ones(3))

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        difference = (left - right).abs().mean(1) * self.weight.sum()
        return difference if float(difference.mean()) > 0 else difference + 1


def test_a_network_that_does_not_export_is_named_in_one_sentence(tmp_path: Path) -> None:
    torch.save({"weight": torch.ones(3)}, tmp_path / "net.pth")
    with pytest.raises(SfkitError, match=r"torch\.export: this network does not export"):
        export_network(
            tmp_path / "net.pth",
            tmp_path / "out.pt2",
            form="torch",
            size=(32, 32),
            architecture="export-complex",
        )
    assert not (tmp_path / "out.pt2").exists()


class Difference(torch.nn.Module):
    """The smallest network there is."""

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        return (left - right).abs().mean(1)


def test_a_file_that_holds_on_to_another_size_is_told_in_one_sentence() -> None:
    """As some do that were to take any."""
    inputs, made_for, asked = sfkit.InputConvention(multiple=1), Sizes((32, 32), 1), Sizes((32, 48), 1)
    example = made_for.fed(*rendered_pair((32, 32)), inputs)
    network = DeployedNetwork(Difference(), inputs, made_for)
    made = formats.torch_export(network, made_for, example.left, example.right, lambda _line: None)
    assert export._run(made, example, "net").shape == (1, 32, 32)
    with pytest.raises(SfkitError, match=r"the exported net does not run on images of 32x48 \("):
        export._run(made, asked.fed(*rendered_pair((32, 48)), inputs), "net")


@pytest.mark.parametrize("reason", [None, "its windows"])
def test_what_was_never_run_and_what_cannot_be_is_said_before_it_starts(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, reason: str | None
) -> None:
    def stop(*_: object) -> None:
        raise SfkitError("it has started")

    network = architecture("nmrf-res").build()
    fill(network, "A")
    torch.save(network.state_dict(), tmp_path / "net.pth")
    monkeypatch.setattr(export, "predict", stop)
    monkeypatch.setitem(SEEN, "nmrf-res", {} if reason is None else {(Form.TORCH, True): reason})
    said = (
        pytest.warns(SfkitWarning, match="export to torch with --dynamic was never run to its end with nmrf")
        if reason is None
        else contextlib.nullcontext()
    )
    sentence = (
        "it has started"
        if reason is None
        else "nmrf-res does not export to torch with --dynamic: its windows"
    )
    with said, pytest.raises(SfkitError, match=sentence):
        export_network(
            tmp_path / "net.pth",
            tmp_path / "net.pt2",
            form="torch",
            dynamic=True,
            pair=rendered_pair((64, 64)),
            architecture="nmrf-res",
        )


def test_what_was_measured_needs_no_warning() -> None:
    for kind, seen in SEEN.items():
        assert all(untried(kind, form, dynamic=dynamic) is None for form, dynamic in seen)
        assert untried(kind, Form.PTH, dynamic=True) is None
    assert untried("anynet", Form.ONNX, dynamic=True) is None


def test_the_size_of_a_network_counts_as_its_kind() -> None:
    """What holds for the smallest FoundationStereo was not seen with the largest."""
    sizes = {
        size: LoadedNetwork(
            torch.nn.Identity(), sfkit.InputConvention(), "foundation-stereo", {"vit_size": size}
        )
        for size in ("vits", "vitb", "vitl")
    }
    assert {kind_of(network) for network in sizes.values()} < SEEN.keys()
    assert kind_of(LoadedNetwork(torch.nn.Identity(), sfkit.InputConvention(), "anynet")) == "anynet"


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ("-f trt", "unknown format 'trt'"),
        ("-f onnx -o net.pth", "ends in .onnx"),
        ("--size 45", "expected HEIGHTxWIDTH"),
        ("--size 32x32 --dynamic", "expected one of the two"),
        ("-f torchscript --dynamic", "a trace holds one size"),
        ("--left a.png", "expected both images of a pair"),
        ("--size 8x32", "at least 16 pixels"),
    ],
)
def test_what_cannot_be_is_refused(
    merged: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    arguments: str,
    sentence: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    named = ["-o", "net.pt" if "torchscript" in arguments else "net.onnx"] if "-o " not in arguments else []
    with pytest.raises(SystemExit) as ended:
        main(["export", str(merged), *named, *arguments.split()])
    assert ended.value.code == 2
    assert sentence in capsys.readouterr().err
    assert not list(tmp_path.iterdir())


def test_an_existing_file_stays(merged: Path, tmp_path: Path) -> None:
    with writing(tmp_path / "net.onnx") as fresh:
        fresh.write_bytes(b"mine")
    with pytest.raises(InputError, match="--force"):
        export_network(merged, tmp_path / "net.onnx")
    assert (tmp_path / "net.onnx").read_bytes() == b"mine"
