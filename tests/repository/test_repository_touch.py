"""What to touch to add a thing: each row of the table in CONTRIBUTING, performed on a copy of the tree."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from textwrap import dedent

import pytest

ROOT = Path(__file__).parents[2]
ROW = re.compile(r"^\| (an? [^|]+?) \| (\d+) \| (.+?) \|$", re.M)

CELL = """from sfkit.analysis.steps_taken import steps_taken
from sfkit.figures.steps_taken import steps_figure

steps_figure(steps_taken(pool))"""

Edits = tuple[tuple[str, str], ...]
"""Lines to put before others, by what those begin with; a cell is put before the end of a notebook."""

# What is added, by row of the table: file -> the text of a new one, or what changes in one that is there.
ADDITIONS: dict[str, dict[str, str | Edits]] = {
    "an architecture": {
        "shift.py": """
            import sfkit
            import torch

            @sfkit.register_architecture("shift", blocks={"shift": ["shift"]})
            class Shift(torch.nn.Module):
                def __init__(self) -> None:
                    super().__init__()
                    self.shift = torch.nn.Parameter(torch.zeros(1))

                def forward(self, left: torch.Tensor, right: torch.Tensor) -> torch.Tensor:
                    return self.shift.expand(1, *left.shape[-2:])
        """
    },
    "a benchmark of a known family": {
        "data_manifests/rig.toml": """
            name = "rig"
            title = "Pairs of our own rig"
            family = "kitti"
            home = "none"
            get = "copy the folder"
            licence = "CC0-1.0"
            citation = "none"
            metric = "d1"
            places = [""]
            ids = ["pair0", "pair1"]

            [[layout]]
            left = "{id}/left.png"
            right = "{id}/right.png"
            disparity = "{id}/disparity.pfm"
            coding = "pfm"
        """
    },
    "a metric": {
        "sfkit/datasets/squared.py": '''
            """Mean squared error."""

            import numpy as np

            from sfkit.datasets.metric import Count, Map, Mask, Metric, Ratio, register_metric
            from sfkit.datasets.pairs import Sample


            def squared(sample: Sample, valid: Mask) -> Count:
                """Counts the squared errors of one pair."""

                def count(prediction: Map) -> Ratio:
                    return float(np.square(prediction - sample.disparity)[valid].sum()), float(valid.sum())

                return count


            SQUARED = register_metric(Metric("squared", unit="px²", label="MSE", recorder=squared))
        ''',
        "sfkit/datasets/__init__.py": (
            ("if TYPE_CHECKING:", "from sfkit.datasets.squared import SQUARED\n\n"),
        ),
    },
    "a baseline": {
        "sfkit/baselines/halves.py": '''
            """The first half of the sources, equally weighted."""

            from sfkit.baselines.registry import Choice, baseline
            from sfkit.baselines.trials import Trials


            @baseline("halves", label="first half", paper="none", tuned_on_validation=False)
            def halves(trials: Trials) -> Choice:
                """The mean of the first half of the sources."""
                recipe = trials.pool.equal(*trials.pool.names[: (len(trials.pool.names) + 1) // 2])
                trials.score([recipe])
                return Choice(recipe)
        ''',
        "sfkit/baselines/__init__.py": (
            ("arrange(", "from sfkit.baselines.halves import halves\n\n"),
            ("    task_arithmetic,\n    greedy_soup", "    halves,\n"),
        ),
    },
    "a figure of the report": {
        "sfkit/analysis/steps_taken.py": '''
            """How far each source went."""

            from collections.abc import Mapping

            from sfkit.merging.pool import Pool


            def steps_taken(pool: Pool) -> Mapping[str, float]:
                """Source -> length of its task vector."""
                return {name: float(vector.norm()) for name, vector in pool.vectors.items()}
        ''',
        "sfkit/figures/steps_taken.py": '''
            """How far did each source go?"""

            from collections.abc import Mapping

            import plotly.graph_objects as go

            from sfkit.figures.theme import finish, read_theme


            def steps_figure(steps: Mapping[str, float], *, theme: str = "auto") -> go.Figure:
                """Draw what :func:`sfkit.analysis.steps_taken.steps_taken` found."""
                read_theme(theme)
                figure = go.Figure(go.Bar(x=list(steps), y=list(steps.values())))
                figure.update_xaxes(title_text="source")
                figure.update_yaxes(title_text="length (parameters' unit)")
                return finish(figure, theme=theme, title="How far?", subtitle="longer: further", height=400)
        ''',
        "notebooks/report.ipynb": (("cell", CELL),),
        "tests/figures/figure_records.py": (
            ("CANDIDATES = (", "from sfkit.figures.steps_taken import steps_figure\n"),
            (
                '    "population": lambda',
                '    "steps": lambda theme: steps_figure({"a": 1.0}, theme=theme),\n',
            ),
        ),
    },
    "a shared option": {
        "sfkit/evaluation/compute.py": (
            (
                "    channels_last: bool",
                '    pinned: bool = setting(False, help="Page-locked memory.")\n',
            ),
        ),
    },
}

SHARING = ("search", "baselines", "evaluate")  # commands that take the record


USE = """
import json, sys
from pathlib import Path
import shift, tiny, torch, sfkit
from safetensors.torch import save_file
from sfkit import baselines
from sfkit.checkpoints.spec import Member, PoolSpec
from sfkit.merging import open_pool
from sfkit.cli.app import app
from sfkit.cli.baselines import methods
from typer.testing import CliRunner

