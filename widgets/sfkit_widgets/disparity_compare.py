"""DisparityCompare: what several networks see on one pair, side by side, under one cursor and one zoom."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import traitlets

from sfkit.analysis.disparities import Comparison, Network
from sfkit.datasets.benchmark import Benchmark
from sfkit.errors import InputError, ensure_known
from sfkit.evaluation.compute import HERE, Compute
from sfkit.merging.pool import Pool
from sfkit_widgets._assets import script, style
from sfkit_widgets._base import SfkitWidget
from sfkit_widgets._commands import command
from sfkit_widgets._compare_scene import palettes, scene
from sfkit_widgets._compare_still import compare_sheet
from sfkit_widgets._sheet import Sheet

ARRANGEMENTS = ("side by side", "swipe", "blink")
SHOWN = ("disparity", "error", "better")


class DisparityCompare(SfkitWidget):
    """Compare networks on the pairs of a benchmark.

    Errors change colour at the threshold of the benchmark's metric; ``better`` colours where a network is
    nearer to the ground truth than network ``first``. Pixels without ground truth that counts are hatched.

    Args:
        pool: the recipes' pool.
        networks: name -> recipe, or network opened by :func:`sfkit.load`; at least one.
        benchmark: gives pairs, protocol and metric.
        pair: which pair to show first; the first one unless given.
        metrics: scores to show, such as ``"bad-1.0"``; the benchmark's own unless given.
        compute: where and how recipes run, in this process.
        settings: ``arrangement``, ``shown``, ``first``, ``second``, ``limits``, ``theme``, ``layout``.

    Raises:
        InputError: no network, an unknown pair, metric or setting, or a pair that cannot be scored.

    Example::

        DisparityCompare(pool, {"base": pool.base_recipe(), "merged": merged}, benchmark, shown="error")
    """

    _esm = script("disparity_compare.js")
    _css = style("disparity_compare.css")

    scene = traitlets.Dict().tag(sync=True)
    """The pair that is shown, with every network's disparity map; see ``_compare_scene``."""

    palettes = traitlets.Dict().tag(sync=True)
    """The figures' colour maps."""

    pairs = traitlets.List(traitlets.Unicode()).tag(sync=True)
    """Ids of the pairs to choose from. - Type: `list[str]`"""

    arrangement = traitlets.Enum(ARRANGEMENTS, ARRANGEMENTS[0]).tag(sync=True, setting=True)
    """How networks stand together: all ``"side by side"``, or two as ``"swipe"`` or ``"blink"``.

    - Type: `str`
    - Default: `"side by side"`
    """

    shown = traitlets.Enum(SHOWN, SHOWN[0]).tag(sync=True, setting=True)
    """What is drawn of a network: ``"disparity"``, its ``"error"``, or where it is ``"better"``.

    - Type: `str`
    - Default: `"disparity"`
    """

    first = traitlets.Unicode().tag(sync=True, setting=True)
    """Name of network A: the left one of a swipe, and what the others are compared to. - Type: `str`"""

    second = traitlets.Unicode().tag(sync=True, setting=True)
    """Name of network B: the right one of a swipe, whose outlier regions are listed. - Type: `str`"""

    limits = traitlets.List(traitlets.Float()).tag(sync=True, setting=True)
    """Lowest and highest disparity of the colour range that all panels share.

    - Type: `list[float]`, pixels
    - Default: `[]`: the 1st and 99th percentile of the pair's ground truth
    """

    camera = traitlets.Dict().tag(sync=True)
    """Centre ``x``, ``y`` of all panels in pixels of the image, and ``zoom``; empty for the whole image."""

    cursor = traitlets.List(traitlets.Int()).tag(sync=True)
    """Column and row whose values are read out, in pixels of the image; empty for none."""

    divider = traitlets.Float(0.5, min=0.0, max=1.0).tag(sync=True)
    """Where a swipe changes from A to B, as a share of the panel's width. - Type: `float`, 0 to 1"""

    def __init__(
        self,
        pool: Pool,
        networks: Mapping[str, Network],
        benchmark: Benchmark,
        *,
        pair: str | None = None,
        metrics: Sequence[str] = (),
        compute: Compute = HERE,
        **settings: Any,
    ) -> None:
        # Before networks are looked at: a misspelt setting should cost nothing.
        self.refuse_unknown(settings)
        self._comparison = Comparison(pool, networks, benchmark, metrics=metrics, compute=compute)
        names = list(networks)
        chosen = {"first": names[0], "second": names[min(1, len(names) - 1)], **settings}
        super().__init__(chosen, palettes=palettes(), pairs=list(self._comparison.pairs))
        self.choose(pair or self._comparison.pairs[0])

    def sheet(self) -> Sheet:
        """The pair and its networks, as they are shown."""
        return compare_sheet(self._comparison.panels(self.scene["pair"]), self.shown, self.first)

    @property
    def comparison(self) -> Comparison:
        """What runs the networks, and keeps the maps of the last pairs."""
        return self._comparison

    @command
    def choose(self, pair: str) -> None:
        """Show another pair of the benchmark; the networks run where they have not run on it yet.

        Raises:
            InputError: an unknown pair, or one that cannot be scored.
        """
        # Before anything changes: a pair that cannot be scored leaves the one on show.
        shown = scene(self._comparison.panels(pair))
        with self.changing():
            # A place in one image means nothing in another.
            if self.scene and pair != self.scene["pair"]:
                self.camera, self.cursor = {}, []
            self.scene = shown

    @command
    def look(
        self,
        arrangement: str | None = None,
        shown: str | None = None,
        first: str | None = None,
        second: str | None = None,
        limits: list[float] | None = None,
        camera: dict[str, float] | None = None,
        cursor: list[int] | None = None,
        divider: float | None = None,
    ) -> None:
        """Remember how the reader looks at the pair, so that a saved notebook shows it again."""
        given = {
            "arrangement": arrangement,
            "shown": shown,
            "first": first,
            "second": second,
            "limits": limits,
            "camera": camera,
            "cursor": cursor,
            "divider": divider,
        }
        for name, value in given.items():
            if value is not None:
                setattr(self, name, value)

    @traitlets.validate("first", "second")
    def _known_network(self, proposal: Any) -> str:
        name = str(proposal["value"])
        ensure_known(f"network for {proposal['trait'].name!r}", name, self._comparison.networks)
        return name

    @traitlets.validate("limits")
    def _ascending(self, proposal: Any) -> list[float]:
        values = [float(value) for value in proposal["value"]]
        if values and (len(values) != 2 or not -math.inf < values[0] < values[1] < math.inf):
            raise InputError(f"limits: found {values}, expected a lower and a higher disparity in pixels")
        return values
