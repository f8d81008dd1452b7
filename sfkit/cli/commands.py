"""The commands by name. A command's module is imported when it is called: ``--help`` needs none of them."""

from __future__ import annotations

import importlib
from collections.abc import Iterator, MutableMapping
from dataclasses import dataclass
from typing import Any

import typer
import typer.core
import typer.main

from sfkit.cli.groups import Command, PanelCommand, WholeHelp, grouped


@dataclass(frozen=True)
class Entry:
    """Where a command is.

    Attributes:
        help: the first sentence of its help.
        function: its name in the module that is called as the command; None where ``app`` holds several.
    """

    help: str
    function: str | None = None

    def load(self, name: str) -> Any:
        """The command, its module imported."""
        module = importlib.import_module(f"sfkit.cli.{name}")
        if self.function is None:
            module.app.info.help = self.help
            _strict(module.app)
            return typer.main.get_group(module.app)
        # An application of one command, of which typer makes a command of click's.
        alone = typer.Typer(add_completion=False, rich_markup_mode=None)
        alone.command(name, cls=PanelCommand)(grouped(getattr(module, self.function)))
        _strict(alone)
        return typer.main.get_command(alone)


def _strict(commands: typer.Typer) -> None:
    """Let every command refuse an option that is said twice."""
    for one in commands.registered_commands:
        if one.cls is None or not issubclass(one.cls, Command):
            one.cls = Command
    for group in commands.registered_groups:
        if group.typer_instance is not None:
            _strict(group.typer_instance)


ENTRIES = {
    "demo": Entry(
        "Search the embedded bank of 12 small trained networks, and test what was found.",
        "demo",
    ),
    "search": Entry(
        "Search Stage 1 (which sources) and Stage 2 (how), write the merged network, and say what to deploy.",
        "search",
    ),
    "finetune": Entry("Fine-tune a checkpoint on one training set.", "command"),
    "init": Entry(
        "Write a commented pool.toml: the architecture by the keys, "
        "the base as what all others are nearest to.",
        "init",
    ),
    "check": Entry(
        "Call the network once and say what is wrong; with a benchmark, "
        "score the midpoints between checkpoints.",
        "check",
    ),
    "merge": Entry("Write one merged network, in the key names of the original checkpoints.", "merge"),
    "evaluate": Entry("Score networks merged from a pool; lower is better.", "evaluate"),
    "compare": Entry(
        "Say whether network B is better than A on a benchmark: the difference with its interval over pairs.",
        "compare",
    ),
    "baselines": Entry(
        "Run the baselines on a validation benchmark: what each chose, scores there, and cost.",
        "baselines",
    ),
    "predict": Entry(
        "Write the disparity of each pair and pictures of it; depth and points where the cameras are known.",
        "predict",
    ),
    "export": Entry(
        "Write a network as ONNX, torch.export, TorchScript or a plain checkpoint, checked on a pair.",
        "export",
    ),
    "show": Entry("Print what a file is and how it was made.", "show"),
    "report": Entry(
        "Run a notebook from top to bottom and write it as one HTML file that needs no network.", "report"
    ),
    "open": Entry(
        "Copy a notebook that comes with sfkit and open it in JupyterLab; a copy that is there is kept.",
        "open_notebook",
    ),
    "data": Entry("Look at data sets."),
    "factory": Entry("From data sets to sources to one network."),
    "bank": Entry("The embedded bank of trained networks."),
    "runs": Entry("See what searches did; move evaluations."),
    "cache": Entry("See and clear cached task vectors."),
}


class _OnDemand(MutableMapping[str, Any]):
    """Name -> command, in the order of help; loaded when it is asked for, and kept."""

    def __init__(self) -> None:
        self._loaded: dict[str, Any] = {}

    def __getitem__(self, name: str) -> Any:
        if name not in self._loaded:
            self._loaded[name] = ENTRIES[name].load(name)
        return self._loaded[name]

    def __setitem__(self, name: str, command: Any) -> None:
        self._loaded[name] = command

    def __delitem__(self, name: str) -> None:
        del self._loaded[name]

    def __iter__(self) -> Iterator[str]:
        return iter(ENTRIES)

    def __len__(self) -> int:
        return len(ENTRIES)


class Commands(WholeHelp):
    """``sfkit`` itself."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(**settings)
        self.commands = _OnDemand()

    def summaries(self, ctx: Any) -> list[tuple[str, str]]:
        """Names and first sentences, of which no module is needed."""
        return [(name, entry.help) for name, entry in ENTRIES.items()]
