from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from sfkit.datasets import open_benchmark
from sfkit.errors import InputError

Writer = Callable[[Path, NDArray[np.generic]], Path]
IMAGE = np.arange(60, dtype=np.uint8).reshape(4, 5, 3)
TRUTH = np.full((4, 5), 8, np.uint8)


def cones(folder: Path, png: Writer) -> Path:
    """Middlebury 2003: im2, im6, disp2, and disp6 that must not be taken for the left view's."""
    for stem, pixels in (("im2", IMAGE), ("im6", IMAGE + 1), ("disp2", TRUTH), ("disp6", TRUTH * 2)):
        png(folder / f"{stem}.png", pixels)
    return folder


def truths(root: Path, **options: str) -> dict[str, float]:
    benchmark = open_benchmark("pairs", root, **options)
    return {s.id: float(s.disparity[0, 0]) for s in benchmark.samples()}


@pytest.mark.parametrize(
    ("left", "right", "truth"),
    [
        ("im0", "im1", "disp0GT"),
        ("im0", "im1", "disp0"),
        ("im2", "im6", "disp2"),
        ("view1", "view5", "disp1"),
        ("left", "right", "disp"),
        ("left", "right", "disparity"),
        ("room_left", "room_right", "room_disp"),
    ],
)
def test_common_names(tmp_path: Path, png: Writer, left: str, right: str, truth: str) -> None:
    png(tmp_path / f"a/{left}.png", IMAGE)
    png(tmp_path / f"a/{right}.png", IMAGE + 1)
    np.save(tmp_path / f"a/{truth}.npy", TRUTH / 4.0) if truth != "disp0GT" else (
        tmp_path / "a/disp0GT.pfm"
    ).write_bytes(b"Pf\n5 4\n-1\n" + np.full(20, 2.0, "<f4").tobytes())
    benchmark = open_benchmark("pairs", tmp_path)
    assert (benchmark.protocol, benchmark.metric, benchmark.expected) == ("all-valid", "epe", None)
    loaded = next(benchmark.samples())
    assert loaded.id == "a"
    np.testing.assert_array_equal(loaded.left, IMAGE)
    np.testing.assert_array_equal(loaded.right, IMAGE + 1)
    assert (loaded.disparity == 2).all()


def test_a_png_needs_a_coding(tmp_path: Path, png: Writer) -> None:
    cones(tmp_path / "cones", png)
    with pytest.raises(
        InputError, match=r"disp2\.png: found no coding .* scale of an image cannot be guessed"
    ):
        open_benchmark("pairs", tmp_path)
    assert truths(tmp_path, coding="png8:4") == {"cones": 2.0}


def test_hints_in_the_folder_and_in_a_sub_folder(tmp_path: Path, png: Writer) -> None:
    cones(tmp_path / "cones", png)
    cones(tmp_path / "teddy", png)
    (tmp_path / "pairs.toml").write_text('coding = "png8:4"\n')
    (tmp_path / "teddy/pairs.toml").write_text('coding = "png8:2"\ndisparity = "disp6.png"\n')
    assert truths(tmp_path) == {"cones": 2.0, "teddy": 8.0}
    # A coding that does not fit the suffix is not meant for the file.
    np.save(tmp_path / "cones/gt.npy", TRUTH / 1.0)
    (tmp_path / "cones/pairs.toml").write_text('disparity = "gt.npy"\n')
    assert truths(tmp_path) == {"cones": 8.0, "teddy": 8.0}


def test_names_from_hints_alone(tmp_path: Path, png: Writer) -> None:
    png(tmp_path / "a/one.png", IMAGE)
    png(tmp_path / "a/two.png", IMAGE)
    png(tmp_path / "a/d.png", TRUTH)
    png(tmp_path / "a/seen.png", np.full((4, 5), 255, np.uint8))
    hints = 'left = "one.png"\nright = "two.png"\ndisparity = "d.png"\nmask = "seen.png"\ncoding = "png8:8"\n'
    (tmp_path / "a/pairs.toml").write_text(hints)
    loaded = next(open_benchmark("pairs", tmp_path).samples())
    assert (loaded.disparity == 1).all()
    assert loaded.nonoccluded is not None
    assert loaded.nonoccluded.all()
    (tmp_path / "a/seen.png").unlink()
    with pytest.raises(InputError, match=r"found no seen\.png, which a pairs\.toml names as its mask"):
        open_benchmark("pairs", tmp_path)


def test_the_folder_itself_may_be_a_pair(tmp_path: Path, png: Writer) -> None:
    cones(tmp_path / "cones", png)
    assert truths(tmp_path / "cones", coding="png8:8") == {"cones": 1.0}


def test_other_sub_folders_are_named(tmp_path: Path, png: Writer) -> None:
    cones(tmp_path / "cones", png)
    (tmp_path / "readme").mkdir()
    (tmp_path / ".cache").mkdir()
    assert open_benchmark("pairs", tmp_path, coding="png8:4").notes == ("no pair was recognised in: readme",)


