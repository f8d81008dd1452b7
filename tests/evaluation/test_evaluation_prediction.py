"""Prediction: files read back as what the network said, depth by its formula, an honest preview."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from tiny import write_pool
from torch import nn

from sfkit.architectures import InputConvention, PadSides
from sfkit.cli import main
from sfkit.colours import hatch
from sfkit.datasets.calibration import Calibration
from sfkit.datasets.formats import read_disparity
from sfkit.datasets.matching import match_pairs
from sfkit.datasets.pfm import read_pfm, write_pfm
from sfkit.errors import InputError, SfkitError, SfkitWarning
from sfkit.evaluation.point_cloud import depth_of
from sfkit.evaluation.prediction import predict, preview_of
from sfkit.evaluation.prediction_files import Outputs, PredictionPlan, predict_files
from sfkit.merging import Recipe, open_pool
from sfkit.merging.network import LoadedNetwork
from sfkit.merging.saving import save_merged

SIZE = (20, 30)


class Given(nn.Module):
    """Says what it was given, whatever it sees."""

    def __init__(self, disparity: NDArray[np.float32]) -> None:
        super().__init__()
        self.disparity = torch.from_numpy(disparity)

    def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
        return self.disparity[None]


def given(disparity: NDArray[np.float32]) -> LoadedNetwork:
    return LoadedNetwork(Given(disparity), InputConvention(), "given")


def disparities() -> NDArray[np.float32]:
    return np.random.default_rng(3).uniform(0.1, 250, SIZE).astype(np.float32)


def image(path: Path, size: tuple[int, int] = SIZE, seed: int = 0) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    cv2.imwrite(str(path), np.random.default_rng(seed).integers(0, 256, (*size, 3), dtype=np.uint8))
    return path


@pytest.fixture
def pair(tmp_path: Path) -> tuple[Path, Path]:
    return image(tmp_path / "left.png"), image(tmp_path / "right.png", seed=1)


def test_a_pfm_holds_every_bit(pair: tuple[Path, Path], tmp_path: Path) -> None:
    said = disparities()
    (written,) = predict_files(given(said), PredictionPlan.of([pair], tmp_path / "out"))
    assert written.disparity == tmp_path / "out" / "left.pfm"
    assert np.array_equal(read_pfm(written.disparity), said)
    assert written.median == pytest.approx(float(np.median(said)))
    assert (written.nonfinite, written.depth) == (0, None)


def test_a_16_bit_png_holds_256ths_of_a_pixel(pair: tuple[Path, Path], tmp_path: Path) -> None:
    said = disparities()
    said[0, :4] = [np.nan, np.inf, 0.0, -3.0]
    plan = PredictionPlan.of([pair], tmp_path / "out", Outputs("png16"))
    (written,) = predict_files(given(said), plan)
    stored = cv2.imread(str(written.disparity), cv2.IMREAD_UNCHANGED)
    assert stored.dtype == np.uint16
    assert stored[0, :4].tolist() == [0, 0, 0, 0], "unknown"
    assert np.array_equal(stored[1:], np.rint(said[1:].astype(np.float64) * 256))
    back = read_disparity(written.disparity, "png16")
    assert np.nanmax(np.abs(back[1:] - said[1:])) <= 0.5 / 256 + 1e-6
    assert written.nonfinite == 2


def test_depth_follows_the_cameras(pair: tuple[Path, Path], tmp_path: Path) -> None:
    """Depth = f B / (d + doffs): 700 px, 0.5 m and 40 - 5 px make 10 m."""
    cameras = Calibration(focal=700.0, baseline=0.5, doffs=-5.0)
    said = disparities() + 10
    said[0, :4] = [40.0, 5.0, 2.0, np.nan]
    depth = depth_of(said, cameras)
    assert depth[0].tolist()[:4] == [10.0, np.inf, np.inf, np.inf]
    plan = PredictionPlan.of([pair], tmp_path / "out", Outputs(calibration=cameras))
    (written,) = predict_files(given(said), plan)
    assert written.depth == tmp_path / "out" / "left_depth.pfm"
    stored = read_pfm(written.depth)
    assert np.array_equal(stored, depth)
    assert np.allclose(stored[1:], 350.0 / (said[1:] - 5.0), rtol=1e-6)


def test_the_preview_is_grey_where_nothing_is_known() -> None:
    said = np.linspace(1, 100, 600, dtype=np.float32).reshape(SIZE)
    said[3, 4], said[5, 6], said[7, 8] = np.nan, np.inf, -np.inf
    preview = preview_of(said)
    assert (preview.shape, preview.dtype) == ((*SIZE, 3), np.uint8)
    grey = (preview == hatch(*SIZE)).all(axis=2)
    assert np.array_equal(grey, ~np.isfinite(said))
    ends = cv2.applyColorMap(np.array([[0, 255]], np.uint8), cv2.COLORMAP_VIRIDIS)[0, :, ::-1]
    assert preview[0, 0].tolist() == ends[0].tolist(), "near 1 px"
    assert preview[-1, -1].tolist() == ends[1].tolist(), "near 100 px"


@pytest.mark.parametrize("level", [np.nan, 7.0])
def test_a_map_without_contrast_has_a_preview(level: float) -> None:
    preview = preview_of(np.full(SIZE, level, np.float32))
    assert len(np.unique(preview.reshape(-1, 3), axis=0)) == (2 if np.isnan(level) else 1)
    assert ((preview == hatch(*SIZE)).all()) == np.isnan(level)


def test_a_prediction_is_cropped_to_its_image(pair: tuple[Path, Path]) -> None:
    class Columns(nn.Module):
        def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
            rows, columns = torch.meshgrid(*(torch.arange(n) for n in left.shape[-2:]), indexing="ij")
            return (1000.0 * rows + columns)[None, None]

    for sides, first in (
        (PadSides.BOTTOM_RIGHT, 0.0),
        (PadSides.TOP_RIGHT, 12000.0),
        (PadSides.CENTRE, 6001.0),
    ):
        model = LoadedNetwork(Columns(), InputConvention(multiple=32, sides=sides), "columns")
        black = np.zeros((*SIZE, 3), np.uint8)
        map_ = predict(model, black, black)
        assert map_.shape == SIZE
        assert map_[0, 0] == first, sides
        assert map_[-1, -1] == first + 1000 * 19 + 29


def test_folders_are_matched_by_name(tmp_path: Path) -> None:
    lefts = [image(tmp_path / "left" / f"{name}.png") for name in ("b", "a", "c")]
    for name in ("c", "b", "a"):
        image(tmp_path / "right" / f"{name}.png")
    (tmp_path / "left" / "notes.txt").write_text("not an image")
    pairs = match_pairs(tmp_path / "left", tmp_path / "right")
    assert [left.name for left, _ in pairs] == ["a.png", "b.png", "c.png"]
    assert all(left.name == right.name for left, right in pairs)
    assert {left for left, _ in pairs} == set(lefts)


def test_folders_without_a_common_name_are_matched_by_order(tmp_path: Path) -> None:
    for number in (1, 2):
        image(tmp_path / "left" / f"{number}_left.png")
        image(tmp_path / "right" / f"{number}_right.png")
    pairs = match_pairs(tmp_path / "left", tmp_path / "right")
    assert [(a.name, b.name) for a, b in pairs] == [
        ("1_left.png", "1_right.png"),
        ("2_left.png", "2_right.png"),
    ]


def test_folders_that_fit_in_part_are_not_guessed_at(tmp_path: Path) -> None:
    """By order, b would be paired with c."""
    for folder, names in (("left", "ab"), ("right", "bc")):
        for name in names:
            image(tmp_path / folder / f"{name}.png")
    with pytest.raises(InputError, match=r"left/a.png: found no image of that name in .*right, expected all"):
        match_pairs(tmp_path / "left", tmp_path / "right")


def test_two_images_never_share_a_file(tmp_path: Path) -> None:
    pairs = [(image(tmp_path / f"a.{kind}"), image(tmp_path / f"r.{kind}")) for kind in ("png", "jpg")]
    with pytest.raises(InputError, match=r"a.jpg and .*a.png: would both be written to .*a.pfm, rename one"):
        PredictionPlan.of(pairs, tmp_path / "out")
    one = (image(tmp_path / "b.png"), image(tmp_path / "r.png"))
    other = (image(tmp_path / "b_colour.jpg"), image(tmp_path / "r.png"))
    with pytest.raises(InputError, match=r"would both be written to .*b_colour.png"):
        PredictionPlan.of([one, other], tmp_path / "out", Outputs("png16"))


def test_overwriting_is_asked_for_and_never_reaches_an_image(pair: tuple[Path, Path], tmp_path: Path) -> None:
    said = disparities()
    list(predict_files(given(said), PredictionPlan.of([pair], tmp_path)))
    with pytest.raises(InputError, match=r"left.pfm: the file exists"):
        PredictionPlan.of([pair], tmp_path)
    list(predict_files(given(said + 1), PredictionPlan.of([pair], tmp_path, overwrite=True)))
    assert np.array_equal(read_pfm(tmp_path / "left.pfm"), said + 1)
    with pytest.raises(InputError, match=r"left.png: is one of the images"):
        PredictionPlan.of([pair], tmp_path, Outputs("png16"), overwrite=True)


def test_a_result_that_is_a_link_in_a_circle_is_replaced(pair: tuple[Path, Path], tmp_path: Path) -> None:
    """It leads to none of the images, which it used to be asked by following it."""
    (tmp_path / "left.pfm").symlink_to("left.pfm")
    list(predict_files(given(disparities()), PredictionPlan.of([pair], tmp_path, overwrite=True)))
    assert np.array_equal(read_pfm(tmp_path / "left.pfm"), disparities())


def test_files_of_an_earlier_prediction_are_named(pair: tuple[Path, Path], tmp_path: Path) -> None:
    """Depth of other cameras beside the new disparity, say."""
    out, said = tmp_path / "out", disparities()
    list(
        predict_files(given(said), PredictionPlan.of([pair], out, Outputs(calibration=Calibration(9.0, 1.0))))
    )
    with pytest.warns(SfkitWarning, match=r"out/left_depth\.pfm: of an earlier prediction"):
        list(predict_files(given(said), PredictionPlan.of([pair], out, overwrite=True)))


def test_a_disparity_of_ones_own_beside_the_image_is_of_no_earlier_prediction(tmp_path: Path) -> None:
    """Ground truth that is called as its image, where a prediction goes to the folder of both."""
    pairs = [(image(tmp_path / "left.jpg"), image(tmp_path / "right.jpg"))]
    write_pfm(tmp_path / "left.pfm", disparities())
    plan = PredictionPlan.of(pairs, tmp_path, Outputs("png16"))
    assert plan.others == ()
    list(predict_files(given(disparities()), plan))
    again = PredictionPlan.of(pairs, tmp_path, Outputs("png16"), overwrite=True)
    assert again.others == (tmp_path / "left.pfm",), "with a prediction there, whose it is cannot be told"


def test_images_of_unequal_sizes_are_of_several_cameras(tmp_path: Path) -> None:
    """KITTI's drives: one focal length for all would give depth that is wrong for most, without a word."""
    sizes = {"a": (20, 30), "b": (20, 32)}
    pairs = [
        (image(tmp_path / f"{n}.png", size), image(tmp_path / f"{n}r.png", size)) for n, size in sizes.items()
    ]
    cameras = Outputs(calibration=Calibration(100.0, 0.5))
    with pytest.raises(
        InputError, match=r"b\.png: has 32x20 pixels and .*a\.png 30x20, expected images of one"
    ):
        PredictionPlan.of(pairs, tmp_path / "out", cameras)
    PredictionPlan.of(pairs, tmp_path / "out")
    PredictionPlan.of(pairs[1:], tmp_path / "out", cameras)


