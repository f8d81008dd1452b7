"""What a terminal shows while a command works, and what a file gets in its place."""

from __future__ import annotations

import io
import re
import sys
import threading
from pathlib import Path
from typing import cast

import pytest
from cli_world import Shell, rename_sources
from tiny import write_pairs, write_pool

from sfkit.cli import terminal
from sfkit.cli.finetune import progress
from sfkit.cli.terminal import Bars, coloured, followed, say
from sfkit.training.loop import Course

ESCAPE = re.compile(r"\x1b\[[0-9;]*[A-Za-z]")


class Screen:
    """Standard error that says it is a terminal; made in the test, where pytest has put its own in place."""

    def __init__(self, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setenv("TERM", "xterm")
        monkeypatch.delenv("NO_COLOR", raising=False)
        monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
        self._capsys = capsys

    def text(self) -> str:
        """What was written since."""
        return self._capsys.readouterr().err


def test_a_terminal_has_a_bar_with_the_time_left_and_lines_above_it(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    screen = Screen(capsys, monkeypatch)
    with Bars() as bars:
        bars("Stage 1", 0, 8, line="never said")
        bars("Stage 1", 3, 8, "best 12.5")
        say("warning: few pairs")
        bars.within(2, 4)
        assert terminal._shown["Stage 1"].n == 5, "two more of the step under way"
        bars("Stage 2", 1, 2)
        assert list(terminal._shown) == ["Stage 2"], "a step ends where another begins"
    assert not terminal._shown
    written = screen.text()
    text = ESCAPE.sub("", written)
    assert "never said" not in text
    assert re.search(r"Stage 1  38 % \|.*\| 3 of 8, \d\d:\d\d, \S+ left, best 12\.5", text)
    assert "\r" in text.partition("warning: few pairs\n")[0], "the bar is wiped before a line is written"
    assert "\x1b[33m" in written, "the word warning is yellow"


def test_trainings_side_by_side_have_a_bar_each(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    screen = Screen(capsys, monkeypatch)
    with Bars(side_by_side=True) as bars:
        bars.show("kitti: step 50 of 300, loss 0.125, 9 s left")
        bars.show("indoor: step 50 of 300, loss 0.250, 9 s left")
        assert list(terminal._shown) == ["kitti", "indoor"]
        bars.show("kitti: step 300 of 300, loss 0.100, 0 s left")
        assert list(terminal._shown) == ["indoor"]
        bars.show("streets: missing, 300 steps")
    assert "streets: missing, 300 steps\n" in ESCAPE.sub("", screen.text())


def test_threads_take_turns_on_the_screen(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A line that is written while another training's bar comes: both are shown, neither thread fails."""
    screen, failed = Screen(capsys, monkeypatch), []
    with Bars(side_by_side=True) as bars:
        bars("kitti", 1, 9)
        other = threading.Thread(target=bars, args=("indoor", 1, 9))

        def clear() -> None:
            other.start()
            other.join(0.2)

        monkeypatch.setattr(terminal._shown["kitti"], "clear", clear)
        monkeypatch.setattr(threading, "excepthook", failed.append)
        say("streets: missing, 300 steps")
        other.join()
        assert list(terminal._shown) == ["kitti", "indoor"]
    assert not failed
    assert "streets: missing, 300 steps\n" in ESCAPE.sub("", screen.text())


def test_a_bar_of_what_nobody_can_count(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """As of a video that does not say how many frames it has."""
    screen = Screen(capsys, monkeypatch)
    assert list(followed("abc", lambda number, piece: None, total=None, what="frames")) == ["a", "b", "c"]
    assert "frames 3, 00:00" in ESCAPE.sub("", screen.text())


def test_elsewhere_there_are_plain_lines(capsys: pytest.CaptureFixture[str]) -> None:
    with Bars() as bars:
        bars("Stage 1", 3, 8, "best 12.5", line="Stage 1, generation 0: best 12.5")
        bars("Stage 1", 4, 8)
        bars.within(1, 2)
        bars.show("cell 3 of 9: pool = open_pool(pool)")
    assert (
        capsys.readouterr().err == "Stage 1, generation 0: best 12.5\ncell 3 of 9: pool = open_pool(pool)\n"
    )


@pytest.mark.parametrize(("name", "value"), [("NO_COLOR", "1"), ("TERM", "dumb")])
def test_who_wants_no_colour_gets_none(
    name: str, value: str, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    Screen(capsys, monkeypatch)
    sentence = "error: x\nwithin noise of base; better than a, worse than b"
    painted = coloured(sentence, sys.stderr)
    assert ESCAPE.sub("", painted) == sentence
    assert len(ESCAPE.findall(painted)) == 4 * 3, "colour, bold and their end, four times"
    monkeypatch.setenv(name, value)
    assert coloured(sentence, sys.stderr) == sentence
    assert coloured(sentence, io.StringIO()) == sentence


def test_a_search_moves_its_bar_with_every_network(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    Screen(capsys, monkeypatch)
    rename_sources(write_pool(tmp_path / "pool"))
    write_pairs(tmp_path / "pairs", 2)
    monkeypatch.chdir(tmp_path)
    reached: list[tuple[float, float]] = []
    within = Bars.within
    monkeypatch.setattr(Bars, "within", lambda bars, *at: (reached.append(at), within(bars, *at))[1])
    line = "search pool -b pairs -r pairs --population 4 --generations 1 --evaluations 4 -o run"
    _, written = Shell(capsys)(line)
    assert any(0 < done < total for done, total in reached), "one of a generation's networks at a time"
    text = ESCAPE.sub("", written)
    assert re.search(r"Stage 1 100 % \|.*\| 8 of 8", text)
    assert re.search(r"Stage 2 100 % \|.*\| 4 of 4, .* best \d+\.\d{2} \(", text)
    assert "Stage 1, generation" not in text


def test_a_training_says_loss_rate_samples_a_second_and_the_time_left() -> None:
    told: list[str | None] = []
    tell = progress(cast(Bars, lambda *_, line: told.append(line)), 8)
    for done in (9, 10):
        tell(Course(20, done, seconds=done / 2, curve=[[done, 1.5, 1.0, 2e-4]]))
    assert told == [None, "step 10 of 20: loss 1.500, rate 2.0e-04, 16.00 samples a second, 5 s left"]
