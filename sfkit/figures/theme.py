"""How figures look: one plotly template for light pages, one for dark ones, one that reads on both."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Any

import plotly.graph_objects as go

from sfkit.errors import member_of


class Theme(StrEnum):
    """The page a figure stands on."""

    LIGHT = "light"
    DARK = "dark"
    AUTO = "auto"  # unknown, or a report that follows its reader: every colour reads on both


@dataclass(frozen=True)
class Look:
    """Colours of one theme.

    Attributes:
        ink: text.
        muted: text and marks of lesser weight, reference lines.
        rule: grid lines.
        faint: fill of what is absent.
        paper: what it is all drawn on.
    """

    ink: str
    muted: str
    rule: str
    faint: str
    paper: str = "rgba(0,0,0,0)"


LOOKS: dict[Theme, Look] = {
    Theme.LIGHT: Look("#1f2328", "#59636e", "rgba(31,35,40,0.14)", "rgba(31,35,40,0.07)"),
    Theme.DARK: Look("#e6edf3", "#9198a1", "rgba(230,237,243,0.18)", "rgba(230,237,243,0.09)"),
    # No grey has a contrast of 4.5 with both white and JupyterLab's night (4.35 is the most): a figure for
    # either page brings its paper along: white on the one, a light card on the other.
    Theme.AUTO: Look(
        "#1f2328", "#59636e", "rgba(31,35,40,0.14)", "rgba(31,35,40,0.07)", "rgba(255,255,255,0.93)"
    ),
}

ACCENT = "#2b7bd3"
WARM = "#d2601a"
FAILED = "#d1405f"

SERIES = ("#2b7bd3", "#d2601a", "#0f9574", "#b565a7", "#9a8200", "#d1405f", "#7a6fd6", "#8a7365")
"""Colours of lines, in order: apart for colour-blind eyes, 3:1 and more on white and on near-black."""

DASHES = ("solid", "dash", "dot")


def read_theme(theme: str) -> Theme:
    """The theme called ``theme``.

    Raises:
        InputError: none of ``light``, ``dark`` and ``auto``.
    """
    return member_of(Theme, "theme", theme)


def series_style(number: int) -> dict[str, str]:
    """Colour and dash of the n-th line; 24 of them differ."""
    return {
        "color": SERIES[number % len(SERIES)],
        "dash": DASHES[number // len(SERIES) % len(DASHES)],
    }


def template(theme: str = "auto") -> go.layout.Template:
    """The plotly template of a theme.

    Raises:
        InputError: no such theme.
    """
    look = LOOKS[read_theme(theme)]
    axis = {
        "gridcolor": look.rule,
        "linecolor": look.rule,
        "zerolinecolor": look.rule,
        "tickcolor": look.rule,
        "zeroline": False,
        "showline": True,
        "ticks": "outside",
        "ticklen": 4,
        "automargin": True,
        "title": {"standoff": 8},
    }
    return go.layout.Template(
        layout={
            "paper_bgcolor": look.paper,
            "plot_bgcolor": "rgba(0,0,0,0)",
            "font": {"color": look.ink, "size": 12, "family": "system-ui, sans-serif"},
            # By the container: long names beside the plot must not push it.
            "title": {"x": 0, "xref": "container", "xanchor": "left", "pad": {"l": 12}},
            "colorway": list(SERIES),
            "xaxis": axis,
            "yaxis": axis,
            # At the bottom of the figure, whatever its height.
            "legend": {"orientation": "h", "yref": "container", "y": 0.0, "yanchor": "bottom", "x": 0},
            "hoverlabel": {"font": {"color": "#ffffff"}, "bgcolor": "#333a42", "align": "left"},
            "margin": {"l": 60, "r": 20, "t": 96, "b": 84},
        }
    )


def finish(
    figure: go.Figure, *, theme: str, title: str, subtitle: str, height: int, **layout: Any
) -> go.Figure:
    """Give a figure its template, the question it asks, a line of answer, and its height in pixels."""
    figure.update_layout(
        template=template(theme),
        title={"text": title, "subtitle": {"text": subtitle}},
        height=height,
        **layout,
    )
    figure.update_annotations(font_size=12)  # titles of panels
    return figure
