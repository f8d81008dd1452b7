"""JupyterLab and Notebook 7 for tests: a server on the loopback, and a notebook in a real browser."""

from __future__ import annotations

import json
import os
import secrets
import subprocess
import sys
import threading
import urllib.request
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import nbformat
from browser_stage import SETTLED
from nbformat.v4 import new_code_cell, new_notebook

if TYPE_CHECKING:
    from playwright.sync_api import Page

HERE = Path(__file__).parent
PATIENCE = 240.0  # s; the machine may be busy with other things, and nothing here measures time
FLAGS = (
    "--no-browser",
    "--allow-root",
    "--ip=127.0.0.1",
    "--ServerApp.port=0",
    "--expose-app-in-browser",
)
LAB_FLAGS = (
    "--LabApp.news_url=None",
    "--LabApp.check_for_updates_class=jupyterlab.NeverCheckForUpdate",
)
SETTINGS = {
    "@jupyterlab/apputils-extension/notification": {
        "fetchNews": "false",
        "checkForUpdates": False,
        "doNotDisturbMode": True,
    },
}
# jsonschema's optional grammars take seconds to build, in the server and in every kernel.
SITECUSTOMIZE = 'import sys\nsys.modules.setdefault("rfc3987_syntax", None)\n'


@dataclass(frozen=True)
class Server:
    """A running server.

    Attributes:
        url: of its front page, with a slash at the end.
        token: what requests carry.
        root: the folder of its notebooks.
    """

    url: str
    token: str
    root: Path

    def write(self, name: str, cells: Sequence[str]) -> Path:
        """A notebook of code cells, in the server's folder."""
        path = self.root / name
        path.parent.mkdir(parents=True, exist_ok=True)
        kernel = {"display_name": "Python 3", "language": "python", "name": "python3"}
        notebook = new_notebook(cells=[new_code_cell(cell) for cell in cells])
        notebook.metadata["kernelspec"] = kernel
        nbformat.write(notebook, path)
        return path

    def ask(self, path: str, method: str = "GET") -> Any:
        """What the server's REST interface says; None where it says nothing."""
        request = urllib.request.Request(
            f"{self.url}{path}", headers={"Authorization": f"token {self.token}"}, method=method
        )
        with urllib.request.urlopen(request, timeout=300) as answer:
            text = answer.read()
        return json.loads(text) if text else None

    def end_kernels(self) -> None:
        """Shut every kernel down, and forget the sessions."""
        for session in self.ask("api/sessions"):
            self.ask(f"api/sessions/{session['id']}", "DELETE")


@contextmanager
def serving(folder: Path, app: str) -> Iterator[Server]:
    """Run ``jupyterlab`` or ``notebook`` with everything it writes under ``folder``.

    Its settings and workspaces are its own; what is installed, it shares with this Python.
    """
    root, home = folder / "notebooks", folder / "home"
    places = {
        "HOME": home,
        "IPYTHONDIR": home / "ipython",
        "JUPYTER_CONFIG_DIR": home / "config",
        "JUPYTER_DATA_DIR": home / "data",
        "JUPYTER_RUNTIME_DIR": home / "runtime",
        "JUPYTERLAB_SETTINGS_DIR": home / "settings",
        "JUPYTERLAB_WORKSPACES_DIR": home / "workspaces",
    }
    for place in (root, *places.values()):
        place.mkdir(parents=True, exist_ok=True)
    (home / "sitecustomize.py").write_text(SITECUSTOMIZE, encoding="utf-8")
    for plugin, values in SETTINGS.items() if app == "jupyterlab" else ():
        file = home / f"settings/{plugin}.jupyterlab-settings"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(json.dumps(values), encoding="utf-8")
    token = secrets.token_hex(16)
    options = [f"--IdentityProvider.token={token}", f"--ServerApp.root_dir={root}"]
    command = [sys.executable, "-m", app, *FLAGS, *(LAB_FLAGS if app == "jupyterlab" else ()), *options]
    environment = {
        **os.environ,
        **{name: str(place) for name, place in places.items()},
        "PYTHONPATH": os.pathsep.join([str(home), str(HERE), str(HERE.parent)]),
        "PYTHONWARNINGS": "default",
        "OMP_NUM_THREADS": "1",
    }
    with (
        (folder / "server.log").open("wb") as log,
        subprocess.Popen(command, cwd=root, env=environment, stdout=log, stderr=log) as process,
    ):
        try:
            yield Server(_address(home / "runtime", process, folder / "server.log"), token, root)
        finally:
            process.terminate()
            process.wait(timeout=300)


def _address(runtime: Path, process: subprocess.Popen[bytes], log: Path) -> str:
    """The server's address, from the file it writes once it listens."""
    waiting = threading.Event()
    for _ in range(round(PATIENCE / 0.2)):
        for file in runtime.glob("jpserver-*.json"):
            text = file.read_text(encoding="utf-8")
            if text.endswith("}"):
                return str(json.loads(text)["url"])
        if process.poll() is not None:
            break
        waiting.wait(0.2)
    raise RuntimeError(f"the server did not start:\n{log.read_text(encoding='utf-8', errors='replace')}")


