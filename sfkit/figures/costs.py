"""What did it cost? Evaluations and seconds, stage by stage, and beside what the trainings took."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import plotly.graph_objects as go
from plotly.subplots import make_subplots

from sfkit.analysis.costs import JOINT, MethodCost, Overhead, StageCost, total_cost
from sfkit.figures.theme import ACCENT, LOOKS, WARM, finish, read_theme

BOUND = "a lower bound: evaluations alone count, those a store serves as when they were computed"
"""What the wall time of a method is, said beside its share of a training's."""


def cost_figure(costs: Sequence[StageCost], *, theme: str = "auto", height: int | None = None) -> go.Figure:
    """Draw evaluations and seconds of each stage as bars, split by what was computed and what was not.

    Args:
        costs: from :func:`~sfkit.analysis.costs.stage_costs`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; by the number of stages unless given.

    Raises:
        InputError: an unknown theme.
    """
    figure = make_subplots(rows=1, cols=2, shared_yaxes=True, horizontal_spacing=0.06)
    stages = [cost.stage for cost in costs]
    muted = LOOKS[read_theme(theme)].muted
    parts = (
        ("computed", ACCENT, [c.computed for c in costs], [(c.seconds, c.cpu_seconds) for c in costs]),
        (
            "from the store",
            WARM,
            [c.cached for c in costs],
            [(c.seconds_saved, c.cpu_seconds_saved) for c in costs],
        ),
        ("repeated, not evaluated", muted, [c.repeated for c in costs], None),
    )
    for name, colour, evaluations, took in parts:
        # One entry in the legend for the bars of both panels.
        bar: dict[str, Any] = {"y": stages, "orientation": "h", "name": name, "legendgroup": name}
        bar["marker"] = {"color": colour, "line": {"width": 0}}
        hover = f"%{{y}}: %{{x:,}} {name}<extra></extra>"
        figure.add_bar(x=evaluations, hovertemplate=hover, **bar, row=1, col=1)
        if took is not None:
            hover = f"%{{y}}: %{{x:.1f}} s {name}, %{{customdata}} of CPU<extra></extra>"
            bar["customdata"] = [_seconds(cpu) for _, cpu in took]
            wall = [seconds for seconds, _ in took]
            figure.add_bar(x=wall, hovertemplate=hover, showlegend=False, **bar, row=1, col=2)
    figure.update_yaxes(type="category", autorange="reversed")
    figure.update_yaxes(title_text="stage", row=1, col=1)
    figure.update_xaxes(title_text="candidates (number)", row=1, col=1)
    figure.update_xaxes(title_text="evaluation time (s, wall)", row=1, col=2)
    total = total_cost(costs)
    return finish(
        figure,
        theme=theme,
        title="What did the search cost?",
        subtitle=f"{total.computed:,} evaluations computed in {total.seconds:,.1f} s "
        f"({_seconds(total.cpu_seconds)} of CPU); the store saved {total.seconds_saved:,.1f} s",
        height=height or 36 * len(costs) + 230,
        barmode="stack",
    )


def method_cost_figure(
    costs: Sequence[MethodCost], *, passes: bool = False, theme: str = "auto", height: int | None = None
) -> go.Figure:
    """Draw what whole methods take from nothing: evaluations, and wall seconds beside CPU seconds.

    Args:
        costs: from :meth:`sfkit.analysis.Study.costs`, or of one's own.
        passes: draw image passes instead of evaluations, for trainings have none of these.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; by the number of methods unless given.

    Raises:
        InputError: an unknown theme.
    """
    figure = make_subplots(rows=1, cols=2, shared_yaxes=True, horizontal_spacing=0.06)
    methods = [cost.method for cost in costs]
    work = [cost.image_passes if passes else cost.evaluations for cost in costs]
    counted = "image pairs through the network" if passes else "evaluations on validation"
    muted = LOOKS[read_theme(theme)].muted
    parts = (
        (1, "", ACCENT, work, ",.0f"),
        (2, "wall time", WARM, [cost.seconds for cost in costs], ".1f"),
        # None, a gap, where nobody measured it.
        (2, "CPU time", muted, [cost.cpu_seconds for cost in costs], ".1f"),
    )
    for col, name, colour, values, form in parts:
        figure.add_bar(
            x=values,
            y=methods,
            orientation="h",
            name=name,
            showlegend=bool(name),
            marker={"color": colour, "line": {"width": 0}},
            hovertemplate=f"%{{y}}: %{{x:{form}}}{f' s of {name}' if name else ''}<extra></extra>",
            row=1,
            col=col,
        )
    figure.update_xaxes(title_text=f"{counted} (number)", row=1, col=1)
    figure.update_xaxes(title_text="seconds", row=1, col=2)
    figure.update_yaxes(type="category", autorange="reversed")
    figure.update_yaxes(title_text="part" if passes else "method", row=1, col=1)
    # By what was counted: seconds depend on the machine.
    most, dearest = max(zip(work, methods, strict=True))
    return finish(
        figure,
        theme=theme,
        title="What does each part take?" if passes else "What does each method take?",
        subtitle=f"each from nothing, whatever the store held; most: {dearest}, "
        f"{most:,} {'passes' if passes else 'evaluations'}",
        height=height or 28 * len(costs) + 230,
        barmode="group",
    )


def overhead_figure(record: Overhead, *, theme: str = "auto", height: int | None = None) -> go.Figure:
    """Draw each method's wall time in percent of the trainings', a bar a training.

    It is that of the evaluations when they were computed, whether a store serves them now or not; what a
    search does between them is not in it, so that a share is a lower bound, as the figure says.

    Args:
        record: from :meth:`sfkit.analysis.Study.overhead`, or :func:`~sfkit.analysis.costs.overhead`.
        theme: ``light``, ``dark``, or ``auto`` for a figure that reads on both.
        height: of the figure in pixels; by the number of bars unless given.

    Raises:
        InputError: an unknown theme.
    """
    figure = go.Figure()
    methods = [cost.method for cost in record.costs]
    most = (0.0, "", "")
    for name, seconds in record.trainings.items():
        shares = [record.share(cost, name) for cost in record.costs]
        most = max([most, *((share, method, name) for share, method in zip(shares, methods, strict=True))])
        figure.add_bar(
            x=shares,
            y=methods,
            orientation="h",
            name=f"of {name} ({seconds:,.0f} s, {_seconds(record.worked.get(name))} of CPU)",
            marker={"color": WARM if name == JOINT else ACCENT, "line": {"width": 0}},
            text=[f"{share:.1f} %" for share in shares],
            textposition="outside",
            cliponaxis=False,
            customdata=[(f"{cost.seconds:,.1f} s", _seconds(cost.cpu_seconds)) for cost in record.costs],
            hovertemplate=f"%{{y}}: %{{x:.2f}} % of {name}; %{{customdata[0]}}, %{{customdata[1]}} of CPU"
            "<extra></extra>",
        )
    figure.update_yaxes(type="category", autorange="reversed", title_text="method")
    # Room for the number beside the longest bar, on a narrow page too.
    figure.update_xaxes(range=[0.0, 1.25 * most[0] or 1.0], title_text="wall time (% of the training's)")
    return finish(
        figure,
        theme=theme,
        title="What does each method cost beside training?",
        subtitle=f"most: {most[1]}, {most[0]:.1f} % of {most[2]}; {BOUND}"
        if most[1]
        else "nothing was measured",
        height=height or 20 * len(methods) * len(record.trainings) + 200,
        barmode="group",
        showlegend=True,
    )


def _seconds(value: float | None) -> str:
    return "an unknown time" if value is None else f"{value:,.1f} s"
