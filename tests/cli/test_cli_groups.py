"""Records of settings as options: help, defaults, checks and files of settings come from the fields."""

from __future__ import annotations

import json
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

import pytest
import tiny
import typer

from sfkit.cli import finetune, main
from sfkit.cli.groups import Group, PanelCommand, grouped
from sfkit.errors import InputError
from sfkit.settings import setting, setting_of, settle, whole
from sfkit.training import Augmentation, TrainingSettings


@dataclass(frozen=True)
class Oven:
    """A record as a room would have it."""

    heat: int = setting(180, help="Degrees.", check=whole(50))
    fan: bool = setting(default=True, help="Whether air moves.")
    times: tuple[float, float] = setting((1.0, 2.5), help="From and to, in hours.")
    trays: tuple[str, ...] = setting((), help="Names: a,b.")
    seed: int = setting(0, help="Governs every draw.")
    serial: str = "not a setting"

    def __post_init__(self) -> None:
        settle(self)


@dataclass(frozen=True)
class Clock:
    """Another one, which shares an option with the first."""

    alarm: float | None = setting(None, "--alarm", "-a", help="Hours.")
    seed: int = setting(0, help="Governs every draw.")


Kitchen = tuple[str, Oven, Clock]


class App:
    """A command with both groups, run in this process."""

    def __init__(self) -> None:
        self.heard: list[Kitchen] = []
        self.app = typer.Typer(rich_markup_mode=None, add_completion=False)
        self.app.command(cls=PanelCommand)(grouped(self.bake))

    def bake(
        self,
        dish: Annotated[str, typer.Argument()],
        oven: Annotated[Oven, Group(Oven, "The oven", defaults={"heat": 200})],
        clock: Annotated[Clock, Group(Clock, "The clock")],
        said: Annotated[dict[str, Any], Group(Oven, "The oven", make=dict, said=True)],
    ) -> None:
        """Bake."""
        self.heard.append((dish, oven, clock))
        self.said = said

    def __call__(self, line: str) -> Kitchen:
        self.app(line.split(), standalone_mode=False)
        return self.heard[-1]


@pytest.fixture
def app() -> App:
    return App()


def test_a_record_comes_back_with_its_defaults_and_those_of_the_command(app: App) -> None:
    assert app("pie") == ("pie", Oven(heat=200), Clock())


def test_every_type_of_field_has_its_form(app: App) -> None:
    dish, oven, clock = app("pie --heat 70 --no-fan --times 0.5 3 --trays a,b -a 1.5")
    assert dish == "pie"
    assert oven == Oven(70, fan=False, times=(0.5, 3.0), trays=("a", "b"))
    assert clock.alarm == 1.5


def test_a_group_may_ask_for_what_was_said_alone(app: App, tmp_path: Path) -> None:
    """What help calls the default is said where it was typed, or stands in a file."""
    file = tmp_path / "pie.toml"
    file.write_text("fan = true\n")
    app(f"pie --heat 200 --config {file}")
    assert app.said == {"heat": 200, "fan": True}
    app("pie")
    assert app.said == {}


def test_a_value_is_called_by_its_flag() -> None:
    oven, clock = Group(Oven, "The oven"), Group(Clock, "The clock")
    assert [oven.flag("fan", value) for value in (True, False)] == ["--fan", "--no-fan"]
    assert (oven.flag("heat", 90), clock.flag("alarm", 2.0)) == ("--heat", "--alarm")


def test_an_option_of_two_records_is_one_option(app: App) -> None:
    _, oven, clock = app("pie --seed 4")
    assert (oven.seed, clock.seed) == (4, 4)


def test_the_record_checks_itself_before_the_command_runs(app: App) -> None:
    with pytest.raises(InputError, match=r"^heat: found 7, expected a whole number of at least 50$"):
        app("pie --heat 7")
    assert app.heard == []


