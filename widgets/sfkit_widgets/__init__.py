"""Widgets to watch searches, edit routings and compare disparities in Jupyter."""

from sfkit_widgets.disparity_compare import DisparityCompare
from sfkit_widgets.opening import compare, inspect
from sfkit_widgets.population_view import PopulationView
from sfkit_widgets.routing_inspector import RoutingInspector
from sfkit_widgets.routing_view import RoutingView
from sfkit_widgets.run_table import RunTable
from sfkit_widgets.search_control import SearchControl
from sfkit_widgets.watch import SearchWatch, watch

__all__ = [
    "DisparityCompare",
    "PopulationView",
    "RoutingInspector",
    "RoutingView",
    "RunTable",
    "SearchControl",
    "SearchWatch",
    "compare",
    "inspect",
    "watch",
]
