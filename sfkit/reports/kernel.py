"""The kernel a report runs in: the running interpreter, told that nobody watches; and who listens to it."""

from __future__ import annotations

import sys
from collections.abc import Callable

import zmq
from jupyter_client.kernelspec import KernelSpec, KernelSpecManager
from jupyter_client.manager import AsyncKernelManager
from nbformat import NotebookNode
from traitlets import default

# What a notebook finds in its environment. Figures stay data, which the page draws. Bars would fill the page
# with half-drawn lines, so tqdm is off, and SFKIT_HEADLESS tells progress code to print plain lines instead.
ENVIRONMENT = {
    "PLOTLY_RENDERER": "plotly_mimetype",
    "PYDEVD_DISABLE_FILE_VALIDATION": "1",
    "SFKIT_HEADLESS": "1",
    "TQDM_DISABLE": "1",
}


class _OwnKernel(KernelSpecManager):
    """Knows one kernel: this interpreter."""

    def get_kernel_spec(self, kernel_name: str) -> KernelSpec:
        """How to start it, whatever name is asked for; no module of the working folder is run (-P)."""
        # -P: a json.py beside the notebook must not be taken for Python's own.
        start = [sys.executable, "-P", "-m", "ipykernel_launcher", "-f", "{connection_file}"]
        return KernelSpec(
            argv=start,
            language="python",
            display_name="Python",
            env=dict(ENVIRONMENT),
            metadata={"supported_encryption": "curve"},
        )


class ThisInterpreter(AsyncKernelManager):
    """Starts the running interpreter: a registered ``python3`` may be another environment's."""

    @default("kernel_spec_manager")
    def _own_kernel(self) -> KernelSpecManager:
        return _OwnKernel(parent=self)

    @default("transport_encryption")
    def _encrypted(self) -> str:
        """Otherwise the kernel warns that other users of this machine could read what it sends."""
        return "auto" if zmq.has("curve") else "disabled"


class Watcher:
    """Knows which cell runs, and passes on what cells print, line by line; papermill's output file.

    Attributes:
        index: position of the running cell among all cells, None before the first.
        number: the same among the author's code cells, from 1; 0 before the first.
    """

    def __init__(self, cells: int, progress: Callable[[str], None]) -> None:
        self.index: int | None = None
        self.number = 0
        self._cells = cells
        self._progress = progress
        self._partial = ""

    def begin(self, *, cell: NotebookNode, cell_index: int) -> None:
        """A code cell starts; the one papermill puts in for the parameters is not counted."""
        if self._partial:
            self.write("\n")
        self.index = cell_index
        if "injected-parameters" in cell.metadata.get("tags", []):
            return
        self.number += 1
        first = next((line.strip() for line in cell.source.splitlines() if line.strip()), "")
        self._progress(f"cell {self.number} of {self._cells}: {first}")

    def write(self, text: str) -> None:
        """Text as it comes from the kernel, in any portions."""
        *lines, self._partial = (self._partial + text).split("\n")
        for line in lines:
            self._progress(f"    {line}")

    def flush(self) -> None:
        """Nothing waits but an unfinished line, which :meth:`begin` ends."""
