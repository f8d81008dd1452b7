"""Settings are checked, commands are carried out and acknowledged, exceptions appear in the widget."""

from __future__ import annotations

import threading

import pytest
import traitlets
from browser_probe import Probe

from sfkit.errors import InputError


def tell(widget: Probe, command: str, sequence: int = 1, view: str = "v", **arguments: object) -> None:
    """What arrives when the front end sends a command."""
    message = {"command": command, "arguments": arguments, "view": view, "sequence": sequence}
    widget._receive(widget, message, [])


def test_an_unknown_setting_is_refused_with_the_nearest_name() -> None:
    with pytest.raises(InputError, match=r"unknown argument of Probe 'teme'.*did you mean 'theme'"):
        Probe(teme="dark")


@pytest.mark.parametrize("name", ["error", "acknowledged", "total", "_esm"])
def test_what_is_no_setting_cannot_be_given(name: str) -> None:
    with pytest.raises(InputError, match=f"unknown argument of Probe '{name}'"):
        Probe(**{name: "x"})


def test_settings_have_their_kind() -> None:
    assert Probe(theme="dark", start=3, layout={"width": "50%"}).total == 3
    with pytest.raises(traitlets.TraitError, match="theme"):
        Probe(theme="blue")


def test_a_command_is_carried_out_and_acknowledged() -> None:
    widget = Probe(start=1)
    tell(widget, "add", 4, number=2)
    assert widget.total == 3
    assert widget.acknowledged == {"v": 4}
    assert widget.error == ""


def test_an_error_appears_and_goes_with_the_next_command() -> None:
    widget = Probe()
    tell(widget, "add", 1, number=-1)
    assert widget.error == "number: found -1, expected at least 0"
    assert widget.acknowledged == {"v": 1}
    tell(widget, "add", 2, number=1)
    assert widget.error == ""


def test_an_unexpected_exception_names_its_kind_and_place() -> None:
    widget = Probe()
    tell(widget, "add", number=0)
    assert widget.error.startswith("ZeroDivisionError: ")
    assert "(browser_probe.py, line " in widget.error


@pytest.mark.parametrize("name", ["_receive", "close", "__init__", "ad", ""])
def test_only_commands_can_be_called(name: str) -> None:
    widget = Probe()
    tell(widget, name)
    assert widget.error.startswith(f"unknown command {name!r}, expected one of: add")


def test_arguments_must_fit() -> None:
    widget = Probe()
    tell(widget, "add", numbr=1)
    assert "command 'add'" in widget.error
    assert widget.error.endswith("expected number")
    assert widget.total == 0


def test_cells_may_call_commands_where_errors_raise() -> None:
    widget = Probe()
    with pytest.raises(InputError, match="found -1"):
        widget.add(-1)
    assert (widget.error, widget.acknowledged) == ("", {})


def test_a_command_of_a_cell_waits_for_the_widget() -> None:
    widget = Probe()
    with widget.changing():
        cell = threading.Thread(target=widget.add, args=(1,))
        cell.start()
        cell.join(0.2)
        assert widget.total == 0
    cell.join()
    assert widget.total == 1


def test_views_are_acknowledged_apart_and_old_ones_forgotten() -> None:
    widget = Probe()
    for number in range(40):
        tell(widget, "add", number + 1, view=f"view{number}", number=1)
    assert len(widget.acknowledged) == 16
    assert widget.acknowledged["view39"] == 40
    tell(widget, "add", 99, view="view30", number=1)
    assert list(widget.acknowledged)[-1] == "view30"


def test_commands_of_several_threads_do_not_mix() -> None:
    widget = Probe()
    threads = [
        threading.Thread(target=lambda v=str(v): [tell(widget, "add", n, v, number=1) for n in range(1, 51)])
        for v in range(4)
    ]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert widget.total == 200
    assert widget.acknowledged == {str(v): 50 for v in range(4)}


def test_reporting_shows_what_a_thread_raises() -> None:
    widget = Probe()
    with widget.reporting():
        raise InputError("the disk is full")
    assert widget.error == "the disk is full"