folder = Path(sys.argv[1])
assert Path(sfkit.__file__).is_relative_to(folder), sfkit.__file__
members = []
for name, level in (("base", 1.0), ("a", 3.0), ("b", 5.0), ("c", 9.0)):
    save_file({"shift": torch.tensor([level])}, folder / f"{name}.safetensors")
    members.append(Member(name, folder / f"{name}.safetensors"))
pool = open_pool(PoolSpec("own", "shift", members[0], tuple(members[1:])))
rig = sfkit.open_benchmark("rig", tiny.write_pairs(folder / "rig", 2, shift=5))
scorer = sfkit.Evaluator(pool, rig, metric="squared")
run = baselines.run_baselines(pool, scorer, ["uniform", "halves"])
exec(compile(sys.argv[2], "the report's cell", "exec"))
sys.path.append(str(folder / "tests" / "figures"))
sys.path.append(str(folder / "tests" / "analysis"))
from figure_records import FIGURES
print(json.dumps({
    "architecture": pool.architecture.name,
    "benchmark": [rig.name, *rig.ids],
    "metric": scorer.metric.label,
    "scores": [result.score for result in run.results.values()],
    "baselines": list(baselines.baselines()),
    "typed": list(methods()),
    "halves": list(run.results["halves"].recipe.sources),
    "steps": steps_taken(pool),
    "figure": FIGURES["steps"]("dark").layout.title.text,
    "option": ["--pinned" in CliRunner().invoke(app, [name, "--help"]).output for name in sys.argv[3:]],
}))
"""


def rows() -> dict[str, tuple[int, str]]:
    """What to add -> how many files, and which."""
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    return {name: (int(count), which) for name, count, which in ROW.findall(text)}


@pytest.fixture(scope="module")
def tree(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the tree with everything added."""
    folder = tmp_path_factory.mktemp("tree")
    for name in ("sfkit", "data_manifests", "notebooks", "tests/figures", "tests/analysis"):
        shutil.copytree(ROOT / name, folder / name, ignore=shutil.ignore_patterns("__pycache__"))
    for files in ADDITIONS.values():
        for name, change in files.items():
            _apply(folder / name, change)
    return folder


def _apply(path: Path, change: str | Edits) -> None:
    if isinstance(change, str):
        assert not path.exists()
        path.write_text(dedent(change).lstrip(), encoding="utf-8")
        return
    for anchor, lines in change:
        text = path.read_text(encoding="utf-8")
        if anchor == "cell":
            book = json.loads(text)
            book["cells"].append({"cell_type": "code", "id": "steps", "source": lines, "metadata": {}})
            path.write_text(json.dumps(book), encoding="utf-8")
        else:
            assert text.count(f"\n{anchor}") == 1, f"{path}: {anchor!r}"
            path.write_text(text.replace(f"\n{anchor}", f"\n{lines}{anchor}"), encoding="utf-8")


@pytest.fixture(scope="module")
def found(tree: Path) -> Mapping[str, object]:
    """What a program sees that uses everything added."""
    book = json.loads((tree / "notebooks" / "report.ipynb").read_text(encoding="utf-8"))
    cell = next(cell["source"] for cell in book["cells"] if cell["id"] == "steps")
    places = os.pathsep.join(map(str, (tree, ROOT / "tests")))
    done = subprocess.run(
        [sys.executable, "-c", USE, tree, cell, *SHARING],
        cwd=tree,
        env={**os.environ, "PYTHONPATH": places},
        capture_output=True,
        text=True,
    )
    assert done.returncode == 0, done.stderr
    return dict(json.loads(done.stdout))


@pytest.mark.parametrize("name", ADDITIONS)
def test_the_table_names_the_files_it_takes(name: str) -> None:
    count, which = rows()[name]
    assert count == len(ADDITIONS[name])
    named = re.findall(r"`([^`]+)`", which)
    assert len(named) >= count
    for path in ADDITIONS[name]:
        pattern = path.replace("_taken", "").replace("steps", "NAME").replace("shift", "NAME")
        pattern = re.sub(r"\b(rig|squared|halves)\b", "NAME", pattern)
        assert pattern in named, f"{pattern} is not among {named}"


def test_nothing_in_the_table_is_left_untried() -> None:
    assert set(rows()) == {*ADDITIONS}


def test_what_was_added_works(found: Mapping[str, object]) -> None:
    assert found["architecture"] == "shift"
    assert found["benchmark"] == ["rig", "pair0", "pair1"]
    assert found["halves"] == ["a", "b"]
    # The base says 1 px, the sources 3, 5 and 9; the truth is 5.
    assert found["metric"] == "MSE"
    assert found["scores"] == pytest.approx([(17 / 3 - 5) ** 2, (4 - 5) ** 2], rel=1e-5)
    assert found["steps"] == {"a": 2.0, "b": 4.0, "c": 8.0}
    assert found["figure"] == "How far?"
    assert found["option"] == [True] * len(SHARING)
    assert found["typed"] == found["baselines"]
    names = found["baselines"]
    assert isinstance(names, list)
    assert names.index("halves") == names.index("uniform") + 1
