"""Groups of options: a record of settings becomes options of a command, and comes back as a record.

A command names the records it wants, and its options follow from their fields::

    @grouped
    def search(stage1: Annotated[SubsetSettings, STAGE1], compute: Annotated[Compute, COMPUTE]) -> None: ...

An option that two records have is one option. Values may also come from a TOML file (``--config``), under
the names of options; options win.
"""

from __future__ import annotations

import functools
import inspect
import re
from collections.abc import Callable, Container, Mapping
from dataclasses import MISSING, dataclass, field, fields, replace
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any, TypeVar, get_args, get_type_hints

import typer
import typer.core

from sfkit.cli.config import read_config
from sfkit.cli.values import Typed
from sfkit.errors import InputError
from sfkit.settings import Setting, setting_of

Answer = TypeVar("Answer")  # an exit code, or None

NAMES, SIZE = tuple[str, ...], tuple[int, int] | None
"""Types of fields that the command line takes as one text: ``a,b``, and ``256x512`` or ``none``."""

_SIZE = re.compile(r"(\d{1,5})x(\d{1,5})")


@dataclass(frozen=True)
class Group:
    """A record of settings as options.

    Attributes:
        record: the dataclass; those of its fields that are settings become options.
        panel: the heading of these options in ``--help``.
        make: makes the record of its fields' values; the dataclass itself unless given.
        only: the fields to offer; all unless given.
        defaults: field -> default, where commands have another one than the record; None where it depends.
        notes: field -> what to add to its help.
        said: whether ``make`` gets only what was said, on the command line or in a file, though it be what
            help calls the default.
    """

    record: type[Any]
    panel: str
    make: Callable[..., Any] | None = None
    only: tuple[str, ...] = ()
    defaults: Mapping[str, Any] = field(default_factory=dict)
    notes: Mapping[str, str] = field(default_factory=dict)
    said: bool = False

    def options(self) -> dict[str, inspect.Parameter]:
        """Field -> the parameter that typer makes an option of."""
        types, found = get_type_hints(self.record), {}
        for entry in fields(self.record):
            declared = setting_of(entry)
            if declared is not None and (not self.only or entry.name in self.only):
                default = self.defaults.get(entry.name, entry.default)
                declared = replace(
                    declared, help=" ".join(filter(None, (declared.help, self.notes.get(entry.name))))
                )
                found[entry.name] = _option(entry.name, types[entry.name], default, declared, self.panel)
        return found

    def collect(self, values: Mapping[str, Any], said: Container[str]) -> Any:
        """The record, from the values of all options of a command by parameter, of which some were said."""
        types = get_type_hints(self.record)
        own = {}
        for name, option in self.options().items():
            if self.said and option.name not in said:
                continue
            value = values[option.name]
            if types[name] == NAMES:
                value = names(value or "")
            elif types[name] == SIZE:
                value = _size_or_none(option.name, value)
            own[name] = value
        return (self.make or self.record)(**own)

    def flag(self, name: str, value: Any) -> str:
        """How a value of a field is said on the command line, such as ``--no-fan`` for False."""
        entry = next(entry for entry in fields(self.record) if entry.name == name)
        declared = setting_of(entry)
        own = () if declared is None else declared.flags
        flags = _flags(name, self.defaults.get(name, entry.default), own)
        on, _, off = _long(flags).partition("/")
        return off if off and value is False else on

    def spread(self, record: Any) -> dict[str, Any]:
        """The other way: what the options would have to say for that record, by parameter."""
        types, parameters = get_type_hints(self.record), self.options()
        given = {parameters[name].name: _as_option(types[name], getattr(record, name)) for name in parameters}
        return {name: value for name, value in given.items() if value is not None}