class Notebook:
    """A notebook that is open in a browser.

    Attributes:
        page: Playwright's page.
        server: where it comes from.
        path: its file, relative to the server's folder.
    """

    def __init__(self, page: Page, server: Server, path: str, app: str) -> None:
        self.page, self.server, self.path = page, server, path
        page.set_default_timeout(PATIENCE * 1000)
        # A workspace of its own: a shared one brings the other pages' notebooks back as well.
        workspace = f"lab/workspaces/auto-{Path(path).stem}"
        place = f"{workspace}/tree/{path}" if app == "jupyterlab" else f"notebooks/{path}"
        page.goto(f"{server.url}{place}?token={server.token}&reset")
        self.ready()

    def ready(self) -> None:
        """Wait until the notebook is there and its kernel is idle."""
        self._again(self._idle)

    def _idle(self, patience: float) -> None:
        kernel = "window.jupyterapp?.shell.currentWidget?.sessionContext?.session?.kernel"
        self.page.wait_for_selector(".jp-NotebookPanel .jp-Notebook, .jp-Notebook", timeout=patience)
        self.page.wait_for_function(f"() => {kernel}?.status === 'idle'", timeout=patience)

    def _again(self, wait: Callable[[float], None]) -> None:
        """Wait for what a page can lose for good on a busy machine; load it again then, as a reader would.

        A kernel whose first answer is lost stays "starting" until the page is loaded again; what else, see
        ``back``.
        """
        from playwright.sync_api import TimeoutError as NotShown

        for share in (4, 4):
            try:
                wait(PATIENCE * 1000 / share)
                return
            except NotShown:
                self.page.reload()
        wait(PATIENCE * 1000)

    def command(self, name: str, **arguments: object) -> None:
        """Have the application do something by its command, as a menu would."""
        self.page.evaluate(
            "([name, given]) => window.jupyterapp.commands.execute(name, given)", [name, arguments]
        )

    def run_all(self) -> None:
        """Run all cells, and wait until the last one is done; a cell that raises fails the test."""
        self.page.evaluate("() => void window.jupyterapp.commands.execute('notebook:run-all-cells')")
        self.page.wait_for_function(
            """() => {
                const { content } = window.jupyterapp.shell.currentWidget;
                return content.widgets.every((cell) => cell.model.executionState !== "running"
                    && (cell.model.type !== "code" || cell.model.executionCount > 0));
            }"""
        )
        kinds = ("stderr", "error")
        wrong = ", ".join(f"[data-mime-type='application/vnd.jupyter.{kind}']" for kind in kinds)
        errors = self.page.locator(f".jp-Notebook :is({wrong})")
        assert errors.all_inner_texts() == []

    def theme(self, name: str) -> None:
        """Change to another theme, such as ``JupyterLab Dark``."""
        self.command("apputils:change-theme", theme=name)
        self.page.wait_for_function(f"() => document.body.dataset.jpThemeName === {json.dumps(name)}")
        # JupyterLab stumbles over a second change while it takes away the curtain of the first.
        self.page.wait_for_selector("#jupyterlab-splash", state="detached")

    def save(self) -> Path:
        """Save the notebook with its widgets; the file."""
        self.command("docmanager:save")
        self.page.wait_for_function("() => !window.jupyterapp.shell.currentWidget.context.model.dirty")
        return self.server.root / self.path

    def still_says(self, text: str) -> None:
        """Wait until the notebook's first still, hidden beside its widget, has a text."""
        script = """(text) => {
            const still = document.querySelector(".sfkit-still img");
            const bytes = Uint8Array.from(atob(still?.src.split(",")[1] ?? ""), (c) => c.charCodeAt(0));
            return getComputedStyle(still.parentElement).display === "none"
                && new TextDecoder().decode(bytes).includes(`>${text}<`);
        }"""
        self.page.wait_for_function(script, arg=text)

    def settled(self) -> None:
        """Wait until every command of the widget was acknowledged by the kernel."""
        self.page.wait_for_function(SETTLED)

    def run_cell(self, number: int) -> None:
        """Run one cell, and do not wait for it."""
        self.page.evaluate(
            """(n) => {
                window.jupyterapp.shell.currentWidget.content.activeCellIndex = n;
                void window.jupyterapp.commands.execute("notebook:run-cell");
            }""",
            number,
        )

    def ran(self, number: int) -> None:
        """Wait until a cell has been run and is done."""
        self.page.wait_for_function(
            """(n) => {
                const { model } = window.jupyterapp.shell.currentWidget.content.widgets[n];
                return model.executionState !== "running" && model.executionCount > 0;
            }""",
            arg=number,
        )

    def reload(self) -> None:
        """Load the page again, as a reader would, until the widget is back; the kernel lives on."""
        self.page.reload()
        self.back()

    def back(self) -> None:
        """Wait until the widget of a page that was loaded beside a living kernel is back.

        JupyterLab's manager of widgets asks the kernel for them after a load, twice at once, and gives it
        four seconds, and says nothing where that fails: nothing comes then, however long one waits.
        """
        self._again(self._widget)

    def _widget(self, patience: float) -> None:
        self._idle(patience)
        self.page.wait_for_selector(".sfkit", timeout=patience)

    def evaluate(self, expression: str) -> Any:
        """The value of a Python expression in the notebook's kernel, through JSON; cells stay as they are."""
        script = """async (code) => {
            const { kernel } = window.jupyterapp.shell.currentWidget.sessionContext.session;
            const future = kernel.requestExecute({ code, silent: false, store_history: false });
            const said = [];
            future.onIOPub = ({ header, content }) => {
                if (header.msg_type === "stream") said.push(content.text);
                if (header.msg_type === "error") said.push(content.traceback.join("\\n"));
            };
            const reply = await future.done;
            return [reply.content.status, said.join("")];
        }"""
        code = f"import json; print(json.dumps({expression}), end='')"
        status, said = self.page.evaluate(script, code)
        assert status == "ok", said
        return json.loads(said)
