"""The page of the paper's numbers: what its checks find, and that it stands in the repository as made."""

from __future__ import annotations

from pathlib import Path

from published_page import disagreements, write_page, wrong_marks, wrong_means

ROOT = Path(__file__).parents[2]


def test_means_and_marks_are_right_everywhere() -> None:
    assert wrong_means() == ()
    assert wrong_marks() == ()


def test_exactly_the_known_disagreements_are_found() -> None:
    found = {finding.title: finding.evidence for finding in disagreements()}
    assert list(found) == [
        "FoundationStereo, its own search guided by ETH3D: one experiment, different scores",
        "NMRF guided by Middlebury: one experiment, different scores",
        "FoundationStereo base (SceneFlow): one experiment, different scores",
        "The text says: the best sources remain near 2.0 on ETH3D (FoundationStereo)",
        "The text says: FoundationStereo's KITTI 2012 errors range from 2.13",
    ]
    assert [line.rpartition("(mean ")[2] for line in found[list(found)[1]]] == ["3.21)", "3.31)"]
    assert found[list(found)[3]][0] == "tab:individual_datasets gives 1.61"
    quoted = found[list(found)[4]]
    assert quoted[0] == "tab:individual_datasets gives 3.21"
    assert "FoundationStereo eth3d, SceneFlow" in quoted[1]


def test_the_page_in_the_repository_is_what_the_command_writes(tmp_path: Path) -> None:
    made = write_page(tmp_path).read_text(encoding="utf-8")
    assert made == (ROOT / "docs" / "published.md").read_text(encoding="utf-8")