def grouped(command: Callable[..., Answer]) -> Callable[..., Answer]:
    """The command as typer takes it: options of its groups in place of records, and ``--config``.

    Parameters without a group stay as they are.
    """
    hints = get_type_hints(command, include_extras=True)
    groups: dict[str, Group] = {}
    options: dict[str, inspect.Parameter] = {}
    for name, parameter in inspect.signature(command).parameters.items():
        group = next((told for told in get_args(hints[name])[1:] if isinstance(told, Group)), None)
        if group is None:
            options[name] = _keyword(name, hints[name], parameter.default)
        else:
            groups[name] = group
            for option in group.options().values():
                # An option that two records have is the first one's.
                options.setdefault(option.name, option)
    plain = [name for name in options if name in inspect.signature(command).parameters]
    options["config"] = _config_option({name: option.annotation for name, option in options.items()})
    # Typer fills it in by its type: it knows which options were said.
    options["context"] = _keyword("context", typer.Context, inspect.Parameter.empty)

    @functools.wraps(command)
    def run(context: typer.Context, **values: Any) -> Answer:
        said = {name for name in values if _said(context, name)}
        records = {name: group.collect(values, said) for name, group in groups.items()}
        return command(**{name: values[name] for name in plain}, **records)

    # What typer looks at in place of the command's own.
    run.__signature__ = inspect.Signature(list(options.values()))  # type: ignore[attr-defined]
    run.__annotations__ = {name: option.annotation for name, option in options.items()}
    return run


def _said(context: typer.Context, parameter: str) -> bool:
    """Whether a parameter's value was given, be it the default."""
    source = context.get_parameter_source(parameter)
    return source is not None and source.name != "DEFAULT"


class PlainHelp:
    """A command that reads what was typed by :mod:`sfkit.cli.values`, not by pydantic."""

    def parse_args(self, ctx: Any, args: list[str]) -> Any:
        """The rest of the words, the parameters' values in ``ctx``."""
        for parameter in self.get_params(ctx):  # type: ignore[attr-defined]
            ask = getattr(parameter, "get_runtime_param", None)
            # Once: a command may be parsed again in the same process.
            if ask is not None and not isinstance(ask, functools.partial):
                parameter.get_runtime_param = functools.partial(Typed, ask)
        return super().parse_args(ctx, args)  # type: ignore[misc]

    def get_help_option(self, ctx: Any) -> Any:
        """The option, with a default."""
        option = super().get_help_option(ctx)  # type: ignore[misc]
        if option is not None:
            option.default = False
        return option


class Command(PlainHelp, typer.core.TyperCommand):
    """A command that takes each option once, unless it is made to add up: else the last would win unseen."""

    def make_parser(self, ctx: Any) -> Any:
        """The parser, which refuses what was said twice."""
        parser: Any = super().make_parser(ctx)
        parse = parser.parse_args

        def once(args: list[str]) -> Any:
            values, rest, order = parse(args)
            options = [p for p in order if isinstance(p, typer.core.TyperOption)]
            # Flags mean the same however often they are said, and multiple options add up.
            single = [p for p in options if not (p.multiple or p.is_flag or p.count)]
            for option in single:
                if single.count(option) > 1:
                    flag = max(option.opts, key=len)
                    raise InputError(f"{flag}: found it {single.count(option)} times, expected it once")
            return values, rest, order

        parser.parse_args = once
        return parser


class PanelCommand(Command):
    """A command whose ``--help`` shows options under the headings of their groups."""

    def format_options(self, ctx: Any, formatter: Any) -> None:
        """Arguments, then each panel, then all other options."""
        sections: dict[str, list[tuple[str, str]]] = {"Arguments": []}
        other: list[tuple[str, str]] = []
        for parameter in self.get_params(ctx):
            record = parameter.get_help_record(ctx)
            panel = getattr(parameter, "rich_help_panel", None)
            if record is not None and parameter.param_type_name == "argument":
                sections["Arguments"].append(record)
            elif record is not None:
                (sections.setdefault(panel, []) if panel else other).append(record)
        for heading, records in {**sections, "Options": other}.items():
            if records:
                with formatter.section(heading):
                    formatter.write_dl(records)