def test_help_has_a_panel_a_group_with_defaults_shown(app: App, capsys: pytest.CaptureFixture[str]) -> None:
    app.app(["--help"], standalone_mode=False)
    shown = " ".join(capsys.readouterr().out.split())
    oven, clock = shown.index("The oven:"), shown.index("The clock:")
    for text in ("--heat <int> Degrees. [default: 200]", "--fan / --no-fan", "[default: 1.0, 2.5]", "--seed"):
        assert oven < shown.index(text) < clock
    assert shown.index("--alarm") > clock
    assert "--serial" not in shown


# Files of settings.


def test_a_file_has_the_same_names_and_options_win(app: App, tmp_path: Path) -> None:
    file = tmp_path / "pie.toml"
    file.write_text('dish = "pie"\nheat = 90\nno-fan = true\ntimes = [1, 4]\ntrays = ["a", "b"]\nalarm = 2\n')
    dish, oven, clock = app(f"--config {file} --heat 120")
    assert dish == "pie"
    assert oven == Oven(120, fan=False, times=(1.0, 4.0), trays=("a", "b"))
    assert clock.alarm == 2.0


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("head = 90", r"unknown option 'head', expected one of: .*; did you mean 'heat'\?"),
        ("a = 1.5", "unknown option 'a'"),
        ("config = 'x'", "unknown option 'config'"),
        ("heat = 90.5", r"heat: found 90\.5, expected a whole number"),
        ("heat = true", "heat: found True, expected a whole number"),
        ("heat = '90'", "heat: found '90', expected a whole number"),
        ("fan = 1", "fan: found 1, expected true or false"),
        ("times = [1.0]", r"times: found \[1\.0\], expected a list of 2 values"),
        ("[oven]\nheat = 90", "unknown option 'oven'"),
        ("fan = true\nno-fan = true", "no-fan is said twice, by two names of one option"),
        ("heat = ", "is not TOML"),
    ],
)
def test_a_file_that_cannot_be_meant_is_refused(app: App, tmp_path: Path, text: str, sentence: str) -> None:
    file = tmp_path / "pie.toml"
    file.write_text(text)
    with pytest.raises(InputError, match=sentence) as refused:
        app(f"pie --config {file}")
    assert str(refused.value).startswith(f"{file}: ")
    with pytest.raises(InputError, match=r"none\.toml: cannot be read"):
        app(f"pie --config {tmp_path / 'none.toml'}")


# A fine-tuning's settings: a file of the record's own names as well, and a record inside it.


class Trainer(App):
    """A command with the options of ``sfkit finetune`` that make its settings."""

    def bake(  # type: ignore[override]
        self,
        training: Annotated[TrainingSettings, finetune.TRAINING],
        augmentation: Annotated[Augmentation, finetune.AUGMENTATION],
        settings: finetune.SettingsOption = None,
    ) -> None:
        self.heard.append((training, augmentation))  # type: ignore[arg-type]


def test_every_setting_of_a_training_is_an_option_with_the_records_default(tmp_path: Path) -> None:
    assert Trainer()("") == (TrainingSettings(), Augmentation())
    for group in (finetune.TRAINING, finetune.AUGMENTATION):
        assert set(group.options()) == {one.name for one in fields(group.record) if setting_of(one)}
    line = "--crop 16x32 --train-batch-norm --precision bfloat16 --rate 1 --erase 0 --workers 0"
    expected = TrainingSettings(freeze_batch_norm=False, precision="bfloat16", rate=1.0, workers=0)  # type: ignore[arg-type]
    assert Trainer()(line) == (expected, Augmentation(crop=(16, 32), erase=0.0))


