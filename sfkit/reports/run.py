"""Run a notebook and write its report."""

from __future__ import annotations

import logging
import os
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from datetime import datetime
from pathlib import Path
from typing import Any

import nbformat
import papermill
from papermill.exceptions import PapermillExecutionError

from sfkit.errors import InputError, SfkitError
from sfkit.files import ensure_writable, write_text
from sfkit.reports.browsers import check_pictures
from sfkit.reports.kernel import ThisInterpreter, Watcher
from sfkit.reports.page import Failure, NotebookRun, render_page
from sfkit.reports.parameters import check_parameters, parameter_defaults, read_notebook
from sfkit.reports.pictures import write_pictures


class ReportError(SfkitError):
    """A notebook's run failed; the report was written all the same.

    Attributes:
        report: the HTML file that shows the failing cell and its error.
    """

    def __init__(self, message: str, report: Path) -> None:
        super().__init__(message)
        self.report = report


def report(
    notebook: str | os.PathLike[str],
    parameters: Mapping[str, Any],
    out: str | os.PathLike[str],
    *,
    progress: Callable[[str], None] | None = None,
    figures: str | None = None,
) -> Path:
    """Run a notebook with papermill and write one HTML file that needs no network.

    The kernel is the running interpreter, whatever kernels are registered; its working folder is the
    caller's. The executed notebook is written beside the HTML file, with the suffix ``.ipynb``, and missing
    parent folders are made.

    Args:
        notebook: the ``.ipynb`` to run; it is not changed.
        parameters: name -> value for names that its cell tagged ``parameters`` assigns: strings, numbers,
            booleans, None, paths, and lists and dicts of those.
        out: the ``.html`` file to write.
        progress: told one plain line a cell, and the lines that cells print.
        figures: ``"svg"`` or ``"png"`` also writes every figure as a file of its own, into the folder
            ``NAME_figures`` beside ``NAME.html``; this needs an installed Chromium.

    Returns:
        The path of the HTML file.

    Raises:
        InputError: before anything is run or written: the notebook cannot be read, a parameter is unknown or
            of another kind than its default, ``out`` is no place for a report, or ``figures`` is another
            word or asks for a Chromium that is not there.
        ReportError: a cell failed or the kernel died; the report shows where.
        KeyboardInterrupt: the run was interrupted; the report shows where too.
    """
    source, page = Path(notebook), Path(out)
    content = read_notebook(source)
    values = check_parameters(source, parameter_defaults(source, content), parameters)
    _check_target(source, page)
    if figures is not None:
        check_pictures(figures)

    page.parent.mkdir(parents=True, exist_ok=True)
    executed = page.with_suffix(".ipynb")
    code_cells = sum(cell.cell_type == "code" for cell in content.cells)
    watcher = Watcher(code_cells, progress or (lambda _line: None))
    started, clock = datetime.now().astimezone(), time.monotonic()
    with tempfile.TemporaryDirectory(prefix="sfkit-report-") as scratch:
        # papermill writes after every cell, and what it is killed over would be in the way of the next run.
        running = Path(scratch) / "running.ipynb"
        failure = _execute(source, running, values, watcher)
        run = NotebookRun(source.name, started, time.monotonic() - clock, values, failure)
        result = nbformat.read(running, as_version=4)
        write_text(executed, running.read_text(encoding="utf-8"))
    write_text(page, render_page(result, run))
    if figures is not None:
        write_pictures(result, page.with_name(f"{page.stem}_figures"), figures)
    # The page is written all the same; then the interrupt goes on its way.
    if failure is not None and failure.error.startswith(KeyboardInterrupt.__name__):
        raise KeyboardInterrupt
    if failure is not None:
        place = f"cell {watcher.number} of {code_cells}" if watcher.number else "the kernel"
        raise ReportError(f"{source}: {place} failed with {failure.error}; {page} shows it", page)
    return page


def _check_target(source: Path, page: Path) -> None:
    """Refuse a place that cannot be written, or where something the user made would be lost."""
    if page.suffix != ".html":
        raise InputError(f"{page}: found the ending {page.suffix!r}, expected a report that ends in .html")
    if page.is_dir():
        raise InputError(f"{page}: found a folder, expected the name of the HTML file to write")
    ensure_writable(page.parent, page, "choose another place")
    executed = page.with_suffix(".ipynb")
    if executed.exists() and (executed.samefile(source) or not _written_by_papermill(executed)):
        raise InputError(
            f"{page}: the executed notebook would overwrite {executed}, which no report wrote, "
            "choose another name or folder"
        )


def _written_by_papermill(notebook: Path) -> bool:
    # An empty file holds nothing to lose.
    return not notebook.stat().st_size or "papermill" in read_notebook(notebook).metadata


@contextmanager
def _parameters_already_checked() -> Iterator[None]:
    """Papermill warns of every parameter that its pattern for assignments does not recognise."""
    log = logging.getLogger("papermill")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)


@_parameters_already_checked()
def _execute(source: Path, executed: Path, values: dict[str, Any], watcher: Watcher) -> Failure | None:
    """Run the notebook, leave it at ``executed`` whatever happens, and say what failed."""
    try:
        papermill.execute_notebook(
            # papermill fills braces in paths with parameters; doubled, they stay what they are.
            *(str(path).replace("{", "{{").replace("}", "}}") for path in (source, executed)),
            values,
            kernel_name="python3",
            language="python",
            kernel_manager_class=ThisInterpreter,
            progress_bar=False,
            stdout_file=watcher,
            stderr_file=watcher,
            on_cell_execute=watcher.begin,
        )
    except PapermillExecutionError as error:
        return Failure(watcher.index, _one_line(error.ename, error.evalue))
    except (RuntimeError, TimeoutError, OSError, KeyboardInterrupt) as error:
        # nbclient raises the first three where the kernel dies or never starts.
        return Failure(watcher.index, _one_line(type(error).__name__, error))
    return None


def _one_line(kind: str, message: object) -> str:
    """The error as the rest of a sentence; the page's traceback has the rest of its text."""
    return f"{kind}: {str(message).partition(chr(10))[0]}".rstrip(": .")
