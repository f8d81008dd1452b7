"""What the RoutingInspector shows: its traits, all written by Python and drawn by the script."""

from __future__ import annotations

import traitlets

from sfkit_widgets._base import SfkitWidget


class RoutingTraits(SfkitWidget):
    """The traits of :class:`~sfkit_widgets.routing_inspector.RoutingInspector`."""

    blocks = traitlets.List(traitlets.Unicode()).tag(sync=True)
    """Names of the B blocks, in the partition's order.

    - Type: `list[str]`
    """

    sources = traitlets.List(traitlets.Unicode()).tag(sync=True)
    """Names of the E sources of the subset.

    - Type: `list[str]`
    """

    gamma = traitlets.List(traitlets.Float()).tag(sync=True)
    """Lowest and highest module scale; 1 is neutral.

    - Type: `list[float]`, factors
    - Default: `[0.25, 1.75]`
    """

    weights = traitlets.List(traitlets.List(traitlets.Float())).tag(sync=True)
    """Routing weights, B rows of E, each row on the simplex.

    - Type: `list[list[float]]`, fractions
    - Default: 1/E each
    """

    scales = traitlets.List(traitlets.Float()).tag(sync=True)
    """Module scales, one a block.

    - Type: `list[float]`, factors within `gamma`
    - Default: `1.0` each
    """

    tied = traitlets.Bool(True).tag(sync=True)
    """Whether one row of weights holds for all blocks.

    - Type: `bool`
    - Default: `True`
    """

    locked = traitlets.List(traitlets.List(traitlets.Bool())).tag(sync=True)
    """Which weights stay while others move, B rows of E.

    - Type: `list[list[bool]]`
    - Default: none
    """

    gone = traitlets.List(traitlets.Unicode()).tag(sync=True)
    """Sources that are taken out for now.

    - Type: `list[str]`
    - Default: `[]`
    """

    can_undo = traitlets.Bool(False).tag(sync=True)
    """Whether there is an edit to take back.

    - Type: `bool`
    """

    can_redo = traitlets.Bool(False).tag(sync=True)
    """Whether there is an edit to make again.

    - Type: `bool`
    """

    recipe_json = traitlets.Unicode("").tag(sync=True)
    """The recipe as `Recipe.to_json` writes it.

    - Type: `str`
    """

    metric = traitlets.Dict().tag(sync=True)
    """What scores are: metric `name` and `unit` ("%" or "px"), `benchmark`, how many `pairs`, `protocol`.

    - Type: `dict`
    """

    trials = traitlets.Dict().tag(sync=True)
    """Trials of the Stage 2 search, in columns: `iteration`, `score` (the metric's unit, None where it
    failed) and `best` (number of the best trial up to each, -1 where there is none).

    - Type: `dict[str, list]`
    - Default: empty columns
    """

    trial = traitlets.Int(None, allow_none=True).tag(sync=True)
    """Number of the trial on show; None once it was edited.

    - Type: `int`
    """

    pairs = traitlets.List(traitlets.Unicode()).tag(sync=True)
    """Ids of the benchmark's pairs.

    - Type: `list[str]`
    """

    pair = traitlets.Unicode("").tag(sync=True)
    """Id of the pair on show.

    - Type: `str`
    - Default: the first
    """

    size = traitlets.List(traitlets.Int()).tag(sync=True)
    """Height and width of the pair.

    - Type: `list[int]`, pixels
    """

    left_picture = traitlets.Bytes(b"").tag(sync=True)
    """The left image.

    - Type: `bytes`, JPEG
    """

    truth_picture = traitlets.Bytes(b"").tag(sync=True)
    """The ground truth in colours, hatched grey where none counts; of a pair without any the right image.

    - Type: `bytes`, JPEG
    """

    disparity_picture = traitlets.Bytes(b"").tag(sync=True)
    """The edited network's disparity in the pair's colours.

    - Type: `bytes`, JPEG
    """

    error_picture = traitlets.Bytes(b"").tag(sync=True)
    """Its error, or residual: blue below the threshold, orange beyond.

    - Type: `bytes`, JPEG
    """

    captions = traitlets.Dict().tag(sync=True)
    """What two pictures are called: `truth` "ground truth" or "right image", `error` "error" or "residual".

    - Type: `dict[str, str]`
    """

    legends = traitlets.Dict().tag(sync=True)
    """Colour keys of `disparity` (pixels) and `error` (pixels, or percent of census bits): `stops`, and the
    low, middle and high `ticks`.

    - Type: `dict`
    """

    shades = traitlets.List(traitlets.List(traitlets.Unicode())).tag(sync=True)
    """Background and text colour of the weights 0, 0.01, ..., 1.

    - Type: `list[list[str]]`, CSS colours
    """

    look = traitlets.Dict().tag(sync=True)
    """What is on show: `score` on the pair (`state` and `value` in the metric's unit; unknown at reduced
    size), `reduction` (1 = full size), `milliseconds` that merging and the forward pass took.

    - Type: `dict`
    """

    scores = traitlets.Dict().tag(sync=True)
    """The recipe's score on the whole benchmark: `state` ("unknown", "running", "known" or "failed") and
    `value`.

    - Type: `dict`, the metric's unit
    """

    pins = traitlets.Dict().tag(sync=True)
    """Scores of the pinned recipes "A" and "B": of the `pair` and of the `benchmark`, as `scores`.

    - Type: `dict[str, dict]`, the metric's unit
    - Default: `{}`
    """

    pin_pictures = traitlets.Dict().tag(sync=True)
    """Pictures of the pinned recipes: `disparity` and `error`.

    - Type: `dict[str, dict[str, bytes]]`, JPEG
    - Default: `{}`
    """

    flag = traitlets.Unicode("").tag(sync=True)
    """What to know where a report tests on the pairs that edits are scored on; empty where none does.

    - Type: `str`
    """

    saved = traitlets.Unicode("").tag(sync=True)
    """The file the recipe's network was written to; empty once it was edited.

    - Type: `str`
    """
