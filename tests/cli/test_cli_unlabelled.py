"""Commands on pairs without ground truth: what they say of trust, of a prediction, and of bad input."""

from __future__ import annotations

import json
import shutil
from importlib import import_module
from pathlib import Path

import cv2
import numpy as np
import pytest
from cli_world import Shell

from sfkit.merging import Pool, Recipe

BOTH = "-b unlabelled -r pairs --also pairs,root=pairs,metric=epe"


def test_baselines_say_how_far_a_guide_without_labels_may_be_trusted(shell: Shell) -> None:
    line = "baselines pool -b unlabelled -r pairs --names uniform,stage1 --population 3 --generations 1"
    document = shell.json(line)
    trust = document["trust"]
    assert (document["metric"], document["unit"]) == ("census", "%")
    assert (trust["agreement"], trust["pairs"], trust["trusted"]) == (None, 2, False)
    _, errors = shell(line)
    assert f"warning: {trust['sentence']}" in errors.splitlines()
    assert "2 pairs can be overfitted, as labels can" in trust["sentence"]
    assert "trust" not in shell.json("baselines pool -b pairs -r pairs --names uniform")


def test_baselines_show_the_maps_of_the_best_method(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[tuple[Recipe, Pool]] = []

    def spy(_: Pool, __: object, found: Recipe, *, found_in: Pool) -> None:
        asked.append((found, found_in))

    monkeypatch.setattr(import_module("sfkit.analysis.trust"), "trust_of", spy)
    line = "baselines pool -b unlabelled -r pairs --names single_best,uniform,ties"
    entries = shell.json(line)["baselines"]
    best = min(entries, key=lambda entry: entry["score"])
    ((found, found_in),) = asked
    assert found_in.bound(found).document() == best["recipe"]
    assert set(found.sources) <= set(found_in.names)


def test_labels_are_asked_of_every_network_in_the_store(shell: Shell) -> None:
    shell("merge pool --weights kitti=0.25,indoor=0.75 -o mix.safetensors")
    networks = "--members --all-subsets --recipe mix.safetensors"
    census, truth = (
        [
            row["score"]
            for row in shell.json(f"evaluate pool {guide} -r pairs {networks} --store s.sqlite")["scores"]
        ]
        for guide in ("-b unlabelled", "-b pairs --metric epe")
    )
    found = shell.json(f"baselines pool {BOTH} --names uniform --store s.sqlite")["trust"]["agreement"]
    assert found["networks"] == len(census) == 9, "base, every subset of three, and the mixture"
    assert found["metric"] == "epe on pairs (2)"
    ranks = [np.argsort(np.argsort(scores)) for scores in (census, truth)]
    assert found["correlation"] == pytest.approx(float(np.corrcoef(ranks)[0, 1]))
    assert found["interval"][0] <= found["correlation"] <= found["interval"][1]
    assert found["regret"] == pytest.approx(truth[int(np.argmin(census))] - min(truth))


def test_pairs_without_labels_test_what_they_did_not_guide(shell: Shell) -> None:
    _folder("kept")
    line = "search pool -b unlabelled -r pairs --population 2 --generations 0 --evaluations 2 -o out"
    _, errors = shell(f"{line} --test unlabelled,root=kept", code=2)
    assert "found 0, 1, 2 among the pairs that guide the search" in errors
    for path in Path("kept").glob("*/*.png"):
        cv2.imwrite(str(path), cv2.imread(str(path))[:-2])
    said, errors = shell(f"{line} --test unlabelled,root=kept --json")
    assert "test: kept (3 pairs), census, which guides nothing" in errors.splitlines()
    back = json.loads(said)["trust"]["kept_back"]
    assert back["pairs"] == 3
    assert np.isfinite([back["guiding"], back["further"]]).all()


def test_a_metric_that_needs_labels_is_refused_beside_census(shell: Shell) -> None:
    shell("merge pool --uniform -o a.safetensors")
    shell("merge pool --subset kitti -o b.safetensors")
    for command in ("evaluate pool --uniform", "compare a.safetensors b.safetensors"):
        _, errors = shell(f"{command} -b unlabelled -r pairs --metric census,epe", code=2)
        assert errors.splitlines() == [
            "error: benchmark 'pairs': epe needs ground truth and its pairs have none, expected census"
        ]


def _folder(name: str) -> Path:
    """Two folders of three frames each, to be spoilt."""
    for side in ("left", "right"):
        (Path(name) / side).mkdir(parents=True)
        for frame in range(3):
            source = Path("pairs") / f"pair{frame % 2}" / f"{side}.png"
            shutil.copy(source, Path(name) / side / f"{frame}.png")
    return Path(name)


def _one_image(folder: Path) -> None:
    for path in (*folder.glob("right/*"), folder / "left/1.png", folder / "left/2.png"):
        path.unlink()


def _sizes_differ(folder: Path) -> None:
    cv2.imwrite(str(folder / "right/0.png"), cv2.imread(str(folder / "right/0.png"))[:, :-2])


def _identical(folder: Path) -> None:
    shutil.copy(folder / "left/0.png", folder / "right/0.png")


def _black(folder: Path) -> None:
    for side in ("left", "right"):
        cv2.imwrite(str(folder / side / "0.png"), np.zeros((48, 96, 3), np.uint8))


def _dropped_frames(folder: Path) -> None:
    (folder / "right/1.png").unlink()


@pytest.mark.parametrize(
    ("spoil", "words"),
    [
        (_one_image, "found 1 and 0 images without a name in common, expected as many left as right"),
        (_sizes_differ, "found 94x48 pixels, expected 96x48"),
        (_identical, "0: left and right are the same image; give the two views"),
        (_black, "0: the left image is one flat colour; check the file"),
        (_dropped_frames, "found no image of that name on the other side (1 such in all)"),
    ],
)
def test_bad_pairs_are_refused_in_one_sentence(spoil: object, words: str, shell: Shell, world: Path) -> None:
    folder = _folder("spoilt")
    spoil(folder)  # type: ignore[operator]
    for command in ("search pool -o new", "baselines pool --names uniform"):
        _, errors = shell(f"{command} -b unlabelled -r {folder}", code=2)
        (sentence,) = errors.splitlines()
        assert sentence.startswith("error: ")
        assert words in sentence
    assert not (world / "new").exists()


def test_exchanged_images_are_found_before_a_search(shell: Shell) -> None:
    folder = _folder("crossed")
    (folder / "left").rename(folder / "kept")
    (folder / "right").rename(folder / "left")
    (folder / "kept").rename(folder / "right")
    _, errors = shell(f"baselines pool -b unlabelled -r {folder} --names uniform")
    (sentence,) = [line for line in errors.splitlines() if "exchanged" in line]
    assert sentence.startswith("warning: benchmark 'crossed': pair '0' looks wrong")
