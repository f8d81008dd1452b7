from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest
from flat_world import flat_pool

import sfkit
from sfkit.datasets import check_data
from sfkit.errors import InputError, SfkitWarning
from sfkit.evaluation import Evaluator

SIZE = (48, 120)
SHIFT = 6


def write(path: Path, image: np.ndarray) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    assert cv2.imwrite(str(path), image)
    return path


def views(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Noise of blobs seen from two places."""
    rng = np.random.default_rng(seed)
    image = rng.integers(0, 256, (SIZE[0] // 2, (SIZE[1] + 2 * SHIFT) // 2, 3), dtype=np.uint8)
    whole = cv2.resize(image, None, fx=2, fy=2, interpolation=cv2.INTER_LINEAR)
    return whole[:, : SIZE[1]], whole[:, SHIFT : SIZE[1] + SHIFT]


def video(root: Path, frames: int = 6, left: str = "left", right: str = "right") -> Path:
    for n in range(frames):
        a, b = views(n)
        write(root / left / f"{n:03d}.png", a)
        write(root / right / f"{n:03d}.png", b)
    return root


@pytest.mark.parametrize(
    ("left", "right", "first"),
    [
        ("left", "right", "000"),
        ("2011_09_26/drive_0001_sync/image_02/data", "2011_09_26/drive_0001_sync/image_03/data",
         "2011_09_26/drive_0001_sync/000"),
        ("training/image_2", "training/image_3", "training/000"),
        ("training/image_0", "training/image_1", "training/000"),
    ],
)  # fmt: skip
def test_folders_of_frames(tmp_path: Path, left: str, right: str, first: str) -> None:
    found = sfkit.open_benchmark("unlabelled", video(tmp_path, left=left, right=right))
    assert (len(found), found.ids[0], found.metric) == (6, first, "census")
    assert len(sfkit.open_benchmark("unlabelled", tmp_path, every=4)) == 2
    assert sfkit.open_benchmark("unlabelled", tmp_path, every=4).ids[1].endswith("004")


def test_kitti_raw_takes_the_colour_cameras(tmp_path: Path) -> None:
    drive = "2011_09_26/drive_0001_sync"
    video(tmp_path, left=f"{drive}/image_00/data", right=f"{drive}/image_01/data")
    video(tmp_path, left=f"{drive}/image_02/data", right=f"{drive}/image_03/data")
    found = sfkit.open_benchmark("unlabelled", tmp_path)
    assert len(found) == 6
    assert all("image_02" in str(pair.left) for pair in found.pairs)


def test_one_folder_a_pair_and_tables(tmp_path: Path) -> None:
    a, b = views()
    for folder, names in {
        "Adirondack": ("im0", "im1"),
        "Art": ("view1", "view5"),
        "own": ("left", "right"),
    }.items():
        for name, image in zip(names, (a, b), strict=True):
            write(tmp_path / folder / f"{name}.png", image)
    for side, image in (("left", a), ("right", b)):
        write(tmp_path / f"desk_{side}.png", image)
    assert sfkit.open_benchmark("unlabelled", tmp_path).ids == ("Adirondack", "Art", "desk", "own")
    table = tmp_path / "pairs.csv"
    table.write_text("left,right,id\nArt/view1.png,Art/view5.png,art\nown/left.png,own/right.png,\n")
    assert sfkit.open_benchmark("unlabelled", table).ids == ("art", "own/left")


def test_a_network_is_scored_without_labels(tmp_path: Path) -> None:
    pool = flat_pool(tmp_path / "pool")  # its members predict 4 and 12 px everywhere; the truth here is 6
    benchmark = sfkit.open_benchmark("unlabelled", video(tmp_path / "video"))
    store = sfkit.EvaluationStore(tmp_path / "store.sqlite")
    near, far = (
        o.score for o in Evaluator(pool, benchmark, store=store)([pool.equal("low"), pool.equal("high")])
    )
    assert 0 < near < far
    again = Evaluator(pool, benchmark, store=store)([pool.equal("low")])[0]
    assert (again.cached, again.score) == (True, near)


def test_bad_pixels_of_unlabelled_pairs_are_refused(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"metric bad-1\.0, which compares with ground truth.*use census"):
        sfkit.open_benchmark("unlabelled", video(tmp_path / "video"), metric="bad-1.0")
    benchmark = sfkit.open_benchmark("unlabelled", tmp_path / "video")
    with pytest.raises(InputError, match="000: has no ground truth"):
        Evaluator(flat_pool(tmp_path / "pool"), benchmark, metric="epe")
    with pytest.raises(InputError, match="or the metric census, which needs none"):
        benchmark.measured_by(metric="bad-2.0").ensure_scorable()


def test_folders_that_do_not_match(tmp_path: Path) -> None:
    video(tmp_path / "dropped")
    (tmp_path / "dropped/right/002.png").unlink()
    with pytest.raises(InputError, match=r"002\.png: found no image of that name on the other side \(1 such"):
        sfkit.open_benchmark("unlabelled", tmp_path / "dropped")
    a, b = views()
    write(tmp_path / "stamped/left/l1.png", a)
    write(tmp_path / "stamped/left/l2.png", a)
    write(tmp_path / "stamped/right/r1.png", b)
    with pytest.raises(InputError, match=r"found 2 and 1 images without a name in common.*dropped"):
        sfkit.open_benchmark("unlabelled", tmp_path / "stamped")
    write(tmp_path / "alone/left/1.png", a)
    with pytest.raises(InputError, match="found no folder right beside it"):
        sfkit.open_benchmark("unlabelled", tmp_path / "alone")
    write(tmp_path / "one/im0.png", a)
    with pytest.raises(InputError, match="found no im1 beside it"):
        sfkit.open_benchmark("unlabelled", tmp_path / "one")
    write(tmp_path / "photo/holiday.png", a)
    with pytest.raises(InputError, match="found no stereo pair, expected folders left and right"):
        sfkit.open_benchmark("unlabelled", tmp_path / "photo")
    with pytest.raises(InputError, match="every: found 0, expected a whole number of at least 1"):
        sfkit.open_benchmark("unlabelled", tmp_path / "photo", every=0)


def test_images_that_tell_nothing(tmp_path: Path) -> None:
    pool, (a, b) = flat_pool(tmp_path / "pool"), views()
    cases = {
        "same": (a, a, "left and right are the same image"),
        "black": (np.zeros_like(a), np.zeros_like(a), "the left image is one flat colour"),
        "lens-cap": (a, np.zeros_like(a), "the right image is one flat colour"),
        "sizes": (a, b[:, :-2], "found 118x48 pixels, expected 120x48"),
    }
    for name, (left, right, message) in cases.items():
        write(tmp_path / name / "left/1.png", left)
        write(tmp_path / name / "right/1.png", right)
        with pytest.raises(InputError, match=message):
            Evaluator(pool, sfkit.open_benchmark("unlabelled", tmp_path / name))
        assert any(message in text for text in check_data("unlabelled", tmp_path / name).problems)


def test_exchanged_images_are_found(tmp_path: Path) -> None:
    video(tmp_path / "right-way")
    video(tmp_path / "wrong", left="right", right="left")
    assert check_data("unlabelled", tmp_path / "right-way").warnings == ()
    assert len(check_data("unlabelled", tmp_path / "wrong").warnings) == 6
    with pytest.warns(SfkitWarning, match="looks wrong .*left and right look exchanged"):
        Evaluator(flat_pool(tmp_path / "pool"), sfkit.open_benchmark("unlabelled", tmp_path / "wrong"))


def test_real_pairs_are_told_from_exchanged_ones(real_data: Path, tmp_path: Path) -> None:
    pairs = [("pairs/cones/im2.png", "pairs/cones/im6.png")]
    pairs += [("pairs/reindeer/view1.png", "pairs/reindeer/view5.png")]
    pairs += [("kitti2012/training/image_0/000000_10.png", "kitti2012/training/image_1/000000_10.png")]
    frames = "sources/VirtualKITTI2/Scene01/15-deg-left/frames/rgb/Camera_"
    pairs += [(f"{frames}0/rgb_00000.jpg", f"{frames}1/rgb_00000.jpg")]
    for exchanged in (False, True):
        table = tmp_path / "pairs.csv"
        rows = [",".join(pair[::-1] if exchanged else pair) for pair in pairs]
        table.write_text("\n".join(["left,right", *rows]))
        report = check_data("unlabelled", real_data, table=table)
        assert len(report.warnings) == (len(pairs) if exchanged else 0)
