"""``sfkit.load``: arrays, files, lists and videos give what the network gives; and mends on the way there."""

from __future__ import annotations

import functools
from pathlib import Path

import cv2
import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from tiny import OPTIONS, write_pairs, write_pool

import sfkit
from sfkit.architectures import architecture, registry
from sfkit.datasets.videos import frames
from sfkit.errors import InputError
from sfkit.evaluation.prediction import predict

Pair = tuple[NDArray[np.uint8], NDArray[np.uint8]]


@pytest.fixture(scope="module")
def merged(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A merged network of the tiny pool."""
    folder = tmp_path_factory.mktemp("pool")
    pool = sfkit.open_pool(write_pool(folder))
    return sfkit.save_merged(pool, pool.uniform(), folder / "merged.safetensors")


def pair(seed: int = 0, size: tuple[int, int] = (40, 70)) -> Pair:
    """Random images."""
    rng = np.random.default_rng(seed)
    return tuple(rng.integers(0, 256, (*size, 3), dtype=np.uint8) for _ in range(2))  # type: ignore[return-value]


def test_arrays_and_files_give_the_networks_disparity(merged: Path, tmp_path: Path) -> None:
    model = sfkit.load(merged)
    left, right = pair()
    disparity = model(left, right)
    assert disparity.shape == (40, 70)
    assert disparity.dtype == np.float32
    np.testing.assert_array_equal(disparity, predict(sfkit.load_network(merged), left, right))
    for name, image in (("l.png", left), ("r.png", right)):
        cv2.imwrite(str(tmp_path / name), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
    np.testing.assert_array_equal(model(tmp_path / "l.png", str(tmp_path / "r.png")), disparity)


def test_depth_is_focal_times_baseline_by_disparity(merged: Path) -> None:
    disparity = sfkit.load(merged)(*pair())
    disparity[0, :2] = 7.0, -3.0
    depth = disparity.depth(sfkit.Calibration(focal=700.0, baseline=0.5, doffs=3.0))
    assert depth[0, :2].tolist() == [35.0, np.inf]  # 700 * 0.5 / (7 + 3), and nothing in front of the camera
    assert depth.shape == disparity.shape


def test_points_are_the_depths_seen_from_the_principal_point(merged: Path, tmp_path: Path) -> None:
    left, right = pair()
    disparity = sfkit.load(merged)(left, right)
    disparity[:] = np.nan
    disparity[10, 20], disparity[30, 40] = 7.0, 1.0
    cameras = sfkit.Calibration(700.0, 0.5, 3.0, centre=(13.0, 20.0), size=(70, 40))
    cloud = disparity.point_cloud(left, cameras, farthest=50.0)
    np.testing.assert_allclose(cloud.points, [[7 * 35 / 700, -10 * 35 / 700, 35.0]], rtol=1e-6)
    assert cloud.colours.tolist() == [left[10, 20].tolist()]
    with pytest.raises(InputError, match="is of images of 70x40 pixels, found 70x20"):
        disparity[:20].depth(cameras)


def test_lists_go_through_together_whatever_their_sizes(merged: Path) -> None:
    model = sfkit.load(merged)
    pairs = [pair(n, size) for n, size in enumerate([(40, 70)] * 6 + [(33, 50)] + [(40, 70)])]
    together = model([left for left, _ in pairs], [right for _, right in pairs])
    assert [map_.shape for map_ in together] == [left.shape[:2] for left, _ in pairs]
    for (left, right), map_ in zip(pairs, together, strict=True):
        np.testing.assert_allclose(map_, model(left, right), atol=1e-3)


def test_a_stream_takes_each_frame_when_it_is_wanted(merged: Path) -> None:
    model = sfkit.load(merged)
    asked = []

    def camera() -> object:
        for number in range(3):
            asked.append(number)
            yield pair(number)[0]

    stream = model.stream(camera(), (pair(n)[1] for n in range(3)))  # type: ignore[arg-type]
    np.testing.assert_array_equal(next(stream), model(*pair(0)))
    assert asked == [0]
    assert len(list(stream)) == 2


def test_videos(merged: Path, tmp_path: Path) -> None:
    for side, name in enumerate(("l.avi", "r.avi")):
        video = cv2.VideoWriter(str(tmp_path / name), cv2.VideoWriter.fourcc(*"MJPG"), 10, (70, 40))
        for number in range(4 - side):
            video.write(pair(number)[side])
        video.release()
    model = sfkit.load(merged)
    stream = model.stream(tmp_path / "l.avi", tmp_path / "r.avi")
    first = next(stream)
    np.testing.assert_array_equal(
        first, model(next(frames(tmp_path / "l.avi")), next(frames(tmp_path / "r.avi")))
    )
    with pytest.raises(InputError, match=r"r\.avi: ends before .*l\.avi"):
        list(stream)
    images = (pair(n)[0] for n in range(4))
    with pytest.raises(InputError, match="right: ends before the other side"):
        list(model.stream(images, tmp_path / "r.avi"))
    (tmp_path / "no.avi").write_bytes(b"no video")
    with pytest.raises(InputError, match=r"no\.avi: cannot be read as a video"):
        next(frames(tmp_path / "no.avi"))


def test_a_video_of_both_views(merged: Path, tmp_path: Path) -> None:
    both = tmp_path / "both.avi"
    video = cv2.VideoWriter(str(both), cv2.VideoWriter.fourcc(*"MJPG"), 10, (140, 40))
    video.write(np.hstack(pair()))
    video.release()
    model = sfkit.load(merged)
    (found,) = model.stream(both, layout="side-by-side")
    (frame,) = frames(both)
    np.testing.assert_array_equal(found, model(frame[:, :70].copy(), frame[:, 70:].copy()))
    with pytest.raises(InputError, match="expected those of the right camera too"):
        next(model.stream([pair()[0]]))


@pytest.mark.parametrize(
    ("left", "right", "message"),
    [
        (np.zeros((4, 4, 3), np.float32), np.zeros((4, 4, 3), np.uint8), "left: found float32 values"),
        (np.zeros((4, 4, 3), np.uint8), torch.zeros(3, 4, 4), "right: found a Tensor"),
        (np.zeros((4, 4, 3), np.uint8), np.zeros((4, 5, 3), np.uint8), "must both be"),
        ([np.zeros((4, 4, 3), np.uint8)], [], "right: found 0, expected a list of 1"),
        (np.zeros((4, 4), np.uint8), np.zeros((4, 4), np.uint8), r"must both be \(H, W, 3\)"),
    ],
)
def test_what_is_no_pair_is_refused(merged: Path, left: object, right: object, message: str) -> None:
    with pytest.raises(InputError, match=message):
        sfkit.load(merged)(left, right)  # type: ignore[call-overload]


def test_devices(merged: Path) -> None:
    assert "on cpu" in repr(sfkit.load(merged))
    with pytest.raises(InputError, match="expected cpu, cuda, cuda:N or mps"):
        sfkit.load(merged, device="gpu")
    with pytest.raises(InputError, match=r"cuda:99 is not there"):
        sfkit.load(merged, device="cuda:99")


def test_padding_sides_as_text() -> None:
    """Given as text they used to be taken for bottom and right."""
    named = sfkit.InputConvention(multiple=16, sides="centre")  # type: ignore[arg-type]
    assert named == sfkit.InputConvention(multiple=16, sides=sfkit.PadSides.CENTRE)
    assert named.window(30, 30)[0].left == 1
    with pytest.raises(InputError, match=r"unknown padding side 'center'.*did you mean 'centre'"):
        sfkit.InputConvention(sides="center")  # type: ignore[arg-type]
    with pytest.raises(InputError, match="multiple is 0"):
        sfkit.InputConvention(multiple=0)


def test_images_that_may_not_be_written_to() -> None:
    """As Ray's object store holds them."""
    left, right = np.random.default_rng(1).integers(0, 256, (2, 20, 30, 3), dtype=np.uint8)
    expected = sfkit.InputConvention(multiple=16).prepare(left, right)
    for image in (left, right):
        image.flags.writeable = False
    found = sfkit.InputConvention(multiple=16).prepare(left, right)
    assert torch.equal(found.left, expected.left)
    assert torch.equal(found.right, expected.right)


def test_forms_as_text(tmp_path: Path) -> None:
    pool = sfkit.open_pool(write_pool(tmp_path))
    recipe = pool.uniform()
    path = sfkit.save_merged(pool, recipe, tmp_path / "m.safetensors", form="safetensors")
    assert sfkit.read_recipe(path) == recipe
    with pytest.raises(InputError, match="unknown form 'torch', expected one of: original, safetensors"):
        sfkit.save_merged(pool, recipe, tmp_path / "m.pth", form="torch")
    with pytest.raises(InputError, match=r"m\.pth: .*ends in \.safetensors.*form='original'"):
        sfkit.save_merged(pool, recipe, tmp_path / "m.pth")


def test_a_partial_is_a_builder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(registry, "_REGISTRY", dict(registry._REGISTRY))  # no other test shall recognise it
    anynet = architecture("anynet")
    versions = []
    for ranges in ([4, 3, 3], [5, 3, 3]):
        builder = functools.partial(anynet.build, ranges=ranges, spn=False)
        sfkit.register_architecture("partial-net", blocks=anynet.blocks, inputs=anynet.inputs)(builder)
        versions.append(architecture("partial-net").version)
    assert versions[0] != versions[1]
    sfkit.register_architecture("partial-net", blocks=anynet.blocks, inputs=anynet.inputs)(
        functools.partial(anynet.build, **OPTIONS)
    )
    path = write_pool(tmp_path)
    text = path.read_text().replace('"anynet"', '"partial-net"')
    path.write_text(text.replace("[options]\nranges = [4, 3, 3]\nspn = false\n", ""))
    assert sfkit.open_pool(path).names == ("a", "b", "c")


def test_one_recipe_in_place_of_a_list(tmp_path: Path) -> None:
    pool = sfkit.open_pool(write_pool(tmp_path))
    benchmark = sfkit.open_benchmark("pairs", write_pairs(tmp_path / "pairs"))
    with pytest.raises(InputError, match=r"evaluate\(\[recipe\]\)"):
        sfkit.Evaluator(pool, benchmark).evaluate(pool.uniform())  # type: ignore[arg-type]
