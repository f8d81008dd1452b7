from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from sfkit import files
from sfkit.datasets.formats import Coding
from sfkit.datasets.manifests import load_manifest, read_manifest
from sfkit.datasets.metric import Metric
from sfkit.datasets.protocols import RULES, rules_for
from sfkit.datasets.shipped import manifest_folder, manifest_names
from sfkit.errors import InputError

VALID = """
name = "mine"
title = "Mine"
family = "eth3d"
home = "https://example.org"
get = "download it"
licence = "MIT"
citation = "Me"
metric = "bad-1.0"
ids = ["a", "b"]

[[layout]]
left = "{id}/im0.png"
right = "{id}/im1.png"
disparity = "{id}/disp0GT.pfm"
coding = "pfm"
"""


@pytest.mark.parametrize("name", manifest_names())
def test_every_manifest_is_complete(name: str) -> None:
    manifest = load_manifest(name)
    assert manifest.home.startswith("https://")
    assert manifest.citation
    assert manifest.licence
    assert Metric.parse(manifest.metric).name == manifest.metric
    assert set(rules_for(manifest.family)) == set(RULES)
    for layout in manifest.layouts:
        assert Coding.parse(layout.coding)
        assert layout.mask


def test_the_public_data_sets() -> None:
    sizes = {name: (len(load_manifest(name).ids), load_manifest(name).metric) for name in manifest_names()}
    assert sizes == {
        "eth3d": (27, "bad-1.0"),
        "kitti2012": (194, "d1"),
        "kitti2015": (200, "d1"),
        "middlebury": (15, "bad-2.0"),
    }
    assert load_manifest("kitti2012").ids[-1] == "000193_10"
    assert set(load_manifest("middlebury").resolutions) == {"F", "H", "Q"}


def test_manifests_of_a_wheel_lie_inside_the_package(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files, "PACKAGE", tmp_path / "sfkit")
    with pytest.raises(InputError, match="no data_manifests folder in or beside it"):
        manifest_folder()
    (tmp_path / "data_manifests").mkdir()
    assert manifest_folder() == tmp_path / "data_manifests"
    (tmp_path / "sfkit" / "data_manifests").mkdir(parents=True)
    assert manifest_folder() == tmp_path / "sfkit" / "data_manifests"


def test_unknown_data_set() -> None:
    with pytest.raises(
        InputError, match=r"unknown data set 'kitti2016', expected one of.*unlabelled; did you mean 'kitti201"
    ):
        load_manifest("kitti2016")


def test_a_valid_manifest(tmp_path: Path) -> None:
    (tmp_path / "mine.toml").write_text(VALID)
    manifest = read_manifest(tmp_path / "mine.toml")
    assert manifest.ids == ("a", "b")
    assert manifest.places == ("",)
    assert manifest.resolution(None) is None


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('name = "mine"', 'name = "yours"', "name 'yours', expected that of the file"),
        ('title = "Mine"', "", "missing 1 required .* 'title', add the key"),
        ('title = "Mine"', "title = 3", "title is 3, expected a string"),
        ('licence = "MIT"', 'license = "MIT"', "unknown key 'license'; did you mean 'licence'"),
        ('family = "eth3d"', 'family = "eth4d"', "unknown family 'eth4d'"),
        ('metric = "bad-1.0"', 'metric = "bed-1.0"', "unknown metric 'bed-1.0'"),
        ('ids = ["a", "b"]', 'ids = ["a", "a"]', "expected a list of names or a format and a count"),
        ('ids = ["a", "b"]', "", "ids is None"),
        ("[[layout]]", "[layout]", r"found no \[\[layout\]\]"),
        ('coding = "pfm"', 'coding = "pgm"', "unknown coding 'pgm'"),
        ('left = "{id}/im0.png"', 'left = "../{id}/im0.png"', "expected a path under the root"),
        ('right = "{id}/im1.png"', 'right = "/data/{id}/im1.png"', "expected a path under the root"),
        ('left = "{id}/im0.png"', 'left = "{id}/{id}.png"', "left is .* exactly once"),
        ('right = "{id}/im1.png"', 'right = "im1.png"', "right is 'im1.png', expected a pattern with {id}"),
        ('coding = "pfm"', "coding = \"pfm\"\nid = '('", "no regular expression"),
        ('coding = "pfm"', 'coding = "pfm"\nmask_coding = "nocc"', "unknown mask_coding .* 'nocc'"),
        ('ids = ["a", "b"]', 'ids = ["a"]\nresolutions = ["H"]', "expected both {resolution}"),
        ('ids = ["a", "b"]', 'ids = ["a"]\nplaces = ["../other"]', "places is '../other'"),
        ('name = "mine"', 'name = "mine', "is not TOML"),
    ],
)
def test_bad_manifests(tmp_path: Path, old: str, new: str, message: str) -> None:
    assert old in VALID
    (tmp_path / "mine.toml").write_text(VALID.replace(old, new, 1))
    with pytest.raises(InputError, match=message):
        read_manifest(tmp_path / "mine.toml")


def test_resolutions_of_middlebury() -> None:
    middlebury = load_manifest("middlebury")
    assert middlebury.resolution(None) == "H"
    assert middlebury.resolution(None, ("Q",)) == "Q"
    assert middlebury.resolution("F") == "F"
    with pytest.raises(InputError, match="unknown resolution of middlebury 'E', expected one of: F, H, Q"):
        middlebury.resolution("E")
    with pytest.raises(InputError, match="eth3d: found resolution='H', it comes in one only"):
        load_manifest("eth3d").resolution("H")


def test_names_come_from_the_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(manifest_folder(), tmp_path / "data_manifests")
    (tmp_path / "data_manifests" / "mine.toml").write_text(VALID)
    monkeypatch.setattr(files, "PACKAGE", tmp_path / "sfkit")
    assert "mine" in manifest_names()
    assert load_manifest("mine").title == "Mine"