def test_a_file_of_settings_gives_way_to_a_file_of_options_and_both_to_options(tmp_path: Path) -> None:
    settings, config = tmp_path / "settings.toml", tmp_path / "config.toml"
    settings.write_text("epochs = 2\nbatch = 3\nseed = 4\nfreeze_batch_norm = false\naugmentation = false\n")
    config.write_text(f'batch = 5\nseed = 6\nhue = 0.5\nsettings = "{settings}"\n')
    expected = (TrainingSettings(2, batch=5, seed=7, freeze_batch_norm=False), Augmentation.none())
    changed = (expected[0], Augmentation(None, 0, 0, 0, 0.5, 0, 0))
    for line in (f"--settings {settings} --config {config}", f"--config {config} --settings {settings}"):
        assert Trainer()(f"{line} --seed 7") == changed
    assert Trainer()(f"--config {config} --seed 7") == changed
    assert Trainer()(f"--settings {settings} --batch 5 --seed 7") == expected


@pytest.mark.parametrize(
    ("text", "line", "sentence"),
    [
        ("epochs = 0", "", r"settings\.toml: epochs is 0, expected a whole number of at least 1$"),
        ("epoch = 1", "", r"settings\.toml.*'epoch'.*did you mean 'epochs'"),
        ("", "--batch 0", "^the command line: batch is 0, expected a whole number of at least 1$"),
        (
            "",
            "--precision half",
            "^the command line: unknown precision 'half', expected one of: bfloat16, fl",
        ),
        ("", "--crop 256", "^--crop is '256', expected height x width in pixels, such as 256x512, or none$"),
        ("", "--crop 0x5", r"^crop is \(0, 5\), expected height and width in pixels"),
    ],
)
def test_settings_of_a_training_are_refused_where_they_were_said(
    tmp_path: Path, text: str, line: str, sentence: str
) -> None:
    settings = tmp_path / "settings.toml"
    settings.write_text(text)
    with pytest.raises(InputError, match=sentence):
        Trainer()(f"--settings {settings} {line}")


# The commands.


def run(line: str, capsys: pytest.CaptureFixture[str]) -> tuple[int, str, str]:
    with pytest.raises(SystemExit) as ended:
        main(line.split())
    return int(ended.value.code or 0), *capsys.readouterr()


def settings(folder: Path) -> dict[str, dict[str, Any]]:
    """What each search of a journal was told."""
    lines = (folder / "journal.jsonl").read_text(encoding="utf-8").splitlines()
    starts = [line for line in map(json.loads, lines) if line["event"] == "start"]
    return {start["search"]: start["settings"] for start in starts}


def test_every_setting_of_both_stages_reaches_the_search(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    tiny.write_pool(tmp_path / "pool")
    tiny.write_pairs(tmp_path / "pairs", 1)
    monkeypatch.chdir(tmp_path)
    Path("search.toml").write_text(
        'benchmark = "pairs"\nroot = "pairs"\npopulation = 3\ngenerations = 1\nseed = 7\ncrossover = 0.25\n'
        "mutation = 0.5\nevaluations = 4\nstage2-population = 3\nsigma = 0.25\ngamma = [0.5, 1.5]\n"
    )
    code, _, errors = run("search pool --config search.toml --mutation 0.75 --rank 1 --yes --out out", capsys)
    assert code == 0, errors
    told = settings(tmp_path / "out")
    first = {"population": 3, "generations": 1, "crossover": 0.25, "mutation": 0.75, "seed": 7}
    second = {"evaluations": 4, "population": 3, "sigma": 0.25, "gamma": [0.5, 1.5], "rank": 1, "seed": 7}
    assert first.items() <= told["subset"].items()
    assert {**second, "tied": False}.items() <= told["routing"].items()


@pytest.mark.parametrize("command", ["demo", "search", "evaluate", "baselines"])
def test_every_command_that_evaluates_can_be_told_where(
    command: str, capsys: pytest.CaptureFixture[str]
) -> None:
    code, shown, _ = run(f"{command} --help", capsys)
    assert code == 0
    panel = shown[shown.index("Where networks run:") :]
    for option in ("--device", "--engine", "--workers", "--precision"):
        assert option in panel
