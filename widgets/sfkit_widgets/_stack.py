"""Widgets one below the other, with one still for all."""

from __future__ import annotations

from collections.abc import Iterable

import ipywidgets

from sfkit_widgets._base import SfkitWidget
from sfkit_widgets._sheet import Sheet
from sfkit_widgets._still import STILL, Still, publish


class WidgetStack(ipywidgets.VBox):  # type: ignore[misc]  # ipywidgets has no types
    """Several widgets as one.

    Args:
        title: of the still.
        parts: those that are there from the start.
        above: what stands over them, if anything.
    """

    def __init__(
        self, title: str, parts: Iterable[SfkitWidget] = (), *, above: Iterable[ipywidgets.Widget] = ()
    ) -> None:
        self._title = title
        self._above = tuple(above)
        self._parts: tuple[SfkitWidget, ...] = ()
        super().__init__(children=self._above)
        self._still = Still(self.model_id, self.sheet)
        self.arrange(parts)

    @property
    def parts(self) -> tuple[SfkitWidget, ...]:
        """The widgets, from the top."""
        return self._parts

    def arrange(self, parts: Iterable[SfkitWidget]) -> None:
        """Show these widgets."""
        self._parts = tuple(parts)
        for part in self._parts:
            part.still = f"{STILL}-{self.model_id}"  # they hide the one picture of all
            part.observe(lambda _: self._still.changed())
        self.children = (*self._above, *self._parts)
        self._still.changed()

    def sheet(self) -> Sheet:
        """The parts one below the other, for notebooks that are opened without a kernel."""
        sheet = Sheet(self._title)
        for part in self._parts:
            sheet.add(part.sheet())
        return sheet

    def _ipython_display_(self, **_: object) -> None:
        """Two outputs: the widgets, and their still."""
        publish(self._repr_mimebundle_())
        self._still.show()

    def close(self) -> None:
        """Take it away, with all in it."""
        if still := getattr(self, "_still", None):
            still.close()
        for child in self.children:
            child.close()
        super().close()