def sub_commands() -> typer.Typer:
    """A command that has sub-commands; its help is that of the list of commands."""
    return typer.Typer(cls=WholeHelp, no_args_is_help=True, rich_markup_mode=None)


class WholeHelp(PlainHelp, typer.core.TyperGroup):
    """A command with sub-commands, whose first sentences ``--help`` does not cut."""

    def summaries(self, ctx: Any) -> list[tuple[str, str]]:
        """Sub-command -> the first paragraph of its help, in order."""
        commands = [(name, self.get_command(ctx, name)) for name in self.list_commands(ctx)]
        return [(name, first_paragraph(found.help or "")) for name, found in commands if found is not None]

    def format_commands(self, ctx: Any, formatter: Any) -> None:
        """The list of sub-commands, wrapped to the terminal."""
        with formatter.section("Commands"):
            formatter.write_dl(self.summaries(ctx))


def first_paragraph(text: str) -> str:
    """On one line."""
    return " ".join(text.strip().partition("\n\n")[0].split())


def names(text: str) -> tuple[str, ...]:
    """``"a, b"`` -> ``("a", "b")``."""
    return tuple(name.strip() for name in text.split(",") if name.strip())


def size_of(text: str) -> tuple[int, int] | None:
    """``"384x1248"`` -> ``(384, 1248)``; None for anything else."""
    match = _SIZE.fullmatch(text)
    return None if match is None else (int(match[1]), int(match[2]))


def _size_or_none(parameter: str, text: str) -> tuple[int, int] | None:
    size = None if text == "none" else size_of(text)
    if size is None and text != "none":
        raise InputError(
            f"--{parameter} is {text!r}, expected height x width in pixels, such as 256x512, or none"
        )
    return size


def _as_option(kind: Any, value: Any) -> Any:
    """A field's value as its option has it."""
    if kind == SIZE:
        return "none" if value is None else "{}x{}".format(*value)
    return (",".join(value) or None) if kind == NAMES else value


def _option(name: str, kind: Any, default: Any, declared: Setting, panel: str) -> inspect.Parameter:
    flags = _flags(name, default, declared.flags)
    parameter = _long(flags).partition("/")[0].removeprefix("--").replace("-", "_")
    told = typer.Option(*flags, help=declared.help, rich_help_panel=panel)
    if default is None and isinstance(kind, type):
        kind = kind | None
    default = default if default is MISSING else _as_option(kind, default)
    if kind == NAMES:
        kind = str | None
    elif kind == SIZE or (isinstance(kind, type) and issubclass(kind, StrEnum)):
        kind = str  # the record refuses what is none of its words
    default = inspect.Parameter.empty if default is MISSING else default
    return _keyword(parameter, Annotated[kind, told], default)


def _flags(name: str, default: Any, own: tuple[str, ...]) -> tuple[str, ...]:
    """A field's own flags, or one of its name."""
    plain = f"--{name.replace('_', '-')}"
    # What is on unless told otherwise needs a word that turns it off.
    return own or ((f"{plain}/--no-{plain[2:]}",) if default is True else (plain,))


def _long(flags: tuple[str, ...]) -> str:
    return next(flag for flag in flags if flag.startswith("--"))


def _config_option(types: Mapping[str, Any]) -> inspect.Parameter:
    def read(context: typer.Context, value: Path | None) -> Path | None:
        if value is not None:
            # Another file may have said something: that of settings.
            context.default_map = {**(context.default_map or {}), **read_config(value, context, types)}
        return value

    told = typer.Option(
        "--config",
        help="A TOML file of options by their names, such as seed = 1; what is given here wins.",
        is_eager=True,  # the file is read before other options ask for their defaults
        callback=read,
    )
    return _keyword("config", Annotated[Path | None, told], None)


def _keyword(name: str, annotation: Any, default: Any) -> inspect.Parameter:
    """A parameter that may follow one with a default."""
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)
