"""Every option of both stages reaches the settings of the method, or is refused; none is ignored."""

from __future__ import annotations

from dataclasses import fields
from typing import Any

import pytest
from cli_world import Shell

from sfkit.cli.groups import Group
from sfkit.cli.methods import stages
from sfkit.cli.panels import MODEL1, MODEL2, STAGE1, STAGE2
from sfkit.errors import InputError
from sfkit.search import BayesianRoutingSettings, BayesianSubsetSettings, RoutingSettings, SubsetSettings
from sfkit.search.checks import METHODS
from sfkit.search.plan import SearchPlan
from sfkit.settings import setting_of

OTHERWISE: dict[str, Any] = {
    "population": 7,
    "generations": 5,
    "crossover": 0.25,
    "mutation": 0.25,
    "redraw": False,
    "survival": "truncation",
    "evaluations": 9,
    "sigma": 0.2,
    "gamma": (0.5, 1.5),
    "tied": False,
    "scaled": False,
    "rank": 2,
    "entropy": 0.125,
    "holdout": 0.5,
    "shrinkage": 0.125,
    "converge": False,
    "tolfun": 0.125,
    "tolx": 0.125,
    "floor": 0.125,
    "seed": 3,
    "singles": False,
    "batch": 4,
    "beta": 1.25,
    "far": 0.75,
    "patience": 6,
    "smallest": 0.0625,
}
"""Field -> a value that is no default."""

ONLY_PAPER = {
    *("crossover", "mutation", "redraw", "survival"),
    *("holdout", "converge", "tolfun", "tolx", "stage2-population"),
}
ONLY_BAYESIAN = {"singles", "batch", "beta", "stage2-beta", "far", "patience", "smallest"}
"""What each method alone has, said here by hand."""

OPTIONS = [
    (stage, group, name)
    for stage, groups in enumerate(((STAGE1, MODEL1), (STAGE2, MODEL2)))
    for group in groups
    for name in group.options()
]
RECORDS = {
    "paper": (SubsetSettings, RoutingSettings),
    "bayesian": (BayesianSubsetSettings, BayesianRoutingSettings),
}


def test_the_options_are_all_settings_of_all_four_records() -> None:
    """A setting that is new is offered, and met by the test below."""
    for stage, records in enumerate(zip(*(RECORDS[method] for method in METHODS), strict=True)):
        declared = {entry.name for one in records for entry in fields(one) if setting_of(entry) is not None}
        assert declared == {name for number, _, name in OPTIONS if number == stage}
        assert declared <= set(OTHERWISE)


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("stage", "group", "name"), OPTIONS, ids=[f"{stage + 1}-{name}" for stage, _, name in OPTIONS]
)
def test_an_option_reaches_the_settings_or_is_refused(
    stage: int, group: Group, name: str, method: str
) -> None:
    said: list[dict[str, Any]] = [{}, {}]
    for number in (0, 1) if name in ("seed", "batch") else (stage,):
        said[number] = {name: OTHERWISE[name]}
    flag = group.flag(name, OTHERWISE[name])
    word = group.flag(name, value=True).removeprefix("--")
    if word in (ONLY_BAYESIAN if method == "paper" else ONLY_PAPER):
        with pytest.raises(InputError) as refused:
            stages(method, *said, start=True)
        # A hold-out is refused by the record, which has a reason of its own.
        sentence = str(refused.value).replace("holdout: ", "--holdout: ")
        assert sentence.startswith(f"{flag}: found ")
        assert f"--method {next(one for one in METHODS if one != method)}" in sentence
        return
    made = stages(method, *said, start=True)
    assert [type(one) for one in made] == list(RECORDS[method])
    assert getattr(made[stage], name) == OTHERWISE[name]
    # The rest is the method's own; a rank is of routing that is not tied.
    rest = {entry.name for entry in fields(made[stage])} - {name, "tied", "generations"}
    own = RECORDS[method][stage]()
    assert all(getattr(made[stage], one) == getattr(own, one) for one in rest)


def test_what_is_typed_reaches_the_plan(shell: Shell, monkeypatch: pytest.MonkeyPatch) -> None:
    """From the words to the search; of the first radius nothing was left on the way."""
    plans: list[SearchPlan] = []

    def keep(plan: SearchPlan, pool: object) -> None:
        plans.append(plan)
        raise InputError("seen")

    monkeypatch.setattr(SearchPlan, "check", keep)
    line = "search pool -b pairs -r pairs -o new --method bayesian --batch 64 --seed 5 --population 4"
    shell(f"{line} --no-singles --beta 3 --sigma 0.2 --stage2-beta 1 --far 0 --evaluations 30", 2)
    shell("search pool -b pairs -r pairs -o new --no-redraw --survival truncation --stage2-population 9", 2)
    shell("search pool -b pairs -r pairs -o new --method bayesian --subset kitti,driving --patience 2", 2)
    assert [(plan.stage1, plan.stage2) for plan in plans] == [
        (
            BayesianSubsetSettings(population=4, generations=3, singles=False, batch=64, beta=3.0, seed=5),
            BayesianRoutingSettings(evaluations=30, batch=64, sigma=0.2, beta=1.0, far=0.0, seed=5),
        ),
        (SubsetSettings(redraw=False, survival="truncation"), RoutingSettings(population=9)),
        (BayesianSubsetSettings(), BayesianRoutingSettings(patience=2)),
    ]


def test_the_paper_s_method_scores_one_batch_of_one() -> None:
    """Which is what it does, and so is no slip."""
    assert stages("paper", {"batch": 1}, {"batch": 1}) == (SubsetSettings(), RoutingSettings())


def test_the_method_sizes_its_rounds_by_the_batch_unless_they_are_said() -> None:
    assert stages("bayesian", {"batch": 4}, {"batch": 4})[0].generations == 11
    assert stages("bayesian", {"batch": 4, "generations": 5}, {"batch": 4})[0].generations == 5


@pytest.mark.parametrize("method", METHODS)
@pytest.mark.parametrize(
    ("first", "second", "left", "sentence"),
    [
        ({"population": 9}, {}, "subset", "--population: found it with --subset, which leaves Stage 1 out"),
        (
            {},
            {"evaluations": 0, "entropy": 1.0},
            "",
            "--entropy: found it with --evaluations 0, which leaves",
        ),
        ({}, {"floor": 0.1}, "", "--floor: found it without --start; leave it out or name a recipe"),
        ({}, {"scaled": False, "gamma": (0.5, 1.5)}, "", "--gamma: found it with --no-scaled, which fixes"),
        ({}, {"rank": 2, "tied": True}, "", "rank: found 2 and tied=True"),
    ],
)
def test_what_another_option_turns_off_is_refused(
    method: str, first: dict[str, Any], second: dict[str, Any], left: str, sentence: str
) -> None:
    with pytest.raises(InputError) as refused:
        stages(method, first, second, subset=left == "subset")
    assert str(refused.value).startswith(sentence)


def test_conditions_of_convergence_are_refused_where_nothing_converges() -> None:
    with pytest.raises(InputError, match=r"^--tolx: found it with --no-converge, which uses up the budget"):
        stages("paper", {}, {"converge": False, "tolx": 0.1})


def test_a_seed_belongs_to_whatever_stage_is_left() -> None:
    seed = {"seed": 4}
    assert stages("paper", seed, {**seed, "evaluations": 0}) == (SubsetSettings(seed=4), None)
    assert stages("bayesian", seed, seed, subset=True)[1] == BayesianRoutingSettings(seed=4)