def test_every_image_is_read_before_the_first_is_predicted(pair: tuple[Path, Path], tmp_path: Path) -> None:
    late = (image(tmp_path / "late.png"), image(tmp_path / "late_right.png", (20, 31)))
    with pytest.raises(
        InputError, match=r"late_right.png: has 31x20 pixels, expected 30x20 as in .*late.png"
    ):
        PredictionPlan.of([pair, late], tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_a_network_that_raises_is_named_with_its_pair(pair: tuple[Path, Path], tmp_path: Path) -> None:
    class Broken(nn.Module):
        def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
            raise RuntimeError("sizes do not fit\nmore of this")

    model = LoadedNetwork(Broken(), InputConvention(), "broken")
    with pytest.raises(SfkitError, match=r"left.png: the network failed \(RuntimeError: sizes do not fit\)$"):
        list(predict_files(model, PredictionPlan.of([pair], tmp_path / "out")))


def test_a_merged_file_predicts_what_its_pool_does(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """From the pool's file to the disparity on disk, for images that are no multiple of 16."""
    monkeypatch.chdir(tmp_path)
    pool = open_pool(write_pool(tmp_path / "pool"))
    recipe = Recipe.weighted({"a": 0.25, "c": 0.75}, pool.blocks, scale=1.25)
    save_merged(pool, recipe, tmp_path / "merged.safetensors")
    for seed, name in enumerate(("one", "two")):
        image(tmp_path / "l" / f"{name}.png", (41, 99), seed)
        image(tmp_path / "r" / f"{name}.png", (41, 99), seed + 5)
    (tmp_path / "calib.txt").write_text("cam0=[100 0 48; 0 100 20; 0 0 1]\nbaseline=500\ndoffs=1.5\n")
    with pytest.raises(SystemExit, match=r"^0$"):
        main(["predict", "merged.safetensors", "-l", "l", "-r", "r", "-o", "out", "--calib", "calib.txt"])
    out, errors = capsys.readouterr()
    cameras, *lines = errors.splitlines()
    assert (
        cameras
        == "cameras: focal length 100.00 px, baseline 0.5000 m, centre (48.00, 20.00), offset 1.500 px"
    )
    assert [line.partition(" ->")[0] for line in lines] == [
        f"{n} of 2: {name}.png and {name}.png" for n, name in enumerate(("one", "two"), 1)
    ]
    assert out.startswith("out/one.pfm: median ")

    live = pool.merge(recipe)
    inputs = pool.architecture.inputs(pool.options)
    for name in ("one", "two"):
        left, right = (cv2.imread(str(tmp_path / s / f"{name}.png"))[:, :, ::-1].copy() for s in "lr")
        prepared = inputs.prepare(left, right)
        expected = prepared.window.crop(live.disparity(prepared.left, prepared.right)).numpy()
        stored = read_pfm(tmp_path / "out" / f"{name}.pfm")
        assert stored.shape == (41, 99)
        assert np.allclose(stored, expected, atol=1e-3)
        depth = read_pfm(tmp_path / "out" / f"{name}_depth.pfm")
        seen = stored > -1.5
        assert np.allclose(depth[seen], 100 * 0.5 / (stored[seen] + 1.5), rtol=1e-5)
        assert np.isinf(depth[~seen]).all()
        assert cv2.imread(str(tmp_path / "out" / f"{name}_colour.png")).shape == (41, 99, 3)