@pytest.mark.parametrize(
    ("files", "message"),
    [
        ((), "found no pair with file names in common use"),
        (("im0.png", "im1.png"), "no complete pair, without a: the disparity file"),
        (("im0.png", "disp0.npy"), "without a: the right file"),
        (("im0.png", "im1.png", "left.png"), r"several left images \(im0, left\)"),
        (("im0.png", "im0.jpg", "im1.png"), r"found im0\.jpg and im0\.png, expected one of them"),
    ],
)
def test_folders_that_cannot_be_read(tmp_path: Path, files: tuple[str, ...], message: str) -> None:
    (tmp_path / "a").mkdir()
    for name in files:
        (tmp_path / "a" / name).write_bytes(b"")
    with pytest.raises(InputError, match=message):
        open_benchmark("pairs", tmp_path)


@pytest.mark.parametrize(
    ("hints", "message"),
    [
        ('code = "png8:4"', "unknown key 'code', expected .*did you mean 'coding'"),
        ("coding = 4", "coding is 4, expected a string"),
        ('coding = "png8"', "positive number after the colon"),
        ('disparity = "../../secret.pfm"\ncoding = "png8:4"', "leads to .*secret.pfm, expected a path under"),
        ('left = "absent.png"\ncoding = "png8:4"', "found no pair"),
    ],
)
def test_bad_hints(tmp_path: Path, png: Writer, hints: str, message: str) -> None:
    root = tmp_path / "root"
    cones(root / "cones", png)
    (tmp_path / "secret.pfm").write_bytes(b"")
    (root / "cones/pairs.toml").write_text(hints)
    with pytest.raises(InputError, match=message):
        open_benchmark("pairs", root)


def table(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines), encoding="utf-8")
    return path


def test_table(tmp_path: Path, png: Writer) -> None:
    cones(tmp_path / "cones", png)
    lines = (
        "left,right,disparity,coding,id",
        "cones/im2.png,cones/im6.png,cones/disp2.png,png8:4,z",
        "cones/im6.png, cones/im2.png ,cones/disp6.png,png8:2,",
    )
    csv = table(tmp_path / "list.csv", *lines)
    assert truths(csv) == {"cones/im6": 8.0, "z": 2.0}
    elsewhere = tmp_path / "elsewhere"
    elsewhere.mkdir()
    moved = table(elsewhere / "list.csv", *lines)
    assert truths(tmp_path, table=str(moved)) == {"cones/im6": 8.0, "z": 2.0}
    absolute = table(
        elsewhere / "abs.csv", lines[0], f"{tmp_path}/cones/im2.png,cones/im6.png,cones/disp2.png,png8:8,a"
    )
    assert truths(tmp_path, table=str(absolute)) == {"a": 1.0}


@pytest.mark.parametrize(
    ("lines", "message"),
    [
        (("left,right", "a,b"), r"found the columns \['left', 'right'\], expected 'disparity' once"),
        (("left,right,disparty", "a,b,c"), "column 'disparty', expected .*did you mean 'disparity'"),
        (("left,right,disparity",), "found no row below the header"),
        (("left,right,disparity", "a,b"), "line 2: found another number of values than columns"),
        (("left,right,disparity", "a,b,c,d"), "line 2: found another number of values than columns"),
        (("left,right,disparity", "a,,c"), "line 2: found no value for 'right'"),
        (("left,right,disparity", "../x.png,b,c"), r"leads to .*x\.png, expected a path under"),
        (
            ("left,right,disparity", "im2.png,absent.png,disp2.png"),
            r"found no absent\.png \(1 in all\), expected every file under",
        ),
        (("left,right,disparity,id", *["im2.png,im6.png,disp2.npy,x"] * 2), "line 3: found the id 'x' twice"),
        (("left,right,disparity", "im2.png,im6.png,disp2.png"), "found no coding"),
        (('left,right,disparity,"id',), "is no CSV file"),
    ],
)
def test_bad_tables(tmp_path: Path, png: Writer, lines: tuple[str, ...], message: str) -> None:
    root = cones(tmp_path / "root", png)
    np.save(root / "disp2.npy", TRUTH)
    with pytest.raises(InputError, match=message):
        open_benchmark("pairs", table(root / "list.csv", *lines))


def test_resolution_does_not_fit_a_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="pairs: found resolution='H', a folder has none"):
        open_benchmark("pairs", tmp_path, resolution="H")


def test_real_pairs(real_data: Path, tmp_path: Path) -> None:
    csv = table(
        tmp_path / "pairs.csv",
        "id,left,right,disparity,coding",
        "motorcycle,motorcycle/motorcycle_left.png,motorcycle/motorcycle_right.png,motorcycle/motorcycle_disp.npz,",
        "cones,cones/im2.png,cones/im6.png,cones/disp2.png,png8:4",
        "reindeer,reindeer/view1.png,reindeer/view5.png,reindeer/disp1.png,png8:2",
    )
    benchmark = open_benchmark("pairs", real_data / "pairs", table=csv, metric="bad-2.0")
    largest = {s.id: (s.size, float(np.nanmax(s.disparity))) for s in benchmark.samples()}
    assert {name: size for name, (size, _) in largest.items()} == {
        "cones": (375, 450),
        "motorcycle": (500, 741),
        "reindeer": (555, 671),
    }
    # The 8-bit files' largest values are 220 and 201.
    assert (largest["cones"][1], largest["reindeer"][1]) == (55.0, 100.5)
    assert truths(real_data / "pairs/motorcycle").keys() == {"motorcycle"}
    assert len(open_benchmark("pairs", real_data / "pairs/cones", coding="png8:4")) == 1
    assert len(open_benchmark("pairs", real_data / "pairs/reindeer", coding="png8:2")) == 1
