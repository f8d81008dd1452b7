"""What all widgets share: a theme, checked settings, acknowledged commands, errors in sight."""

from __future__ import annotations

import threading
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

import anywidget
import traitlets

from sfkit.errors import ensure_known
from sfkit.figures import Theme
from sfkit_widgets._commands import call, sentence
from sfkit_widgets._sheet import Sheet
from sfkit_widgets._still import STILL, Still, publish

VIEWS_REMEMBERED = 16


class SfkitWidget(anywidget.AnyWidget):
    """Base of the widgets. State goes to the browser in traits, commands come from it in messages.

    A subclass sets ``_esm`` and ``_css`` (see :mod:`sfkit_widgets._assets`), marks methods with
    :func:`~sfkit_widgets._commands.command`, and hands its caller's further keyword arguments on as
    ``settings``. Traits hold all that is drawn, so that a saved notebook shows the last state without a
    kernel; numbers in them are finite or None, since JSON has no others.

    Commands run one at a time, in whatever thread Jupyter delivers messages; what they change reaches the
    browser in one message together with the acknowledgement. Any other thread that changes traits takes
    :meth:`reporting`.
    """

    theme = traitlets.Enum([entry.value for entry in Theme], default_value=Theme.AUTO.value).tag(
        sync=True, setting=True
    )
    """Colours of the page it stands on: ``"light"``, ``"dark"``, or ``"auto"`` to follow the host.

    - Type: `str`
    - Default: `"auto"`: JupyterLab's, Notebook's, VS Code's or Colab's theme, else the browser's.
    """

    error = traitlets.Unicode("").tag(sync=True)
    """What went wrong last, one sentence; shown at the top of the widget. Empty where nothing did.

    - Type: `str`
    - Default: `""`
    """

    still = traitlets.Unicode("").tag(sync=True)
    """Class of the picture that stands for the widget where it does not run; it hides this one.

    - Type: `str`
    """

    acknowledged = traitlets.Dict().tag(sync=True)
    """Number of the last command that was carried out (or refused), by the view that sent it.

    - Type: `dict[str, int]`, the latest 16 views
    - Default: `{}`
    """

    def __init__(self, settings: Mapping[str, Any] | None = None, /, **state: Any) -> None:
        """Check a caller's settings and show the state.

        Args:
            settings: keyword arguments of the caller: traits marked ``setting``, and ``layout``.
            state: first values of any trait.

        Raises:
            InputError: a setting of another name; the nearest is suggested.
            traitlets.TraitError: a value of the wrong kind.
        """
        settings = settings or {}
        self.refuse_unknown(settings)
        # Reentrant: a message holds it, and so does what a command calls.
        self._commanding = threading.RLock()
        super().__init__(**state, **settings)
        self._still = Still(self.model_id, self._picture)
        self.still = f"{STILL}-{self.model_id}"
        self.observe(lambda _: self._still.changed())
        self.on_msg(self._receive)

    def sheet(self) -> Sheet:
        """What the widget looks like on paper, for notebooks that are opened without a kernel."""
        return Sheet(type(self).__name__)

    def _picture(self) -> Sheet:
        with self._commanding:
            return self.sheet()

    def _ipython_display_(self, **_: object) -> None:
        """Two outputs: the widget, and its still."""
        data, metadata = self._repr_mimebundle_() or ({"text/plain": repr(self)}, {})
        publish(data, metadata)
        self._still.show()

    def close(self) -> None:
        """Leave the page; the still stays as it is."""
        # ipywidgets closes a widget whose making was refused, too.
        if still := getattr(self, "_still", None):
            still.close()
        super().close()

    def __repr__(self) -> str:
        """What stands where no widget can: plain, and the same in every run."""
        return f"{type(self).__name__}: a widget, drawn where the notebook is opened in Jupyter"

    @classmethod
    def refuse_unknown(cls, settings: Iterable[str], also: Iterable[str] = ()) -> None:
        """Refuse settings of other names than the class has, for one that must not begin with a wrong one.

        Args:
            settings: names a caller gave.
            also: names that are allowed beside the traits marked ``setting``, and ``layout``.

        Raises:
            InputError: the first unknown name; the nearest is suggested.
        """
        allowed = [*cls.class_trait_names(setting=True), "layout", *also]
        for name in settings:
            ensure_known(f"argument of {cls.__name__}", name, allowed)

    @contextmanager
    def changing(self) -> Iterator[None]:
        """Alone with the widget: changes reach the browser in one message when the block ends."""
        with self._commanding, self.hold_sync():
            yield

    @contextmanager
    def reporting(self) -> Iterator[None]:
        """As :meth:`changing`, but an exception goes no further and appears in the widget."""
        with self.changing():
            try:
                yield
            except Exception as error:  # whatever it is, the person in front of the widget must see it
                self.error = sentence(error)

    def report(self, error: BaseException) -> None:
        """Show an exception that was caught elsewhere, such as after long work outside of the lock."""
        with self.changing():
            self.error = sentence(error)

    def _receive(self, _widget: object, content: Any, _buffers: object) -> None:
        """Carry out one message of the front end: command, arguments, view and sequence number."""
        with self.changing():
            with self.reporting():
                self.error = ""
                call(self, content)
            # A refused command, too: the page waits for its answer.
            self._acknowledge(str(content["view"]), int(content["sequence"]))

    def _acknowledge(self, view: str, sequence: int) -> None:
        others = {name: number for name, number in self.acknowledged.items() if name != view}
        # Pages that were closed never say so: only the latest views are kept.
        kept = list(others.items())[-(VIEWS_REMEMBERED - 1) :]
        self.acknowledged = {**dict(kept), view: sequence}
